"""``headstock identify``: numbers of a scene fitted to measurements, with intervals and directions
that the data leave open.
"""

import math
import re
import shlex
import time
from collections.abc import Mapping
from pathlib import Path

import click

from headstock.app.actions.running import claim_on_root, require_ranks
from headstock.app.commands.batch_commands import IdentifyOptions
from headstock.app.terminal.console import add_row, make_console, make_table, print_table
from headstock.app.terminal.guard import DONE, FAILED
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.keys import write_number
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.identification.descent import StartRecord
from headstock.studies.identification.files import (
    OVERRIDES_FILE,
    RECORD_FILE,
    render_overrides,
    summarise_identification,
)
from headstock.studies.identification.identification import (
    FittedParameter,
    Identification,
    TargetOutcome,
    assess_ends,
    fit_targets,
    prepare_problem,
)
from headstock.studies.identification.observations import KINDS
from headstock.studies.identification.problem import FitProblem
from headstock.studies.identification.target_files import load_targets
from headstock.studies.identification.targets import IdentificationTask

CORRELATION_SHOWN = 0.9
SEEN_FAINTLY = 0.5
UNIDENTIFIABLE_SHOWN = 6


def _print_task(task: IdentificationTask) -> None:
    """Name what is fitted to what."""
    held_out = [held for case in task.cases for held in case.held_out]
    held = sum(held_out)
    text = f"{len(task.parameters)} parameters, {len(held_out) - held} targets in {len(task.cases)} cases"
    make_console().print(
        f"{task.name}  ({text}{f', {held} held out' if held else ''})", style="bold", markup=False
    )


def _print_cost(problem: FitProblem) -> None:
    """Say which components are meshed anew, as this is what a fit then takes its time for."""
    meshed: dict[str, list[str]] = {}
    for model in problem.cases:
        for parameter, touched in model.parametric.touched.items():
            for name in touched.meshed:
                meshed[name] = list(dict.fromkeys([*meshed.get(name, []), parameter]))
    for name, parameters in meshed.items():
        text = (
            f"{name} is meshed and reduced anew at every value of {', '.join(parameters)}: once per evaluation "
            f"and {2 * len(parameters)} times for its derivatives"
        )
        make_console().print(text, markup=False, soft_wrap=True)


def _print_start(record: StartRecord) -> None:
    """One line per start."""
    refused = f", {record.refused} refused" if record.refused else ""
    moved = f", {record.exchanges} exchange(s) of modes" if record.exchanges else ""
    cost = f"{2.0 * record.cost:12.5g}"
    line = f"  start  sum of squares {cost}  {record.evaluations:4d} evaluations{moved}{refused}  {record.reason}"
    make_console().print(line, markup=False, soft_wrap=True)


def _print_identification(found: Identification, folder: Path) -> None:
    """Everything a fit found."""
    console = make_console()
    console.print()
    table = make_table("parameter", ">fitted", ">95 % from", ">to", ">data share", "note")
    for item in found.parameters:
        add_row(table, *_parameter_cells(item))
    print_table(
        console, "Parameters (data share: how much the data reduce the prior variance)", table
    )
    table = make_table(
        *("target", ">measured", ">model", ">± 95 %", ">scatter", ">deviation", ">in sigma"),
        *(">MAC", ">mode", ""),
    )
    for outcome in found.outcomes:
        add_row(table, *_outcome_cells(outcome))
    print_table(
        console, "Targets (±: of the fitted parameters; scatter: of a measurement, 95 %)", table
    )
    for case, extra in found.extra_hz.items():
        if extra:
            shown = ", ".join(f"{value:.4g}" for value in extra)
            console.print(
                f"{case}: the model has {len(extra)} further mode(s) in the range: {shown} Hz",
                markup=False,
            )
    _print_doubts(found)
    fitted = [abs(item.deviation) for item in found.outcomes if not item.hold_out]
    status = "converged" if found.converged else f"not converged: {found.starts[found.best].reason}"
    text = f"{status}; largest deviation {100.0 * max(fitted):.2f} %; written to {folder}"
    console.print(text, style="bold", markup=False)


def _parameter_cells(item: FittedParameter) -> tuple[str, ...]:
    unit = item.parameter.unit
    open_end = "at bound" if item.at_bound else "open"
    ends = [
        f"{write_number(end, unit, 4)}" if math.isfinite(end) else open_end
        for end in (item.low, item.high)
    ]
    notes = [f"at its {item.at_bound} bound"] if item.at_bound else []
    if item.data_share < SEEN_FAINTLY:
        within = "the prior" if item.parameter.prior_sigma is not None else "its bounds"
        notes.append(f"unidentifiable: within {within}")
    return (
        item.parameter.name,
        f"{write_number(item.value, unit, 4)}",
        *ends,
        f"{100.0 * item.data_share:.0f} %",
        "; ".join(notes),
    )


def _outcome_cells(item: TargetOutcome) -> tuple[str, ...]:
    kind = KINDS[item.kind]
    unit = kind.unit.replace("um", "µm")
    wanted, model = (f"{kind.scale * value:.4g} {unit}" for value in (item.wanted, item.found))
    mac = "" if item.mac is None else f"{item.mac:.2f}"
    mode = str(item.mode) if item.mode else ""
    note = "held out" if item.hold_out else ""
    return (
        item.name,
        wanted,
        model,
        f"{100.0 * item.spread:.2g} %" if math.isfinite(item.spread) else "open",
        f"{100.0 * item.scatter:.2g} %",
        f"{100.0 * item.deviation:+.2f} %",
        f"{item.residual:+.2f}",
        mac,
        mode,
        note,
    )


def _print_doubts(found: Identification) -> None:
    console, statistics = make_console(), found.statistics
    for direction in statistics.unidentifiable[-UNIDENTIFIABLE_SHOWN:][
        ::-1
    ]:  # the least certain come last
        console.print(f"unidentifiable from these data: {direction}", style="yellow", markup=False)
    if len(statistics.unidentifiable) > UNIDENTIFIABLE_SHOWN:
        more = len(statistics.unidentifiable) - UNIDENTIFIABLE_SHOWN
        console.print(
            f"and {more} further direction(s), in {RECORD_FILE}", style="yellow", markup=False
        )
    names = [item.parameter.name for item in found.parameters]
    for i, first in enumerate(names):
        for j, second in enumerate(names[:i]):
            value = statistics.correlations[i, j]
            if abs(value) >= CORRELATION_SHOWN:
                console.print(
                    f"correlated {value:+.2f}: {second} and {first}", style="yellow", markup=False
                )
    for name in found.left_out:
        text = f"{name}: no mode moves like this (MAC below 0.5), so its shape is left out; insist = true keeps it"
        console.print(text, style="yellow", markup=False)
    for kind, noise in statistics.noise_by_kind.items():
        if noise.factor is not None:
            text = f"{kind}: residuals are {noise.factor:.2g} times the stated tolerances ({noise.freedom:.1f} degrees of freedom)"
            console.print(text, markup=False)


def identify_command(options: IdentifyOptions, comm: MPI.Comm) -> int:
    """Fit a scene to a target file on all ranks, print what came out and write it; the scene is
    never touched.

    Raises:
        SceneError: The scene or the target file has problems.
        click.UsageError: ``--ranks`` does not fit.
        HeadstockError: A computation failed.
    """
    begin = time.perf_counter()
    origin = options.trace(comm.size)
    require_ranks(options.ranks, comm)
    loaded = make_on_root(
        comm,
        lambda: load_targets(
            options.targets,
            options.scene,
            overrides=options.chosen.overrides,
            starts=options.starts,
        ),
    )
    if options.write is not None:
        _require_free_name(options.scene, options.write)
    output = options.output or Path("results") / f"{options.scene.stem}-{options.targets.stem}"
    with claim_on_root(comm, output, (OVERRIDES_FILE, RECORD_FILE)):
        if comm.rank == 0:
            _print_task(loaded.task)
        problem = prepare_problem(loaded, Store(default_store_root()), comm)
        if comm.rank == 0:
            _print_cost(problem)
        ends = fit_targets(problem, _print_start, comm=comm)

        def publish() -> int:
            found = assess_ends(ends, loaded.task.name)
            seconds = time.perf_counter() - begin
            summary = {**summarise_identification(found), "seconds": seconds}
            _publish(options, found, summary, output, origin)
            _print_identification(found, output)
            if options.write is not None:
                _print_include(options.scene, options.write)
            return DONE if found.converged else FAILED

        return make_on_root(comm, publish)


def _print_include(scene: Path, name: str) -> None:
    """Say where the fitted variant is, and how the scene gets it where it does not have it."""
    file = _fit_file(scene, name)
    how = (
        ""
        if name in load_scene(scene).variants
        else f'; write include = ["{file.name}"] at the top of {scene.name}'
    )
    text = f"variant {name} is in {file}{how}; apply it as --variant {name}"
    make_console().print(text, markup=False, soft_wrap=True)


def _publish(
    options: IdentifyOptions,
    found: Identification,
    summary: Mapping[str, object],
    output: Path,
    origin: Provenance | None,
) -> None:
    """Write every file of a fit.

    Args:
        origin: Where the results come from.
    """
    if origin is not None:
        summary = {**summary, "provenance": origin.summarise()}
    with_folders = origin is None or origin.command is not None
    command = _command(options, found.problem.settings.starts, with_folders=with_folders)
    written = load_scene(options.scene, overrides=options.chosen.overrides)
    write_output(output / OVERRIDES_FILE, render_overrides(found, written, command).encode())
    if options.write is not None:
        for scene in dict.fromkeys(model.case.scene for model in found.problem.cases):
            path = options.targets.parent / scene if scene else options.scene
            other = load_scene(path) if scene else written
            fitted = render_overrides(found, other, command, scene=scene, name=options.write)
            write_output(_fit_file(path, options.write), fitted.encode())
    text = dump_summary(summary)
    write_output(output / RECORD_FILE, text.encode())
    options.write_json(text)


def _fit_file(scene: Path, name: str) -> Path:
    """Return the file beside a scene that holds a fitted variant."""
    return scene.with_name(f"{scene.stem}.{name}.toml")


def _require_free_name(scene: Path, name: str) -> None:
    """Refuse a name of a fitted variant that is none, or that the scene uses for one of its own.

    Raises:
        click.UsageError: It cannot be used.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise click.UsageError(f"--write {name!r}: write a name of letters, digits and _")
    if name in load_scene(scene).variants and not _fit_file(scene, name).exists():
        raise click.UsageError(
            f"--write {name}: the scene has a variant of this name; choose another"
        )


def _command(options: IdentifyOptions, starts: int, *, with_folders: bool) -> str:
    """How to get the same again."""
    files = [str(path) if with_folders else path.name for path in (options.scene, options.targets)]
    return shlex.join(
        [
            "./headstock",
            "identify",
            *files,
            "--starts",
            str(starts),
            *(f"--set={text}" for text in options.set_ or ()),
        ]
    )
