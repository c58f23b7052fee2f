"""The report: one HTML file that works offline, made from a summary and from what there is to
draw.
"""

import base64
import functools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from headstock.app.drawings.figures import (
    JOINT_COLOR,
    draw_budget,
    draw_frequencies,
    draw_map,
    draw_poles,
    draw_stack,
    map_layers,
    percent,
)
from headstock.app.drawings.frf import draw_overlay, draw_probes, draw_response, has_more_fields
from headstock.app.drawings.lobes import draw_lobes
from headstock.app.drawings.milled_faces import draw_milled_faces
from headstock.app.drawings.path import draw_contour, draw_path
from headstock.app.drawings.transient import draw_path_drives, draw_transient
from headstock.app.drawings.volumetric import draw_motions, draw_volume, list_maps
from headstock.app.report.notes import judge_numbers
from headstock.app.report.viewer_data import Caption, EncodedMachine, Kind, encode_machine
from headstock.app.tables.components import COMPONENT_COLUMNS, JOINT_COLUMNS, MODEL_COLUMNS
from headstock.app.tables.contouring import (
    FACE_COLUMNS,
    contour_error_words,
    contour_words,
    list_faces,
)
from headstock.app.tables.control import DRIVE_COLUMNS, POLE_COLUMNS
from headstock.app.tables.frf import (
    DRIVE_POINT_COLUMNS,
    NUMBER_COLUMNS,
    list_channels,
    list_numbers,
    tabulate_response,
)
from headstock.app.tables.lobes import (
    LOBE_COLUMNS,
    LOWEST_LOBE_COLUMNS,
    list_lobes,
    list_lowest_lobes,
)
from headstock.app.tables.modes import ModeRow, list_modes
from headstock.app.tables.motion_forces import JOINT_FORCE_COLUMNS, MOTOR_COLUMNS
from headstock.app.tables.path import (
    CRUISE_COLUMNS,
    ZONE_COLUMNS,
    list_cruises,
    list_zones,
    path_error_words,
    path_stem,
)
from headstock.app.tables.probes import (
    PROBE_MOTION_COLUMNS,
    PROBE_MOTION_PEAKS,
    PROBE_PEAK_COLUMNS,
    PROBE_STRESS_COLUMNS,
    list_probe_peaks,
    tabulate_probes,
)
from headstock.app.tables.run import list_tables
from headstock.app.tables.static import (
    DEVIATION_COLUMNS,
    list_displacements,
    merge_families,
    shared_budget,
    static_by_pose,
    top_shares,
)
from headstock.app.tables.table import Column, drop_noise, encode_csv, find_scales, find_unit
from headstock.app.tables.transient import MOVED_COLUMNS, list_moved, transient_stem
from headstock.app.tables.volumetric import (
    LINE_COLUMNS,
    SQUARENESS_COLUMNS,
    list_lines,
    list_ranges,
    volumetric_words,
)
from headstock.app.texts.bounded_values import (
    error_words,
    largest_shares,
    limit_error_words,
    raise_digits,
    response_error_words,
    shares_begin,
    show_bound,
    show_bounded,
    show_compliances,
    show_damped,
    show_damping,
    show_damping_error,
    show_size,
    transient_words,
)
from headstock.app.texts.curves import overlaid_responses
from headstock.app.texts.remarks import fold_remarks
from headstock.geometry.frames import DIRECTIONS
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.answers.path import PathCurves
from headstock.pipeline.answers.static import PointSummary
from headstock.pipeline.answers.transient import TransientCurves
from headstock.pipeline.numbers.estimates import known_part, show_share
from headstock.pipeline.results.files import REPORT_FILE
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.summary import RunSummary
from headstock.pipeline.results.views import MachineView, component_colors
from headstock.pipeline.storage.outputs import write_output
from headstock.reduction.motions.mode_naming import WHOLE_MACHINE

if TYPE_CHECKING:
    from headstock.studies.effects_summary import EffectsSummary

TEMPLATE, STYLE, SCRIPT = "report_template.html", "report.css", "viewer/viewer.bundle.js"
CURSOR = "response_cursor.js"
SHARES_NAMED = 3
SMALLEST_NAMED = 0.02


@dataclass(frozen=True, eq=False)
class Stills:
    """Pose to a PNG of the machine, and why there is none."""

    images: Mapping[str, bytes] = field(default_factory=dict)
    remark: str | None = None


@dataclass(frozen=True, eq=False)
class Worth:
    """What effects and models of the scene are worth: content of ``effects.json``, and its chart as
    a PNG, None where there is nothing to draw.
    """

    summary: "EffectsSummary"
    chart: bytes | None


def write_report(
    folder: Path,
    summary: RunSummary,
    view: MachineView | None = None,
    stills: Stills | None = None,
    curves: Sequence[ResponseCurves] = (),
    paths: Sequence[PathCurves] = (),
    worth: Worth | None = None,
    histories: Sequence[TransientCurves] = (),
) -> Path:
    """Write ``report.html`` into a folder of results.

    Args:
        folder: Folder of results.
        summary: Content of ``summary.json``.
        view: What there is to draw; without it the report has no machine view.
        stills: Pictures of the machine, for browsers without WebGL and for paper.
        curves: Of the frequency responses.
        paths: Of the path analysis.
        worth: Of effects and models, where that is known.
        histories: Of the transient analysis.

    Raises:
        OutputError: It cannot be written.
    """
    path = folder / REPORT_FILE
    write_output(
        path, render_report(summary, view, stills, curves, paths, worth, histories).encode()
    )
    return path


def render_report(
    summary: RunSummary,
    view: MachineView | None = None,
    stills: Stills | None = None,
    curves: Sequence[ResponseCurves] = (),
    paths: Sequence[PathCurves] = (),
    worth: Worth | None = None,
    histories: Sequence[TransientCurves] = (),
) -> str:
    """The report as HTML text that refers to nothing outside itself.

    Every number from the summary stands in a ``data`` element, or an SVG text, with its unrounded
    value as an attribute.

    Args:
        summary: Content of ``summary.json``.
        view: What there is to draw; without it the report has no machine view.
        stills: Pictures of the machine, for browsers without WebGL and for paper.
        curves: Of the frequency responses.
        paths: Of the path analysis.
        worth: Of effects and models, where that is known.
        histories: Of the transient analysis.
    """
    view, stills = view or MachineView(), stills or Stills()
    colors = component_colors(view)
    static = static_by_pose(summary)
    tables = [*list_tables(summary), *map(tabulate_response, curves)]
    tables += [tabulate_probes(each) for each in curves if each.probes]
    machine = encode_machine(view, _captions(summary, view, static))
    return (
        report_environment()
        .get_template(TEMPLATE)
        .render(
            s=summary,
            static=static,
            keys=_key_figures(summary, static),
            machine=None if machine is None else Markup(machine.text),
            omissions=_omissions(machine),
            stills={
                pose: base64.b64encode(image).decode() for pose, image in stills.images.items()
            },
            still_remark=stills.remark,
            poses=list(view.poses),
            colors=colors,
            notes=judge_numbers(summary),
            downloads={
                table.name: base64.b64encode(encode_csv(table)).decode() for table in tables
            },
            paths=list(paths),
            path_stems=[path_stem(run.name) for run in paths],
            histories={history.pose: history for history in histories},
            worth=None if worth is None else worth.summary,
            chart=None if worth is None else worth.chart,
            responses={response.pose: response for response in curves},
            style=Markup(read_asset(STYLE)),
            script=Markup(read_asset(SCRIPT)),
            cursor=Markup(read_asset(CURSOR)),
        )
    )


def show_number(
    value: float | None, digits: int = 4, missing: str = "–", scale: float = 0.0
) -> Markup:
    """A number to so many significant digits, with its full value beside it for machines.

    Args:
        value: None where there is none.
        digits: Significant ones.
        missing: Shown without a value.
        scale: Size of the numbers beside it, of which it may be the roundoff.
    """
    if value is None:
        return Markup('<span class="missing">{}</span>').format(missing)
    return _data(value, format_number(drop_noise(value, scale), digits))


def _find_largest(rows: Iterable[Mapping[str, Sequence[float]]], *keys: str) -> float:
    """The largest magnitude among lists of numbers in the same unit: the scale of their roundoff."""
    return max(
        (abs(value) for row in rows for key in keys for value in row.get(key, ())), default=0.0
    )


def format_number(value: float, digits: int = 4) -> str:
    """A number for readers: thousands apart, a true minus, tiny and huge ones with a power of
    ten.
    """
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f")
    if value == 0.0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        mantissa, _, exponent = f"{value:.{digits - 2}e}".partition("e")
        return f"{mantissa}·10{raise_digits(int(exponent))}".replace("-", "−")
    whole = len(str(int(abs(value)))) if abs(value) >= 1.0 else 0
    return f"{value:,.{max(0, digits - whole)}f}".replace(",", "\u202f").replace("-", "−")


def draw_rows[Row](
    columns: Sequence[Column[Row]],
    rows: Iterable[Row],
    identity: str,
    colors: Mapping[str, str] | None = None,
) -> Markup:
    """A table of the report, of the columns that it has there and that say something.

    Args:
        columns: Of the table.
        rows: As the columns take them.
        identity: ``id`` in the page.
        colors: Name in the first column to the colour of a dot before it.
    """
    rows = list(rows)
    shown = [
        column
        for column in columns
        if column.report and (column.missing or any(column.value(row) is not None for row in rows))
    ]
    scales, body, numeric = find_scales(shown, rows), [], [False] * len(shown)
    for row in rows:
        cells = []
        for place, column in enumerate(shown):
            value = column.value(row)
            numeric[place] |= isinstance(value, int | float)
            cells.append(_row_cell(column, row, scales.get(find_unit(column), 0.0)))
        if colors is not None:
            dot = Markup('<td class="name"><span class="dot" style="background:{}"></span> {}</td>')
            cells[0] = dot.format(
                colors.get(str(shown[0].value(row)), JOINT_COLOR), shown[0].value(row)
            )
        body.append(Markup("<tr>{}</tr>\n").format(Markup("").join(cells)))
    heads = [
        Markup('<th class="number">{}</th>' if number else "<th>{}</th>").format(column.report)
        for column, number in zip(shown, numeric, strict=True)
    ]
    table = Markup(
        '<div class="scroll"><table id="{}"><thead><tr>{}</tr></thead><tbody>\n{}</tbody></table></div>'
    )
    return table.format(identity, Markup("").join(heads), Markup("").join(body))


def _row_cell[Row](column: Column[Row], row: Row, scale: float) -> Markup:
    value, error = column.value(row), None if column.error is None else column.error(row)
    if isinstance(value, str):
        return Markup("<td>{}</td>").format(value)
    if value is not None and error is not None:
        bound = Markup('<span class="soft">{}</span>').format(_bound(error, value))
        return Markup('<td class="number">{} {}</td>').format(_bounded(value, error), bound)
    if value is not None and column.show is not None:
        return Markup('<td class="number">{}</td>').format(
            _data(value, _typeset(column.show(value)))
        )
    return Markup('<td class="number">{}</td>').format(
        show_number(value, column.digits, column.missing or "–", scale)
    )


def _bounded(value: float, error: float | None) -> Markup:
    """A value to the decimal at which its error ends."""
    return _data(value, _typeset(show_bounded(value, error)))


def _bound(error: float | None, value: float | None, known: float | None = None) -> Markup:
    """An error beside its value; its number is rounded up, which its class says. Of one with unknown
    sources, what is known.
    """
    return _beside(error, show_bound(value, error, known))


def _beside(error: float | None, text: str) -> Markup:
    """What stands behind a value, as written; nothing where there is nothing to say."""
    if error is None or not math.isfinite(error) or not text:
        return Markup('<span class="missing">{}</span>').format(text)
    return Markup('± <data class="bound" value="{}">{}</data>').format(
        repr(error), _typeset(text.removeprefix("± "))
    )


def _moved(point: PointSummary, row: int, column: int) -> Markup:
    """An entry of the compliance matrix of a point, rounded with its errors."""
    matrix = point["compliance_um_per_kN"]
    value, text = (
        matrix[row][column],
        show_compliances(matrix, column, point["error_um_per_kN"])[row],
    )
    return (
        Markup('<span class="missing">{}</span>').format(text)
        if value is None
        else _data(value, _typeset(text))
    )


def _damping(mode: ModeRow) -> tuple[Markup, Markup]:
    """Damping ratio of a mode, and what stands behind it."""
    shown, bound = show_damping_error(mode.damping_ratio, mode.damping_error, rigid=mode.rigid)
    value = (
        Markup("–") if mode.damping_ratio is None else _data(mode.damping_ratio, _typeset(shown))
    )
    return value, _beside(mode.damping_error, bound)


def _damped(mode: ModeRow) -> tuple[Markup, Markup]:
    """Frequency of the damped oscillation of a mode, and what stands behind it."""
    shown, bound = show_damped(mode.damped_hz, mode.damped_error_hz, rigid=mode.rigid)
    value = (
        Markup("–")
        if mode.damped_hz is None
        else _data(mode.damped_hz, _typeset(shown) if mode.damped_hz else shown)
    )
    return value, _beside(mode.damped_error_hz, bound)


def _typeset(text: str) -> str:
    """A plain number as readers know it: thousands apart, a true minus, a power of ten."""
    mantissa, exponent, power = text.partition("e")
    whole, point, decimals = mantissa.partition(".")
    whole = re.sub(r"(?<=\d)(?=(\d{3})+$)", "\u202f", whole)
    return (
        f"{whole}{point}{decimals}{f'·10{raise_digits(int(power))}' if exponent else ''}".replace(
            "-", "−"
        )
    )


def _data(value: float, text: str) -> Markup:
    return Markup('<data value="{}">{}</data>').format(repr(value), text)


@dataclass(frozen=True)
class KeyFigures:
    """What a reader wants first.

    Attributes:
        pose: Of the first static answer; None without any.
        point: Of it.
        compliance: There, ``(3, 3)`` [um/kN].
        text: What it says about the weak link.
        first: Frequency, its error [Hz] and name of the first mode in which something deforms.
    """

    pose: str | None = None
    point: str | None = None
    compliance: list[list[float | None]] | None = None
    text: str = ""
    first: tuple[float, float | None, str] | None = None


def _key_figures(
    summary: RunSummary, static: Mapping[str, Mapping[str, PointSummary]]
) -> KeyFigures:
    """Compliance of the first point in the first pose, and the first mode in which something
    deforms.
    """
    first = None
    for modes in summary["modal"][:1]:
        named = list(
            zip(modes["frequencies_hz"], modes["error_hz"], modes["mode_names"], strict=True)
        )[modes["rigid_count"] :]
        first = next((mode for mode in named if WHOLE_MACHINE not in mode[-1]), None)
    for pose, points in static.items():
        for name, point in points.items():
            return KeyFigures(pose, name, point["compliance_um_per_kN"], point["text"], first)
    return KeyFigures(first=first)


def _omissions(machine: EncodedMachine | None) -> list[str]:
    """What the machine view leaves out so that the page stays small enough to mail."""
    found = []
    if machine is not None and machine.left_out:
        found.append(
            "To keep this page small only the first shapes of each pose move in it; modes/ beside it holds every mode, for"
            " ParaView (.vtu) and for 3D viewers (.glb)."
        )
    if machine is not None and machine.thinned:
        names = ", ".join(
            f"{name} with {format_number(drawn)} of {format_number(whole)} faces"
            for name, (drawn, whole) in machine.thinned.items()
        )
        found.append(f"Thinned out for drawing, not for computing: {names}.")
    for name, (count, why) in {} if machine is None else machine.kept_whole.items():
        found.append(f"{name} is drawn with all of its {format_number(count)} faces: {why}.")
    return found


def _captions(
    summary: RunSummary, view: MachineView, static: Mapping[str, Mapping[str, PointSummary]]
) -> dict[str, list[Caption]]:
    """Forces first, then modes in which something deforms, last those in which the machine moves as
    a whole.
    """
    captions: dict[str, list[Caption]] = {name: [] for name in view.poses}
    for name, pose in view.poses.items():
        for push in pose.pushes:
            point, _, direction = push.rpartition(" ")
            known = static.get(name, {}).get(point)
            shares = {} if known is None else known["budget"].get(direction, {})
            text = f"1 kN at {point}, static"
            captions[name].append(
                Caption(f"push:{push}", f"Force in {direction}", text, "force", shares=shares)
            )
    for modes in summary["modal"]:
        found = []
        for index, (hz, name) in enumerate(
            zip(modes["frequencies_hz"], modes["mode_names"], strict=True)
        ):
            free = index < modes["rigid_count"]
            kind: Kind = "whole" if free or WHOLE_MACHINE in name else "mode"
            lead = "0 Hz" if free else f"{format_number(hz)} Hz"
            found.append(
                Caption(
                    f"mode:{index}",
                    lead,
                    name,
                    kind,
                    0.0 if free else hz,
                    modes["energy_share"][index],
                )
            )
        captions.setdefault(modes["pose_name"], []).extend(
            sorted(found, key=lambda caption: caption.kind == "whole")
        )
    return captions


@functools.cache
def report_environment() -> jinja2.Environment:
    """Templates with the filters that show numbers."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(read_asset),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Any] = {
        "number": show_number,
        "largest": _find_largest,
        "bound": _bound,
        "known_part": known_part,
        "bounded": _bounded,
        "mode_rows": list_modes,
        "damped": _damped,
        "mode_damping": _damping,
        "damping": lambda ratio: _data(ratio, show_damping(ratio)),
        "size": lambda error: Markup('<data class="bound" value="{}">{}</data>').format(
            repr(error), _typeset(show_size(error))
        ),
        "error_words": error_words,
        "largest_shares": largest_shares,
        "shares_begin": shares_begin,
        "response_error_words": response_error_words,
        "moved": _moved,
        "shared_budget": shared_budget,
        "share": lambda share: _data(share, percent(share)),
        "top": lambda shares: top_shares(shares, SHARES_NAMED, SMALLEST_NAMED),
        "stem": file_stem,
        "position": lambda position, unit: _data(
            position, show_position(position, unit).replace("-", "−")
        ),
        "base64": lambda content: base64.b64encode(content).decode(),
        "worth": lambda share: _data(share, show_share(share)),
        "plain": lambda value: _data(value, f"{value:g}".replace("-", "−")),
        "longest": lambda budget: (
            max((share for shares in budget.values() for share in shares.values()), default=1.0)
            or 1.0
        ),
    }
    environment.filters |= filters
    environment.globals |= {
        "fold_remarks": fold_remarks,
        "draw_budget": draw_budget,
        "draw_stack": draw_stack,
        "draw_frequencies": draw_frequencies,
        "draw_response": draw_response,
        "draw_probes": draw_probes,
        "list_probe_peaks": list_probe_peaks,
        "has_more_fields": has_more_fields,
        "draw_overlay": draw_overlay,
        "overlaid_responses": overlaid_responses,
        "draw_map": draw_map,
        "map_layers": map_layers,
        "draw_motions": draw_motions,
        "draw_volume": draw_volume,
        "list_maps": list_maps,
        "list_ranges": list_ranges,
        "list_lines": list_lines,
        "merge_families": merge_families,
        "volumetric_words": volumetric_words,
        "draw_contour": draw_contour,
        "draw_milled_faces": draw_milled_faces,
        "list_faces": list_faces,
        "contour_words": contour_words,
        "contour_error_words": contour_error_words,
        "draw_poles": draw_poles,
        "draw_path": draw_path,
        "draw_transient": draw_transient,
        "draw_path_drives": draw_path_drives,
        "list_moved": list_moved,
        "transient_words": transient_words,
        "limit_error_words": limit_error_words,
        "transient_stem": transient_stem,
        "draw_rows": draw_rows,
        "list_ports": list_channels,
        "list_numbers": list_numbers,
        "list_displacements": list_displacements,
        "list_zones": list_zones,
        "path_error_words": path_error_words,
        "draw_lobes": draw_lobes,
        "list_lobes": list_lobes,
        "list_lowest_lobes": list_lowest_lobes,
        "list_cruises": list_cruises,
        "columns": {
            "components": COMPONENT_COLUMNS,
            "probe_motions": PROBE_MOTION_COLUMNS,
            "probe_stresses": PROBE_STRESS_COLUMNS,
            "probe_peaks": PROBE_PEAK_COLUMNS,
            "poles": POLE_COLUMNS,
            "drives": DRIVE_COLUMNS,
            "ports": DRIVE_POINT_COLUMNS,
            "numbers": NUMBER_COLUMNS,
            "zones": ZONE_COLUMNS,
            "moved": MOVED_COLUMNS,
            "probe_peaks_over_time": PROBE_MOTION_PEAKS,
            "motors": MOTOR_COLUMNS,
            "joint_forces": JOINT_FORCE_COLUMNS,
            "cruises": CRUISE_COLUMNS,
            "faces": FACE_COLUMNS,
            "models": MODEL_COLUMNS,
            "joints": JOINT_COLUMNS,
            "deviations": DEVIATION_COLUMNS,
            "lines": LINE_COLUMNS,
            "squareness": SQUARENESS_COLUMNS,
            "lobes": LOBE_COLUMNS,
            "lowest_lobes": LOWEST_LOBE_COLUMNS,
        },
        "enumerate": enumerate,
        "directions": DIRECTIONS,
    }
    return environment


@functools.cache
def read_asset(name: str) -> str:
    """Text of a file beside this module."""
    return resources.files("headstock.app.report").joinpath(name).read_text(encoding="utf-8")
