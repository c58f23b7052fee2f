"""What the terminal shows of a run: its plan, stages as they end, and everything that it found in
tables.
"""

from collections.abc import Iterable, Mapping, Sequence

from rich.console import Console
from rich.table import Table

from headstock.app.tables.components import COMPONENT_COLUMNS, JOINT_COLUMNS, MODEL_COLUMNS
from headstock.app.tables.contouring import (
    FACE_COLUMNS,
    contour_error_words,
    contour_words,
    limit_words,
    list_faces,
)
from headstock.app.tables.control import DRIVE_COLUMNS, POLE_COLUMNS
from headstock.app.tables.frf import (
    DRIVE_POINT_COLUMNS,
    NUMBER_COLUMNS,
    list_channels,
    list_numbers,
)
from headstock.app.tables.lobes import LOWEST_LOBE_COLUMNS, list_lowest_lobes
from headstock.app.tables.modes import list_modes
from headstock.app.tables.motion_forces import JOINT_FORCE_COLUMNS, MOTOR_COLUMNS
from headstock.app.tables.path import (
    CRUISE_COLUMNS,
    ZONE_COLUMNS,
    list_cruises,
    list_zones,
    path_error_words,
)
from headstock.app.tables.probes import (
    PROBE_COLUMNS,
    PROBE_MOTION_PEAKS,
    PROBE_PEAK_COLUMNS,
    list_probe_peaks,
)
from headstock.app.tables.static import (
    DEVIATION_COLUMNS,
    list_displacements,
    merge_families,
    shared_budget,
    sort_shares,
    static_by_pose,
    top_shares,
)
from headstock.app.tables.table import Column, drop_noise, find_scales, find_unit
from headstock.app.tables.transient import MOVED_COLUMNS, list_moved
from headstock.app.tables.volumetric import (
    LINE_COLUMNS,
    SQUARENESS_COLUMNS,
    list_lines,
    list_ranges,
    volumetric_words,
)
from headstock.app.terminal.console import (
    add_row,
    counted,
    make_console,
    make_table,
    print_assumptions,
    print_remarks,
    print_table,
    spaced,
)
from headstock.app.texts.bounded_values import (
    accuracy_words,
    error_words,
    largest_shares,
    limit_error_words,
    model_words,
    response_error_words,
    shares_begin,
    show_bound,
    show_bounded,
    show_compliances,
    show_damped,
    show_damping_error,
    show_size,
    show_span,
    transient_words,
)
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.frf import ResponseSummary
from headstock.pipeline.answers.lobes import LobesSummary
from headstock.pipeline.answers.modal import ModesSummary
from headstock.pipeline.answers.motion_forces import DriveForceSummary, JointForceSummary
from headstock.pipeline.answers.path import PathSummary
from headstock.pipeline.answers.static import PointSummary
from headstock.pipeline.answers.transient import TransientSummary
from headstock.pipeline.answers.volumetric import VolumetricSummary
from headstock.pipeline.numbers.estimates import known_part
from headstock.pipeline.planning.plan import Plan, StageRecord
from headstock.pipeline.results.summary import RunSummary
from headstock.scene.scene import Scene

CONTRIBUTORS_SHOWN = 5
SHARES_SHOWN = 3
BAR_LENGTH = 30
SMALLEST_SHARE = 0.005


def print_header(scene: Scene, *, ranks: int) -> None:
    """Name what is run."""
    variant = f", variant {scene.variant}" if scene.variant else ""
    made_of = f"{counted(len(scene.machine.components), 'component')}, {counted(len(scene.machine.joints), 'joint')}{variant}"
    make_console().print(
        f"{scene.name}  ({made_of}, {counted(ranks, 'rank')})", style="bold", markup=False
    )


def print_stage(record: StageRecord) -> None:
    """One line per stage: what, of which component or in which pose, seconds, and what came out."""
    stage = record.stage
    subject = stage.component or stage.pose or ""
    detail = f"cached  {record.detail}" if record.cached else record.detail
    if stage.kind in ("refine", "models", "joints") and stage.component:
        make_console().print(f"  {stage.kind:<7} {subject:<18} {detail}", markup=False)
        return
    line = f"  {stage.kind:<7} {subject:<18} {record.seconds:8.2f} s  {detail}"
    make_console().print(line, markup=False, soft_wrap=True)


def print_plan(name: str, plan: Plan) -> None:
    """The stages of a plan with their reasons and estimates."""
    console = make_console()
    table = make_table("stage", "component", "pose", ">dofs ≈", ">MB ≈", ">CPU s ≈", "reason")
    for stage in plan.stages:
        dofs = "" if stage.estimated_dofs is None else spaced(stage.estimated_dofs)
        memory = (
            "" if stage.estimated_memory_mb is None else spaced(round(stage.estimated_memory_mb))
        )
        seconds = "" if stage.estimated_seconds is None else f"{stage.estimated_seconds:.2g}"
        add_row(
            table,
            stage.kind,
            stage.component or "",
            stage.pose or "",
            dofs,
            memory,
            seconds,
            stage.reason,
        )
    print_table(console, f"{name}: planned stages", table)
    print_remarks(plan.warnings)


def print_summary(
    summary: RunSummary, *, seconds: float, folder: object, said: Sequence[str] = ()
) -> None:
    """Everything a run found, but warnings that were said before.

    Args:
        summary: Content of ``summary.json``.
        seconds: That the run took [s].
        folder: Where its files are.
        said: Warnings that were printed before.
    """
    console = make_console()
    console.print()
    print_table(console, "Components", tell_rows(COMPONENT_COLUMNS, summary["components"].items()))
    several = "static_poses" in summary
    for pose, points in static_by_pose(summary).items():
        for name, point in points.items():
            _print_point(console, f"{name} in pose {pose}" if several else name, point)
    for pose, probes in summary.get("probes", {}).items():
        title = f"Under the static loads in pose {pose}"
        print_table(console, title, tell_rows(PROBE_COLUMNS, probes.items()))
    for modes in summary["modal"]:
        print_table(console, f"Natural modes in pose {_describe_pose(modes)}", _mode_table(modes))
        _print_error_shares(console, modes)
    for pose, response in summary.get("frf", {}).items():
        _print_response(console, pose, response)
    if "path" in summary:
        _print_path(console, summary["path"])
    if "contouring" in summary:
        contour = summary["contouring"]
        faces = tell_rows(FACE_COLUMNS, list_faces(contour))
        print_table(console, "Faces along the contour [µm]", faces)
        told = (contour_words(contour), contour_error_words(contour), limit_words(contour))
        for words in filter(None, told):
            console.print(f"  {words}", markup=False)
            console.print()
        if contour["probes"]:
            rows = tell_rows(PROBE_MOTION_PEAKS, contour["probes"].items())
            print_table(console, "Largest stress at probes along the contour", rows)
    for pose, control in summary.get("control", {}).items():
        up_to, speed = control["up_to_hz"], 60e3 * control["speed_m_per_s"]
        poles = tell_rows(POLE_COLUMNS, enumerate(control["poles"], start=1))
        print_table(console, f"Closed-loop poles in pose {pose} up to {up_to:g} Hz", poles)
        drives = tell_rows(DRIVE_COLUMNS, control["drives"].items())
        print_table(console, f"Drives in pose {pose}, lag at {speed:g} mm/min", drives)
    for place, volume in summary.get("volumetric", {}).items():
        _print_volume(console, place, volume)
    if "lobes" in summary:
        lobes = tell_rows(LOWEST_LOBE_COLUMNS, list_lowest_lobes(summary["lobes"]))
        print_table(console, _lobes_title(summary["lobes"]), lobes)
        _print_indented(console, limit_error_words(summary["lobes"]))
    for pose, transient in summary.get("transient", {}).items():
        _print_transient(console, pose, transient)
    if "model_errors" in summary:
        bodies = tell_rows(MODEL_COLUMNS, summary["model_errors"]["bodies"].items())
        print_table(console, "Rigid and segmented bodies compared with elastic ones", bodies)
        console.print(f"  {model_words(summary['model_errors'])}", markup=False)
        console.print()
    if "interface_errors" in summary:
        joints = tell_rows(JOINT_COLUMNS, summary["interface_errors"]["joints"].items())
        print_table(console, "Rigid joints compared with deformation shapes", joints)
    if "accuracy" in summary:
        for words in accuracy_words(summary["accuracy"], summary.get("frf")):
            console.print(words, markup=False)
    print_assumptions(summary.get("assumptions", ()))
    print_remarks([warning for warning in summary["warnings"] if warning not in said])
    for failure in summary["failures"]:
        console.print(f"failed: {failure}", style="bold red", markup=False)
    console.print(
        f"{summary['status']} in {seconds:.2f} s, results in {folder}", style="bold", markup=False
    )


def _print_indented(console: Console, lines: Iterable[str]) -> None:
    for line in lines:
        console.print(f"  {line}", markup=False)


def _print_response(console: Console, pose: str, response: ResponseSummary) -> None:
    """Drive points, numbers and probes of the frequency response in a pose."""
    if driven := list_channels(response):
        rows = tell_rows(DRIVE_POINT_COLUMNS, driven)
        print_table(console, f"Frequency response in pose {pose}", rows)
    else:
        console.print(
            f"Frequency response in pose {pose}: curves in tables/ and the report", markup=False
        )
    if numbers := list_numbers(response):
        title = f"Peaks and static compliances of responses in pose {pose}"
        print_table(console, title, tell_rows(NUMBER_COLUMNS, numbers))
    _print_indented(console, response_error_words(response))
    if peaks := list_probe_peaks(response):
        title = f"Largest stress over frequency at probes in pose {pose}"
        print_table(console, title, tell_rows(PROBE_PEAK_COLUMNS, peaks))


def _print_path(console: Console, path: PathSummary) -> None:
    """Zones of every feed, what errors of guides do at constant feed, and what drives, joints and probes
    took.
    """
    print_table(console, _path_title(path), tell_rows(ZONE_COLUMNS, list_zones(path)))
    if cruises := list_cruises(path):
        title = "At constant feed, with errors of guides [µm or µrad]"
        print_table(console, title, tell_rows(CRUISE_COLUMNS, cruises))
    _print_indented(console, path_error_words(path))
    console.print()
    for feed in path["feeds"]:
        if feed["probes"]:
            title = f"Largest stress at probes at {feed['name']}"
            print_table(console, title, tell_rows(PROBE_MOTION_PEAKS, feed["probes"].items()))
        _print_forces(console, f"at {feed['name']}", feed["drives"], feed["joints"])


def _print_transient(console: Console, pose: str, transient: TransientSummary) -> None:
    """Motion under loads over time in a pose, and what drives, joints and probes took."""
    print_table(
        console,
        f"Motion in {1e3 * transient['duration_s']:g} ms in pose {pose}, {transient['modes']} modes up to {transient['up_to_hz']:g} Hz"
        f"{', drives under control' if transient['motors'] == 'controlled' else ''}",
        tell_rows(MOVED_COLUMNS, list_moved(transient)),
    )
    _print_indented(console, transient_words(transient))
    if transient["probes"]:
        title = f"Largest stress over time at probes in pose {pose}"
        print_table(console, title, tell_rows(PROBE_MOTION_PEAKS, transient["probes"].items()))
    _print_forces(console, f"in pose {pose}", transient["drives"], transient["joints"])


def _print_forces(
    console: Console,
    where: str,
    drives: Mapping[str, DriveForceSummary],
    joints: Mapping[str, Mapping[str, JointForceSummary]],
) -> None:
    """What drives and joints took at most."""
    if drives:
        print_table(console, f"Motors {where}", tell_rows(MOTOR_COLUMNS, drives.items()))
    if joints:
        title = f"Largest forces of joints {where}"
        print_table(console, title, tell_rows(JOINT_FORCE_COLUMNS, joints.items()))


def tell_rows[Row](columns: Sequence[Column[Row]], rows: Iterable[Row]) -> Table:
    """A table on the screen, of the columns that it has there."""
    shown = [column for column in columns if column.screen]
    table, rows = make_table(*(column.screen for column in shown)), list(rows)
    scales = find_scales(shown, rows)
    for row in rows:
        add_row(
            table, *(_tell(column, row, scales.get(find_unit(column), 0.0)) for column in shown)
        )
    return table


def _tell[Row](column: Column[Row], row: Row, scale: float) -> str:
    value, error = column.value(row), None if column.error is None else column.error(row)
    if isinstance(value, str):
        return value
    if value is None:
        return column.missing or "-"
    if error is not None:
        return f"{show_bounded(value, error)} {show_bound(value, error)}"
    if column.show is not None:
        return column.show(value)
    if isinstance(value, int):
        return spaced(value)
    return f"{drop_noise(value, scale):.{column.digits}g}"


def _print_point(console: Console, place: str, point: PointSummary) -> None:
    errors = point.get("error_um_per_kN", {})
    parts = {name: known_part(each) for name, each in point.get("error_share", {}).items()}
    known = any(error is not None for error in (*errors.values(), *parts.values()))
    table = make_table(
        "force",
        *(f">moves {direction}" for direction in "xyz"),
        *([">± along the force"] if known else []),
    )
    matrix = point["compliance_um_per_kN"]
    # row i of the matrix is the motion in i: a column per force is shown as a row, so that it reads
    # from cause to effect
    for column, direction in enumerate("xyz"):
        moved = show_compliances(matrix, column, errors)
        add_row(
            table,
            direction,
            *moved,
            *(
                [show_bound(matrix[column][column], errors.get(direction), parts.get(direction))]
                if known
                else []
            ),
        )
    print_table(console, f"Static compliance at {place} [µm/kN]", table)
    for direction, shares in shared_budget(point).items():
        _print_budget(console, direction, shares)
    if point["text"]:
        console.print(f"\n{point['text']}", markup=False)
    console.print()
    if rows := list_displacements(point):
        print_table(
            console,
            f"Displacement of {place} under the static loads",
            tell_rows(DEVIATION_COLUMNS, rows),
        )


def _print_volume(console: Console, point: str, volume: VolumetricSummary) -> None:
    print_table(
        console,
        f"Position error of {point} over {' × '.join(volume['axes'])}: range by source",
        tell_rows(DEVIATION_COLUMNS, list_ranges(volume)),
    )
    _print_indented(console, volumetric_words(volume))
    console.print()
    title = "Error motions along each axis: straightness, positioning, angles"
    print_table(console, title, tell_rows(LINE_COLUMNS, list_lines(volume)))
    if volume["squareness"]:
        print_table(console, "Squareness", tell_rows(SQUARENESS_COLUMNS, volume["squareness"]))
    for direction, shares in volume["budget"].items():
        _print_budget(console, direction, merge_families(shares))
    console.print()


def _print_budget(console: Console, direction: str, shares: dict[str, float]) -> None:
    ordered = sort_shares(shares)
    shown = [item for item in ordered[:CONTRIBUTORS_SHOWN] if item[1] >= SMALLEST_SHARE]
    for index, (name, share) in enumerate(shown):
        head = f"budget {direction}" if index == 0 else ""
        bar = "█" * max(1, round(BAR_LENGTH * share))
        console.print(
            f"  {head:<9} {name:<24} {100 * share:5.1f} %  {bar}", markup=False, soft_wrap=True
        )
    rest = sum(share for _, share in ordered) - sum(share for _, share in shown)
    if abs(rest) >= SMALLEST_SHARE:
        console.print(
            f"  {'':<9} {'all others':<24} {100 * rest:5.1f} %", markup=False, soft_wrap=True
        )


def describe_position(modes: ModesSummary) -> str:
    """Where the axes stand in the pose of some modes: ``Y = 30 mm``."""
    units = modes["pose_units"]
    return ", ".join(
        f"{axis} = {show_position(position, units[axis])}"
        for axis, position in modes["pose"].items()
        if axis in units
    )


def _describe_pose(modes: ModesSummary) -> str:
    positions = describe_position(modes)
    return modes["pose_name"] + (f" ({positions})" if positions else "")


def _mode_table(modes: ModesSummary) -> Table:
    rows = list_modes(modes)
    damped = any(row.damping_ratio is not None for row in rows)
    known = any(
        row.error_hz is not None or row.known_hz is not None for row in rows if not row.rigid
    )
    spans = bool(modes.get("interface_spread_hz"))
    shared = any(len(row.energy_share) > 1 for row in rows)
    table = make_table(
        ">no.",
        ">undamped Hz" if damped else ">Hz",
        *(["<± Hz"] if known else []),
        *([">damped Hz", "<± Hz", ">damping", "<±"] if damped else []),
        *(["<interfaces Hz"] if spans else []),
        "mode",
        *(["strain energy in"] if shared else []),
    )
    for row in rows:
        cells = [str(row.number), "0" if row.rigid else show_bounded(row.hz, row.error_hz)]
        if known:
            cells.append("" if row.rigid else show_bound(row.hz, row.error_hz, row.known_hz))
        if damped:
            cells += show_damped(row.damped_hz, row.damped_error_hz, rigid=row.rigid)
            cells += show_damping_error(row.damping_ratio, row.damping_error, rigid=row.rigid)
        if spans:
            cells.append(show_span(row.spread_hz))
        cells.append(row.name)
        if shared:
            top = top_shares(merge_families(row.energy_share), SHARES_SHOWN, SMALLEST_SHARE)
            cells.append(", ".join(f"{name} {100 * share:.0f} %" for name, share in top))
        add_row(table, *cells)
    return table


def _print_error_shares(console: Console, modes: ModesSummary) -> None:
    """Where the errors of a pose's frequencies come from."""
    found = ", ".join(
        f"{source} up to {show_size(size)} Hz" for source, size in largest_shares(modes).items()
    )
    for words in [f"{shares_begin(modes)} {found}"] * bool(found) + error_words(modes):
        console.print(f"  {words}", markup=False)
    console.print()


def _lobes_title(lobes: Mapping[str, LobesSummary]) -> str:
    first = next(iter(lobes.values()))
    return (
        f"Limit depth of cut in {first['material']}, {first['teeth']} teeth on {first['diameter_mm']:g} mm,"
        f" {first['radial_depth_mm']:g} mm wide"
    )


def _path_title(path: PathSummary) -> str:
    moved = ", ".join(
        axis for axis, place in path["end"].items() if place != path["start"].get(axis, 0.0)
    )
    low_pass = "" if path["lowpass_hz"] is None else f", below {path['lowpass_hz']:g} Hz"
    return f"Deviation while {moved} moves {show_position(path['length'], path['unit'])}{low_pass} [µm or µrad, s]"
