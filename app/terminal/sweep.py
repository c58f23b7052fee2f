"""What the terminal shows of a sweep: what is swept, ranges of every quantity, crossings, poses
that failed.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from rich.table import Table

from headstock.app.tables.sweep_quantities import limit_words, sampled_error_words
from headstock.app.terminal.console import (
    add_row,
    counted,
    make_console,
    make_table,
    print_remarks,
    print_table,
)
from headstock.app.texts.bounded_values import show_bound
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.static import UM_PER_KN
from headstock.pipeline.planning.budgets import lobes_seconds
from headstock.scene.analyses.lobes import LobesRequest
from headstock.scene.studies import describe_positions, moving_axes
from headstock.studies.sweeps.results import PointMap, SweepResults
from headstock.studies.sweeps.runs import SweepJob

FAILED_SHOWN = 20


def print_sweep_header(job: SweepJob, *, ranks: int) -> None:
    """Name what is swept."""
    sweep = job.sweep
    moving = moving_axes(sweep) if sweep.kind == "grid" else []
    sizes = " × ".join(str(sweep.shape[column]) for column in moving)
    variant = f", variant {job.scene.variant}" if job.scene.variant else ""
    poses = counted(len(sweep.positions), "pose")
    poses += (
        f", {sizes} over {' and '.join(sweep.axes[column] for column in moving)}" if moving else ""
    )
    make_console().say(
        f"{job.scene.name}: sweep {sweep.name}  ({poses}{variant}, {counted(ranks, 'rank')})",
        style="bold",
    )
    if (lobes := job.scene.analyses.get(LobesRequest)) is not None:
        machine = job.scene.machine
        each = lobes_seconds(lobes, machine, machine.components, 0)
        every = each * len(sweep.positions)
        whole = f"{every:.2g} s" if every < 120.0 else f"{every / 60.0:.2g} min"
        hint = "" if lobes.checked < 1.0 else "; checked = 0.1 looks at a tenth of the speeds"
        make_console().say(
            f"  lobes: about {each:.2g} s of processor time in each pose, {whole} in all{hint}"
        )


def print_sweep(results: SweepResults, *, computed: int, seconds: float, folder: object) -> None:
    """Ranges of every quantity and where they lie.

    Args:
        computed: How many poses this call computed.
        seconds: That it took [s].
    """
    console = make_console()
    console.print()
    if results.frequencies_hz.shape[1]:
        print_table(console, "Natural modes, tracked from pose to pose [Hz]", _mode_table(results))
    crossings = {} if results.tracked is None else results.tracked.crossings
    for (one, other), count in crossings.items():
        console.print(
            f"modes {one + 1} and {other + 1} cross between {counted(count, 'pair')} of neighbouring poses"
        )
    for name, point in results.points.items():
        samples = [sample.compliances for sample in results.pose_errors if sample.compliances]
        errors = samples[0][name] if samples else {}
        print_table(
            console, f"Static compliance at {name} [µm/kN]", _point_table(point, results, errors)
        )
    for words in sampled_error_words(results):
        console.say(words)
    for words in limit_words(results):
        console.say(words)
    _print_states(results)
    print_remarks(results.warnings)
    console.say(
        f"{results.status} in {seconds:.2f} s, {_describe_poses(len(results.states), computed)}, results in {folder}",
        style="bold",
    )


def _describe_poses(total: int, computed: int) -> str:
    """How many poses this call computed, and how many it found: those of earlier calls, or of the
    tasks of a cluster.
    """
    if computed == total:
        return f"{counted(total, 'pose')} computed"
    found = f"{counted(total - computed, 'finished pose')} collected"
    return f"{counted(computed, 'pose')} computed, {found}" if computed else found


def _mode_table(results: SweepResults) -> Table:
    errors = {mode: size for sample in results.pose_errors for mode, size in sample.modes.items()}
    known = any(size is not None for size in errors.values())
    table = make_table(
        ">no.",
        ">lowest",
        "<at",
        ">highest",
        "<at",
        *(["<± Hz"] if known else []),
        ">poses",
        ">least MAC",
        "mode",
    )
    for number in range(results.frequencies_hz.shape[1]):
        values = results.frequencies_hz[:, number]
        least = (
            np.nanmin(results.tracked.correlation[:, number])
            if results.tracked is not None
            else np.nan
        )
        add_row(
            table,
            str(number + 1),
            *_range_cells(values, results, "{:.3f}"),
            *(
                [
                    show_bound(float(np.nanmax(values)), errors[number + 1])
                    if number + 1 in errors
                    else ""
                ]
                if known
                else []
            ),
            str(np.isfinite(values).sum()),
            f"{least:.2f}",
            results.mode_names[number],
        )
    return table


def _point_table(
    point: PointMap, results: SweepResults, errors: Mapping[str, float | None]
) -> Table:
    known = any(size is not None for size in errors.values())
    table = make_table("", ">lowest", "<at", ">highest", "<at", *(["<±"] if known else []))
    matrix = UM_PER_KN * point.compliance
    rows = {direction: matrix[:, place, place] for place, direction in enumerate("xyz")}
    rows["largest"] = UM_PER_KN * point.largest
    for name, values in rows.items():
        cells = _range_cells(values, results, "{:.4g}")
        shown = name in errors and np.isfinite(values).any()
        add_row(
            table,
            name,
            *cells,
            *(
                [show_bound(float(np.nanmax(values)), errors[name]) if shown else ""]
                if known
                else []
            ),
        )
    return table


def _range_cells(values: FloatArray, results: SweepResults, form: str) -> Sequence[str]:
    if not np.isfinite(values).any():
        return ("-", "", "-", "")
    low, high = int(np.nanargmin(values)), int(np.nanargmax(values))
    where = [describe_positions(results.sweep, number) for number in (low, high)]
    return (form.format(values[low]), where[0], form.format(values[high]), where[1])


def _print_states(results: SweepResults) -> None:
    console = make_console()
    out = sum(state == "unreachable" for state in results.states)
    if out:
        console.print(
            f"{counted(out, 'pose')} of {len(results.states)} cannot be reached by the mechanism"
        )
    for number in results.failed[:FAILED_SHOWN]:
        console.say(
            f"failed: pose {describe_positions(results.sweep, number)}: {results.errors[number]}",
            style="bold red",
        )
    if len(results.failed) > FAILED_SHOWN:
        console.print(
            f"failed: {len(results.failed) - FAILED_SHOWN} poses more, in sweep.json",
            style="bold red",
        )
