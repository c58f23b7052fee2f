"""What the terminal shows of a sweep: what is swept, ranges of every quantity, crossings, poses that failed."""

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from headstock.app.console import add_row, counted, make_console, make_table, print_remarks, print_table
from headstock.geometry.frames import FloatArray
from headstock.pipeline.json_texts import Json
from headstock.pipeline.sweep_poses import describe_positions, moving_axes
from headstock.pipeline.sweep_results import SweepResults
from headstock.pipeline.sweep_runs import SweepJob

FAILED_SHOWN = 20


def print_sweep_header(job: SweepJob, *, ranks: int) -> None:
    """Name what is swept."""
    sweep = job.sweep
    moving = moving_axes(sweep) if sweep.kind == "grid" else []
    sizes = " × ".join(str(sweep.shape[column]) for column in moving)
    variant = f", variant {job.scene.variant}" if job.scene.variant else ""
    poses = counted(len(sweep.positions), "pose")
    poses += f", {sizes} over {' and '.join(sweep.axes[column] for column in moving)}" if moving else ""
    make_console().print(
        f"{job.scene.name}: sweep {sweep.name}  ({poses}{variant}, {counted(ranks, 'rank')})", style="bold", markup=False
    )


def print_sweep(summary: Json, results: SweepResults, *, computed: int, seconds: float, folder: object) -> None:
    """Ranges of every quantity and where they lie."""
    console = make_console()
    console.print()
    if results.frequencies_hz.shape[1]:
        print_table(console, "Natural modes, followed from pose to pose [Hz]", _mode_table(summary, results))
    for crossing in summary["crossings"]:
        one, other = crossing["modes"]
        console.print(
            f"modes {one} and {other} cross between {counted(crossing['between_neighbours'], 'pair')} of neighbouring poses"
        )
    for name, point in summary["static"].items():
        print_table(console, f"Static compliance at {name} [µm/kN]", _point_table(point, results))
    _print_states(results)
    print_remarks(results.warnings)
    console.print(
        f"{summary['status']} in {seconds:.2f} s, {_describe_poses(len(results.states), computed)}, results in {folder}",
        style="bold",
        markup=False,
    )


def _describe_poses(total: int, computed: int) -> str:
    """How many poses this call computed, and how many it found: those of earlier calls, or of the tasks of a cluster."""
    if computed == total:
        return f"{counted(total, 'pose')} computed"
    found = f"{counted(total - computed, 'finished pose')} collected"
    return f"{counted(computed, 'pose')} computed, {found}" if computed else found


def _mode_table(summary: Json, results: SweepResults) -> Table:
    table = make_table(">no.", ">lowest", "<at", ">highest", "<at", ">poses", ">least MAC", "mode")
    for number in range(results.frequencies_hz.shape[1]):
        values = results.frequencies_hz[:, number]
        least = np.nanmin(results.tracked.correlation[:, number]) if results.tracked is not None else np.nan
        add_row(
            table,
            str(number + 1),
            *_range_cells(values, results, "{:.3f}"),
            str(np.isfinite(values).sum()),
            f"{least:.2f}",
            results.mode_names[number],
        )
    return table


def _point_table(point: Json, results: SweepResults) -> Table:
    table = make_table("", ">lowest", "<at", ">highest", "<at")
    matrix = np.array(point["compliance_um_per_kN"], dtype=float)
    rows = {direction: matrix[:, place, place] for place, direction in enumerate("xyz")}
    rows["largest"] = np.array(point["largest_um_per_kN"], dtype=float)
    for name, values in rows.items():
        add_row(table, name, *_range_cells(values, results, "{:.4g}"))
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
        console.print(f"{counted(out, 'pose')} of {len(results.states)} cannot be taken by the mechanism")
    for number in results.failed[:FAILED_SHOWN]:
        console.print(
            f"failed: pose {describe_positions(results.sweep, number)}: {results.errors[number]}", style="bold red", markup=False
        )
    if len(results.failed) > FAILED_SHOWN:
        console.print(f"failed: {len(results.failed) - FAILED_SHOWN} poses more, in sweep.json", style="bold red")
