"""What the terminal shows: stages as they end, and a summary in tables; reads well at 100 columns and without a terminal."""

import os
import sys
from collections.abc import Sequence
from typing import Any, TextIO

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from headstock.app.terminal.summary import list_control
from headstock.app.texts.error_texts import (
    accuracy_words,
    print_error_shares,
    print_response_error,
    show_bound,
    show_bounded,
    show_compliances,
    show_damped,
    show_damping_error,
    show_digits,
    show_span,
)
from headstock.app.texts.tables import sort_shares
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.planning.plan import Plan, StageRecord
from headstock.pipeline.storage.json_texts import Json
from headstock.scene.scene import Scene

WIDTH_WITHOUT_TERMINAL = 100
CONTRIBUTORS_SHOWN = 5
SHARES_SHOWN = 3
BAR_LENGTH = 30
SMALLEST_SHARE = 0.005


class _PipedConsole(Console):
    """Lets a command end as others do when the next one in a pipe closes it, without rich's own exit."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def is_terminal(stream: TextIO) -> bool:
    """Whether somebody looks at a stream; mpirun gives every rank a terminal of its own, wherever its own output goes."""
    return stream.isatty() and "OMPI_COMM_WORLD_SIZE" not in os.environ


def make_console(*, stderr: bool = False) -> Console:
    """A console that does not colour numbers, 100 columns wide where there is no terminal."""
    terminal = is_terminal(sys.stderr if stderr else sys.stdout)
    width = None if terminal or "COLUMNS" in os.environ else WIDTH_WITHOUT_TERMINAL
    return _PipedConsole(stderr=stderr, highlight=False, width=width, emoji=False, force_terminal=terminal)


def print_header(scene: Scene, *, ranks: int) -> None:
    """Name what is run."""
    variant = f", variant {scene.variant}" if scene.variant else ""
    made_of = f"{counted(len(scene.machine.components), 'component')}, {counted(len(scene.machine.joints), 'joint')}{variant}"
    make_console().print(f"{scene.name}  ({made_of}, {counted(ranks, 'rank')})", style="bold", markup=False)


def print_stage(record: StageRecord) -> None:
    """One line per stage: what, of which component or in which pose, seconds, and what came out."""
    stage = record.stage
    subject = stage.component or stage.pose or ""
    detail = f"cached  {record.detail}" if record.cached else record.detail
    if stage.kind == "refine":
        make_console().print(f"  {stage.kind:<7} {subject:<18} {detail}", markup=False)
        return
    line = f"  {stage.kind:<7} {subject:<18} {record.seconds:8.2f} s  {detail}"
    make_console().print(line, markup=False, soft_wrap=True)


def print_plan(name: str, plan: Plan) -> None:
    """The stages of a plan with their reasons and estimates."""
    console = make_console()
    table = make_table("stage", "component", "pose", ">dofs ≈", ">MB ≈", "reason")
    for stage in plan.stages:
        dofs = "" if stage.estimated_dofs is None else spaced(stage.estimated_dofs)
        memory = "" if stage.estimated_memory_mb is None else spaced(round(stage.estimated_memory_mb))
        add_row(table, stage.kind, stage.component or "", stage.pose or "", dofs, memory, stage.reason)
    print_table(console, f"{name}: what the scene calls for", table)
    _print_warnings(console, plan.warnings)


def print_summary(summary: Json, *, seconds: float, folder: object, said: Sequence[str] = ()) -> None:
    """Everything a run found, but warnings that were said before."""
    console = make_console()
    console.print()
    print_table(console, "Components", _component_table(summary["components"]))
    for pose, points in _static_by_pose(summary).items():
        for name, point in points.items():
            _print_point(console, name, point, pose)
    for pose, probes in summary.get("probes", {}).items():
        print_table(console, f"Under the static loads in pose {pose}", _probe_table(probes))
    for modes in summary["modal"]:
        print_table(console, f"Natural modes in pose {_describe_pose(modes)}", _mode_table(modes))
        print_error_shares(console, modes)
    for pose, response in summary.get("frf", {}).items():
        print_table(console, f"Frequency response in pose {pose}", _response_table(response["ports"]))
        print_response_error(console, response)
    if "path" in summary:
        print_table(console, _path_title(summary["path"]), _path_table(summary["path"]))
    for pose, control in summary.get("control", {}).items():
        for title, headings, rows in list_control(pose, control):
            _print_rows(console, title, headings, rows)
    for words in accuracy_words(summary["accuracy"]) if "accuracy" in summary else ():
        console.print(words, markup=False)
    _print_warnings(console, [warning for warning in summary["warnings"] if warning not in said])
    for failure in summary["failures"]:
        console.print(f"failed: {failure}", style="bold red", markup=False)
    console.print(f"{summary['status']} in {seconds:.2f} s, results in {folder}", style="bold", markup=False)


def print_remarks(remarks: Sequence[str]) -> None:
    """What the user should know of how results were written."""
    _print_warnings(make_console(), remarks)


def warn_of_unused_accuracy(scene: Scene) -> None:
    """Say that a command takes meshes and modes as they are written although the scene asks for an accuracy."""
    if scene.accuracy is not None:
        asked = f"{100.0 * scene.accuracy.to:g} %"
        print_remarks([f"accuracy = {asked} is for run, study and effects; here meshes and modes are those written in the scene"])


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """A number of things in words."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def spaced(count: int) -> str:
    """A count in groups of three digits."""
    return f"{count:,}".replace(",", " ")


def _static_by_pose(summary: Json) -> dict[str, Any]:
    poses: dict[str, Any] = summary.get("static_poses", {"": summary["static"]})
    return poses


def _component_table(components: Json) -> Table:
    table = make_table("component", "fidelity", ">dofs", ">reduced", ">kg", ">modes to Hz")
    for name, facts in components.items():
        cutoff = "-" if not facts["cutoff_hz"] else f"{facts['cutoff_hz']:.0f}"
        counts = (spaced(facts["full_dofs"]), str(facts["reduced_dofs"]))
        add_row(table, name, facts["fidelity"], *counts, f"{facts['mass_kg']:.4g}", cutoff)
    return table


def _print_point(console: Console, name: str, point: Json, pose: str) -> None:
    errors = point.get("error_um_per_kN", {})
    known = any(error is not None for error in errors.values())
    table = make_table("force", *(f">moves {direction}" for direction in "xyz"), *([">± along the force"] if known else []))
    matrix = point["compliance_um_per_kN"]
    # row i of the matrix is the motion in i: a column per force is shown as a row, so that it reads from cause to effect
    for column, direction in enumerate("xyz"):
        moved = show_compliances(matrix, column, errors)
        add_row(table, direction, *moved, *([show_bound(matrix[column][column], errors.get(direction))] if known else []))
    print_table(console, f"Static compliance at {name}{f' in pose {pose}' if pose else ''} [µm/kN]", table)
    for direction, shares in shared_budget(point).items():
        _print_budget(console, direction, shares)
    if point["sentence"]:
        console.print(f"\n{point['sentence']}", markup=False)
    console.print()


def shared_budget(point: Json) -> dict[str, dict[str, float]]:
    """The budget of a point; empty where one part alone gives way, which says nothing."""
    budget: dict[str, dict[str, float]] = point["budget"]
    return budget if any(len(shares) > 1 for shares in budget.values()) else {}


def describe_position(modes: Json) -> str:
    """Where the axes stand in the pose of some modes: ``Y = 30 mm``."""
    units = modes["pose_units"]
    return ", ".join(
        f"{axis} = {show_position(position, units[axis])}" for axis, position in modes["pose"].items() if axis in units
    )


def _print_budget(console: Console, direction: str, shares: dict[str, float]) -> None:
    ordered = sort_shares(shares)
    shown = [item for item in ordered[:CONTRIBUTORS_SHOWN] if item[1] >= SMALLEST_SHARE]
    for index, (name, share) in enumerate(shown):
        head = f"budget {direction}" if index == 0 else ""
        bar = "█" * max(1, round(BAR_LENGTH * share))
        console.print(f"  {head:<9} {name:<24} {100 * share:5.1f} %  {bar}", markup=False, soft_wrap=True)
    rest = sum(share for _, share in ordered) - sum(share for _, share in shown)
    if rest >= SMALLEST_SHARE:
        console.print(f"  {'':<9} {'all others':<24} {100 * rest:5.1f} %", markup=False, soft_wrap=True)


def _describe_pose(modes: Json) -> str:
    positions = describe_position(modes)
    return str(modes["pose_name"]) + (f" ({positions})" if positions else "")


def _mode_table(modes: Json) -> Table:
    damped = any(ratio is not None for ratio in modes["damping_ratio"])
    known = any(error is not None for error in modes["error_hz"][modes["rigid_count"] :])
    spans = modes.get("interface_spread_hz", [])
    shared = any(len(shares) > 1 for shares in modes["energy_share"])
    table = make_table(
        ">no.",
        ">undamped Hz" if damped else ">Hz",
        *(["<± Hz"] if known else []),
        *([">damped Hz", "<± Hz", ">damping", "<±"] if damped else []),
        *(["<interfaces Hz"] if spans else []),
        "mode",
        *(["strain energy in"] if shared else []),
    )
    for index, (frequency, error) in enumerate(zip(modes["frequencies_hz"], modes["error_hz"], strict=True)):
        rigid = index < modes["rigid_count"]
        cells = [str(index + 1), "0" if rigid else show_bounded(frequency, error)]
        if known:
            cells.append("" if rigid else show_bound(frequency, error))
        if damped:
            cells += [*show_damped(modes, index), *show_damping_error(modes, index)]
        if spans:
            cells.append(show_span(spans[index]))
        cells.append(modes["mode_names"][index])
        add_row(table, *cells, *([_top_shares(modes["energy_share"][index])] if shared else []))
    return table


def make_table(*headings: str) -> Table:
    """A light table; a heading that starts with ``>`` is for numbers, with ``<`` for texts that are never broken."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        # headings of some tables come from scenes: a bracket in one is no markup
        whole = heading[:1] in (">", "<")
        table.add_column(
            Text(heading[whole:]), justify="right" if heading.startswith(">") else "left", no_wrap=whole, overflow="fold"
        )
    return table


def add_row(table: Table, *cells: str) -> None:
    """Add a row of plain text."""
    # names come from scenes: a bracket in one is no markup
    table.add_row(*(Text(cell) for cell in cells))


def print_table(console: Console, title: str, table: Table) -> None:
    """Print a table under a bold title; nothing in it is cut.

    Where it is wider than the console, headings and texts are broken between words; if that is not enough, the last columns of texts
    are left out, which is said, and then the table is printed wider than the console. A pipe has no edge: nothing is left out there.
    """
    edge = console.width if console.is_terminal or "COLUMNS" in os.environ else None
    columns = list(table.columns)
    while edge is not None and _is_spare(columns) and _spread_out([_least_width(column) for column in columns]) > edge:
        columns.pop()
    widths = _share_width(columns, console.width)
    fitted = Table(box=table.box, pad_edge=False)
    for index, (column, width) in enumerate(zip(columns, widths, strict=True)):
        # rich counts a padding at the edges that it then leaves out
        edges = (index == 0) + (index == len(columns) - 1)
        fitted.add_column(column.header, justify=column.justify, width=width - edges, overflow="fold")
    cells = [list(column.cells) for column in columns]
    for index, row in enumerate(table.rows):
        fitted.add_row(*(column[index] for column in cells), end_section=row.end_section)
    console.print(title, style="bold", markup=False, soft_wrap=True)
    width = console.width
    console.width = max(width, _spread_out(widths))
    console.print(fitted)
    console.width = width
    if len(columns) < len(table.columns):
        left_out = ", ".join(str(column.header) for column in table.columns[len(columns) :])
        console.print(f"  left out at {edge} columns: {left_out}", markup=False, soft_wrap=True)


def _is_spare(columns: Sequence[Column]) -> bool:
    """Whether the last column may be left out: texts, and not the only ones."""
    return not columns[-1].no_wrap and any(not column.no_wrap for column in columns[:-1])


def _spread_out(widths: Sequence[int]) -> int:
    """Width of a table: one character at each edge, three between columns."""
    return sum(widths) + 3 * len(widths) - 1


def _share_width(columns: Sequence[Column], available: int) -> list[int]:
    """Width of each column: the widest give way first, none below what its numbers or longest word need."""
    least = [_least_width(column) for column in columns]
    widths = [max(low, _natural_width(column)) for low, column in zip(least, columns, strict=True)]
    while _spread_out(widths) > available and widths != least:
        widest = max(range(len(widths)), key=lambda index: (widths[index] > least[index], widths[index]))
        widths[widest] -= 1
    return widths


def _natural_width(column: Column) -> int:
    return max(cell_len(line) for part in (column.header, *column.cells) for line in str(part).split("\n"))


def _least_width(column: Column) -> int:
    words = [*str(column.header).split(), *(word for cell in column.cells for word in _unbroken(column, str(cell)))]
    return max([column.min_width or 1, *(cell_len(word) for word in words)])


def _unbroken(column: Column, cell: str) -> list[str]:
    return cell.split("\n") if column.no_wrap else cell.split()


def _print_rows(console: Console, title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    table = make_table(*headings)
    for row in rows:
        add_row(table, *row)
    print_table(console, title, table)


def _top_shares(shares: dict[str, float]) -> str:
    ordered = sort_shares(shares)[:SHARES_SHOWN]
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in ordered if share >= SMALLEST_SHARE)


def _probe_table(probes: Json) -> Table:
    table = make_table("probe", "in", ">x µm", ">y µm", ">z µm", ">von Mises MPa", ">stress jump")
    for name, probe in probes.items():
        moved = (f"{value:.3f}" for value in probe["displacement_um"])
        add_row(table, name, probe["component"], *moved, f"{probe['von_mises_mpa']:.3f}", f"{100 * probe['stress_jump']:.1f} %")
    return table


def _response_table(ports: Sequence[Json]) -> Table:
    table = make_table(
        "force at", ">static µm/kN", ">worst Re µm/kN", ">at Hz", ">-1/(2 Re) N/µm", ">softest N/µm", ">at Hz", "near mode"
    )
    keys = ("worst_real_um_per_kN", "worst_real_hz", "chatter_stiffness_N_per_um", "softest_N_per_um", "softest_hz")
    for port in ports:
        if "static_um_per_kN" in port:
            numbers = ["free" if port["static_um_per_kN"] is None else show_digits(port["static_um_per_kN"], 4)]
            numbers += ["-" if port[key] is None else show_digits(port[key], 4) for key in keys]
            error = port.get("worst_real_error_um_per_kN")
            if error is not None and port[keys[0]] is not None:
                numbers[1] = f"{show_bounded(port[keys[0]], error)} {show_bound(port[keys[0]], error)}"
            add_row(table, " ".join(port["port"]), *numbers, port["softest_mode"])
    return table


def _path_title(path: Json) -> str:
    moved = ", ".join(axis for axis, place in path["end"].items() if place != path["start"].get(axis, 0.0))
    low_pass = "" if path["lowpass_hz"] is None else f", below {path['lowpass_hz']:g} Hz"
    return f"Deviation while {moved} moves {1e3 * path['length']:g} mm{low_pass} [µm or µrad, s]"


def _path_table(path: Json) -> Table:
    table = make_table("feed", "<at", "<zone", ">peak", ">at s", ">span", ">static", ">ringing", ">settles", ">pose kept")
    for run in path["feeds"]:
        for output in run["outputs"]:
            unit = "urad" if output["port"][1].startswith("r") else "um"
            for zone in ("accelerating", "decelerating"):
                found = output[zone]
                sizes = {key: f"{found[f'{key}_{unit}']:.4f}" for key in ("peak", "span", "quasi_static", "dynamic", "frozen_peak")}
                settling = "-" if found["settling_s"] is None else f"{found['settling_s']:.3f}"
                cells = (sizes["peak"], f"{found['peak_s']:.4f}", sizes["span"], sizes["quasi_static"], sizes["dynamic"])
                add_row(table, run["name"], " ".join(output["port"]), f"{zone[:5]}.", *cells, settling, sizes["frozen_peak"])
    return table


def _print_warnings(console: Console, warnings: Sequence[str]) -> None:
    for warning in warnings:
        console.print(f"warning: {warning}", style="yellow", markup=False)
