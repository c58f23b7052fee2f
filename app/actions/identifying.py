"""``headstock identify``: numbers of a scene fitted to measurements, with intervals and directions
that the data leave open.
"""

import dataclasses
import functools
import json
import math
import re
import shlex
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import click

from headstock.app.actions.running import claim_on_root, require_ranks
from headstock.app.commands.batch_commands import IdentifyOptions
from headstock.app.terminal.console import add_row, counted, make_console, make_table, print_table
from headstock.app.terminal.guard import DONE, FAILED
from headstock.pipeline.storage.json_texts import JsonTable, dump_summary
from headstock.pipeline.storage.outputs import check_output, write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.scene.expansion.overrides import AS_WRITTEN
from headstock.scene.reading.keys import write_number
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.identification.candidates import Candidate, suggest_measurements
from headstock.studies.identification.descent import StartRecord
from headstock.studies.identification.evidence import Evidence, weigh_evidence
from headstock.studies.identification.files import (
    HELD_OUT_FILE,
    OVERRIDES_FILE,
    RECORD_FILE,
    hide_held_out,
    render_overrides,
    summarise_identification,
    summarise_outcome,
)
from headstock.studies.identification.identification import (
    FitEnds,
    FittedParameter,
    Identification,
    assess_ends,
    fit_targets,
    prepare_problem,
)
from headstock.studies.identification.leave_out import predict_each_mode
from headstock.studies.identification.problem import FitProblem
from headstock.studies.identification.sensors import RankedSensor, rank_sensors
from headstock.studies.identification.target_files import LoadedTask, load_targets
from headstock.studies.identification.targets import IdentificationTask

FIT_START = b"# ./headstock identify "  # of the file of a fitted variant
SEEN_FAINTLY = 0.5
COMBINATIONS_SHOWN = 20
SENSORS_SHOWN = 12
RIVALS_SHOWN = 2  # in the table of sensors, the best of them
SPREADS = ("relative_spread_95", "relative_mesh_95", "relative_scatter_95")


def _print_task(task: IdentificationTask) -> None:
    """Name what is fitted to what."""
    held_out = [held for case in task.cases for held in case.held_out]
    held = sum(held_out)
    text = f"{len(task.parameters)} parameters, {len(held_out) - held} targets in {len(task.cases)} cases"
    make_console().say(f"{task.name}  ({text}{f', {held} held out' if held else ''})", style="bold")

    for target, record in (each for case in task.cases for each in case.records):
        make_console().say(f"{target.name}: line of {record}")


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
        make_console().say(text, soft_wrap=True)


def _print_start(record: StartRecord) -> None:
    """One line per start."""
    refused = f", {record.refused} refused" if record.refused else ""
    moved = f", {record.exchanges} exchange(s) of modes" if record.exchanges else ""
    cost = f"{2.0 * record.cost:12.5g}"
    line = f"  start  sum of squares {cost}  {record.evaluations:4d} evaluations{moved}{refused}  {record.reason}"
    make_console().say(line, soft_wrap=True)


def _print_fit(number: int, count: int, left_out: str, seconds: float) -> None:
    """One line per fit that leaves out a mode."""
    left = seconds / number * (count - number)
    text = f"  fit {number} of {count} without {left_out}: {seconds:.0f} s, about {left:.0f} s left"
    make_console().say(text, soft_wrap=True)


def _print_identification(found: Identification, summary: JsonTable, folder: Path) -> None:
    """Everything a fit found.

    Args:
        summary: What the files have of it.
    """
    console = make_console()
    console.print()
    table = make_table("parameter", ">fitted", ">95 % from", ">to", ">data share", "note")
    for item in found.parameters:
        add_row(table, *_parameter_cells(item))
    print_table(
        console, "Parameters (data share: how much the data reduce the prior variance)", table
    )
    _print_targets(cast(list[JsonTable], summary["targets"]))
    for case, extra in found.extra_hz.items():
        if extra:
            shown = ", ".join(f"{value:.4g}" for value in extra)
            console.say(
                f"{case}: the model has {len(extra)} further mode(s) in the range: {shown} Hz"
            )
    _print_doubts(found)
    fitted = [abs(item.deviation) for item in found.outcomes if not item.hold_out]
    status = "converged" if found.converged else f"not converged: {found.starts[found.best].reason}"
    text = f"{status}; largest deviation {100.0 * max(fitted):.2f} %; written to {folder}"
    console.say(text, style="bold")


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


def _print_targets(rows: Sequence[JsonTable], what: str = "Targets") -> None:
    """Print targets and what the model gives."""
    table = make_table(
        *("target", ">measured", ">model", ">± fit", ">± mesh", ">scatter", ">deviation"),
        *(">in sigma", ">MAC", ">mode", ""),
    )
    for row in rows:
        add_row(table, *_target_cells(row))
    title = f"{what} (±: of fitted parameters, and of meshes; scatter: of a measurement; 95 %)"
    print_table(make_console(), title, table)


def _target_cells(row: JsonTable) -> tuple[str, ...]:
    unit = str(row["unit"]).replace("um", "µm")

    def show(key: str, form: str, behind: str = "", factor: float = 1, lacking: str = "") -> str:
        value = row[key]
        return f"{factor * value:{form}}{behind}" if isinstance(value, int | float) else lacking

    return (
        str(row["name"]),
        show("measured", ".4g", f" {unit}", lacking="hidden"),
        show("model", ".4g", f" {unit}"),
        show("relative_spread_95", ".2g", " %", 100, "open"),
        show("relative_mesh_95", ".2g", " %", 100, "?" if row["kind"] == "frequency" else ""),
        show("relative_scatter_95", ".2g", " %", 100),
        show("deviation", "+.2f", " %", 100),
        show("residual_sigma", "+.2f"),
        show("mac", ".2f"),
        show("mode", "d"),
        "held out" if row["hold_out"] else "",
    )


def open_held_out(folder: Path, json_file: Path | None = None) -> int:
    """Print what was measured of the targets that a fit held out and hid, with its predictions.

    Args:
        json_file: Receives these targets too.

    Raises:
        click.UsageError: The folder has none.
    """
    try:
        rows = json.loads((folder / HELD_OUT_FILE).read_text())["targets"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise click.UsageError(
            f"--open {folder}: there are no hidden targets; `identify --hide-held-out -o {folder}` writes them"
        ) from error
    if json_file is not None:
        write_output(json_file, dump_summary({"targets": rows}).encode())
    _print_predictions(rows, "Targets")
    return DONE


def _print_predictions(rows: Sequence[JsonTable], what: str) -> None:
    """Print targets that were not fitted, and how well they were predicted."""
    _print_targets(rows, what)
    sizes = [[cast(float | None, row[key]) or 0.0 for key in SPREADS] for row in rows]
    reaches = [math.hypot(*row) for row in sizes]
    deviations = [abs(cast(float, row["deviation"])) for row in rows]
    inside = sum(off <= reach for off, reach in zip(deviations, reaches, strict=True))
    rms = 100.0 * math.sqrt(sum(off**2 for off in deviations) / max(1, len(rows)))
    text = f"{inside} of {len(rows)} within ± and scatter; deviations {rms:.2f} % rms"
    make_console().say(text, style="bold")


def _print_doubts(found: Identification) -> None:
    console, statistics = make_console(), found.statistics
    for first, second in found.exchanges:
        text = f"{first} and {second}: the model has these modes in the other order"
        console.say(text, style="yellow")
    if statistics.unidentifiable:
        table = make_table("combination of parameters", ">left open", "")
        for one in statistics.combinations[:COMBINATIONS_SHOWN]:
            share = 100.0 / math.hypot(1.0, 1.0 / one.spread)
            add_row(table, str(one), f"{share:.2g} %", "unidentifiable" if one.spread > 1.0 else "")
        print_table(console, "Combinations (left open: of the spread allowed beforehand)", table)
    for first, second, value in found.correlated:
        console.say(f"correlated {value:+.2f}: {second} and {first}", style="yellow")
    for name in found.left_out:
        text = f"{name}: no mode moves like this (MAC below 0.5), so its shape is left out; insist = true keeps it"
        console.say(text, style="yellow")
    for kind, noise in statistics.noise_by_kind.items():
        if noise.factor is not None:
            text = f"{kind}: residuals are {noise.factor:.2g} times the stated tolerances ({noise.freedom:.1f} degrees of freedom)"
            console.say(text)


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
    loaded = make_on_root(comm, lambda: _load(options))
    others = {
        name: make_on_root(comm, functools.partial(_load, options, name))
        for name in loaded.task.rivals
    }
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
        rivals = _fit_rivals(others, comm)
        predicted = predict_each_mode(ends, _print_fit, comm=comm) if options.leave_out_each else []

        def publish() -> int:
            found = assess_ends(ends, loaded.task.name)
            seconds = time.perf_counter() - begin
            models, evidence = _rank_models(found, rivals)
            weak = bool(found.statistics.unidentifiable)
            suggested = suggest_measurements(found) if weak else ()
            left_out = [summarise_outcome(item) for item in predicted]
            sensors = rank_sensors(found, models) if weak or models else ()
            summary = {
                **summarise_identification(found),
                "models": {name: dataclasses.asdict(one) for name, one in evidence.items()},
                "suggested": [dataclasses.asdict(one) for one in suggested],
                "sensors": [dataclasses.asdict(one) for one in sensors],
                **({"left_out_each": left_out} if left_out else {}),
                "seconds": seconds,
            }
            if options.hide_held_out:
                summary, hidden = hide_held_out(summary)
                write_output(output / HELD_OUT_FILE, dump_summary({"targets": hidden}).encode())
            _publish(options, found, summary, output, origin)
            _print_identification(found, summary, output)
            if left_out:
                _print_predictions(left_out, "Each mode by a fit to the others")
            _print_models(evidence)
            _print_suggested(suggested)
            _print_sensors(sensors, [*models])
            if options.write is not None:
                _print_include(options.scene, options.write)
            return DONE if found.converged else FAILED

        return make_on_root(comm, publish)


def _load(options: IdentifyOptions, rival: str | None = None) -> LoadedTask:
    """Load the target file for the scene, or for one of its other models."""
    return load_targets(
        options.targets,
        options.scene,
        overrides=options.chosen.overrides,
        starts=options.starts,
        rival=rival,
    )


def _fit_rivals(rivals: Mapping[str, LoadedTask], comm: MPI.Comm) -> dict[str, FitEnds]:
    """Fit every other model; collective."""
    ends: dict[str, FitEnds] = {}
    for name, loaded in rivals.items():
        if comm.rank == 0:
            make_console().say(f"model {name}", style="bold")
        problem = prepare_problem(loaded, Store(default_store_root()), comm)
        ends[name] = fit_targets(problem, _print_start, comm=comm)
    return ends


def _rank_models(
    found: Identification, rivals: Mapping[str, FitEnds]
) -> tuple[dict[str, Identification], dict[str, Evidence]]:
    """Return the scene and the other models of the target file by name, the one with the least BIC first,
    and their evidence in the order of the file; nothing without others.
    """
    if not rivals:
        return {}, {}
    models = {AS_WRITTEN: found, **{name: assess_ends(end, name) for name, end in rivals.items()}}
    evidence = {name: weigh_evidence(one) for name, one in models.items()}
    order = sorted(models, key=lambda name: evidence[name].bic)
    return {name: models[name] for name in order}, evidence


def _print_models(models: Mapping[str, Evidence]) -> None:
    """Rank the scene and the other models of the target file."""
    if not models:
        return
    ranked = sorted(models.items(), key=lambda item: item[1].bic)
    table = make_table("model", ">parameters", ">misfit", ">BIC", ">more", ">ln evidence")
    for name, one in ranked:
        log = "" if one.log_evidence is None else f"{one.log_evidence:.2f}"
        more = f"{one.bic - ranked[0][1].bic:.2f}"
        add_row(table, name, str(one.parameters), f"{one.misfit:.4g}", f"{one.bic:.4g}", more, log)
    title = "Models by evidence (BIC: the least is best, 6 less is strong, 10 less very strong)"
    print_table(make_console(), title, table)


def _print_suggested(suggested: Sequence[Candidate]) -> None:
    """Name further measurements that would determine what the data leave open."""
    if suggested:
        table = make_table("further measurement", ">gain", ">weakest combination")
        for one in suggested:
            add_row(table, one.name, f"{one.bits:.1f} bit", f"{100.0 * one.spread:.0f} %")
        title = "Suggested measurements (weakest combination: its spread over that of now)"
        print_table(make_console(), title, table)


def _print_sensors(sensors: Sequence[RankedSensor], models: Sequence[str]) -> None:
    """Rank sensors by what they would say about models, the best of these first, and parameters."""
    if not sensors:
        return
    rivals = models[1 : 1 + RIVALS_SHOWN]
    heads = [f">ln evidence, {name}" for name in rivals]
    last = ["most at"] if models else []
    table = make_table("further sensor", *heads, ">gain", ">weakest combination", *last)
    # what the reference point shows alone is part of every other row
    reference = [one for one in sensors[SENSORS_SHOWN:] if one.is_reference]
    for one in (*sensors[:SENSORS_SHOWN], *reference):
        logs = [f"{one.log_evidence[name]:.1f}" for name in rivals]
        alone = " alone" if one.is_reference else ""
        cells = (*logs, f"{one.bits:.1f} bit", f"{100.0 * one.spread:.0f} %")
        add_row(table, f"{one.name}{alone}", *cells, *([one.mode] if models else []))
    against = f"; ln evidence: between {models[0]} and another model, 5 decides" if models else ""
    title = f"Further sensors, each read along with the reference point{against}"
    print_table(make_console(), title, table)
    if more := len(models[1:]) - len(rivals):
        make_console().say(f"  and {counted(more, 'more model')} in {RECORD_FILE}")


def _print_include(scene: Path, name: str) -> None:
    """Say where the fitted variant is, and how the scene gets it where it does not have it."""
    file = _fit_file(scene, name)
    how = (
        ""
        if name in load_scene(scene).variants
        else f'; write include = ["{file.name}"] at the top of {scene.name}'
    )
    text = f"variant {name} is in {file}{how}; apply it as --variant {name}"
    make_console().say(text, soft_wrap=True)


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
            write_output(_fit_file(path, options.write), fitted.encode(), FIT_START)
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
        OutputError: The file of the variant must not be written over.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise click.UsageError(f"--write {name!r}: write a name of letters, digits and _")
    if name in load_scene(scene).variants and not _fit_file(scene, name).exists():
        raise click.UsageError(
            f"--write {name}: the scene has a variant of this name; choose another"
        )
    check_output(_fit_file(scene, name), FIT_START)


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
