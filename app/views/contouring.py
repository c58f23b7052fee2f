"""Gaps, milled faces, forces and stresses along a contour."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from headstock.app.drawings.lobes import draw_milled_faces
from headstock.app.drawings.path import draw_contour
from headstock.app.tables.probes import (
    PROBE_MOTION_PEAKS,
    list_moved,
    list_trace_columns,
)
from headstock.app.tables.table import (
    Column,
    Listing,
    NumbersRow,
    PlainTable,
    number_column,
    tabulate_curves,
)
from headstock.app.texts.bounded_values import NO_BOUND, show_bound, show_bounded
from headstock.app.views.view import Section, TerminalPart, View
from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.answers.contouring import (
    LOCKED_MOTORS,
    UM,
    ContourAnswer,
    ContourFace,
    FaceStability,
)
from headstock.pipeline.answers.milled_faces import MM, MilledFace
from headstock.pipeline.numbers.estimates import CUTTING, scale_total
from headstock.pipeline.numbers.numbers import make_key
from headstock.pipeline.results.results import Results

LEAST_WAVE_UM = 1e-3  # of a profile that is mentioned


@dataclass(frozen=True, eq=False)
class _FaceRow(NumbersRow):
    """A face of a contour, with its gap and its profile where it has them."""

    face: int
    at: str
    gap: ContourFace | None
    milled: MilledFace | None


def _list_faces(found: ContourAnswer) -> list[_FaceRow]:
    """Faces of a contour in the order of the path."""
    numbers = found.index_numbers()
    gaps = {face.number: face for face in found.faces}
    milled = {face.number: face for face in found.milled}
    names = {number: face.at for number, face in (gaps | milled).items()}
    return [
        _FaceRow(numbers, {"face": face}, face, names[face], gaps.get(face), milled.get(face))
        for face in sorted(names)
    ]


def _describe_wave(row: _FaceRow) -> str | None:
    found = None if row.milled is None else row.milled.parameters
    if found is None or UM * found.wave < LEAST_WAVE_UM:
        return None
    return f"{MM * found.wavelength:.3g} mm, {UM * found.wave:.2g} µm"


def _error_column(kind: str, figure: str, heading: str) -> Column[_FaceRow]:
    return Column(lambda row: row.error(kind, figure=figure), heading)


def _profile(
    figure: str, file: str, report: str, screen: str = "", digits: int = 3
) -> Column[_FaceRow]:
    """Return the column of a parameter of the profile of a face."""
    return number_column("profile", file, screen, report, digits=digits, figure=figure)


GAP = "outward_gap"
FACE_COLUMNS: tuple[Column[_FaceRow], ...] = (
    Column(lambda row: row.face, "face", screen=">face", report="Face"),
    Column(lambda row: row.at, "at", screen="<at", report="At"),
    number_column(GAP, "mean gap outward [um]", ">gap", "Mean gap [µm]", figure="mean"),
    number_column(
        GAP, "gap peak to peak [um]", ">ripple", "peak to peak [µm]", digits=3, figure="span"
    ),
    _error_column(GAP, "mean", "± mean gap [um]"),
    _error_column(GAP, "span", "± gap peak to peak [um]"),
    _error_column("profile", "location_error", "± location error [um]"),
    _error_column("profile", "ra", "± Ra [um]"),
    _error_column("profile", "rz", "± Rz [um]"),
    _error_column("profile", "wt", "± Wt [um]"),
    _profile("location_error", "location error [um]", "Location error [µm]", ">location", digits=4),
    _profile("ra", "Ra [um]", "Ra [µm]", ">Ra"),  # by its name in ISO 21920
    _profile("rz", "Rz [um]", "Rz [µm]", ">Rz"),
    _profile("wt", "Wt [um]", "Wt [µm]", ">Wt"),
    _profile("pt", "Pt [um]", "Pt [µm]"),
    _profile("mark_at_start", "mark at the start [um]", "Mark at start [µm]", ">at start"),
    _profile("mark_at_end", "mark at the end [um]", "at end [µm]", ">at end"),
    Column(_describe_wave, "strongest wave", report="Strongest wave"),
    Column(lambda row: row.value("limit_depth"), "limit depth of cut, motors locked [mm]"),
)


_NAME: Column[_FaceRow] = Column(lambda row: f"{row.face}, {row.at}", report="Face")
STABILITY_COLUMNS: tuple[Column[FaceStability], ...] = (
    Column(lambda face: f"{face.number}, {face.at}", report="Face"),
    Column(lambda face: face.multiplier, report="largest multiplier", digits=5),
    Column(
        lambda face: 1e3 * face.limit_depth,
        report="depth of cut where chatter starts, motors locked [mm]",
        digits=3,
    ),
    Column(lambda face: "stable" if face.stable else "unstable", report="the cut is"),
)


def _list_gap_columns() -> list[Column[_FaceRow]]:
    return [_NAME] + [
        number_column(
            "contour_gap", heading, report=heading, digits=3, figure=figure, direction=direction
        )
        for figure, words in (("mean", "mean"), ("span", "peak to peak"))
        for direction in DIRECTIONS
        for heading in [f"{words} {direction} [µm]"]
    ]


def _list_drive_columns(found: ContourAnswer) -> list[Column[_FaceRow]]:
    return [_NAME] + [
        number_column(kind, heading, report=heading, digits=digits, figure=figure, drive=drive)
        for kind, words, unit in (("drive_force", "", "N"), ("drive_torque", "motor of ", "N m"))
        for drive in found.drives
        for figure, digits, heading in (
            ("mean", 4, f"{words}{drive} [{unit}]"),
            ("span", 3, f"peak to peak [{unit}]"),
        )
    ]


def _contour_words(found: ContourAnswer) -> str | None:
    """Say how the profiles were measured; None where there is none."""
    if not found.milled:
        return None
    face = found.milled[0]
    low, high = (MM * end for end in face.evaluated)
    by_height = [UM * location for _, location in face.by_height]
    return (
        f"Profiles {MM * face.height:.3g} mm above the end of the tool, ideal edges. Location error: mean, positive where material is left;"
        f" {min(by_height):.4g} to {max(by_height):.4g} µm over the depth of face {face.number}. Ra, Rz, Wt (ISO 21920) over {high - low:.3g} mm, line"
        f" removed, Gaussian filter with a cut-off of {MM * face.cut_off:.3g} mm. At start and end: mean line off the location error outside"
        f" that length. Cusps of a rigid machine: {UM * face.cusp:.3g} µm."
    )


def _contour_error_words(found: ContourAnswer) -> str | None:
    """Where the errors of a contour come from, and what is not in them; None where nothing is said."""
    left_out = "; ".join(found.left_out)
    if not found.sources:
        return f"{NO_BOUND} : nothing is known of {left_out}." if left_out else None
    rest = f" Not in ±: {left_out}." if left_out else ""
    ways = [
        f"with {source} at the ends of their ranges" if source == CUTTING else f"without {source}"
        for source in found.sources
    ]
    return f"± of gaps, forces, torques and profiles: the contour once more {' and '.join(ways)}.{rest}"


def _limit_words(found: ContourAnswer) -> str | None:
    """At which depth of cut chatter starts on each face; None where nobody asked."""
    depths = []
    for face in found.stability:
        limit = 1e3 * face.limit_depth
        error = scale_total(found.errors.get(make_key("limit_depth", face=face.number)), 1e3)
        shown = f"{show_bounded(limit, error)} {show_bound(limit, error)}"
        depths.append(f"{shown} mm on face {face.number}")
    words = f"Chatter starts at a depth of cut of {', '.join(depths)}; {LOCKED_MOTORS}."
    return words if depths else None


def _tabulate_profiles(face: MilledFace) -> list[PlainTable]:
    """Profile over the whole face in cells, and a short piece of it sample by sample."""
    return [
        tabulate_curves(
            f"profile_face_{face.number}",
            [
                ("along [mm]", MM * face.places),
                ("lowest [um]", UM * face.lowest),
                ("highest [um]", UM * face.highest),
                ("mean line [um]", UM * face.waviness),
            ],
        ),
        tabulate_curves(
            f"profile_detail_face_{face.number}",
            [("along [mm]", MM * face.detail_places), ("height [um]", UM * face.detail)],
        ),
    ]


def _tabulate_contour(found: ContourAnswer) -> PlainTable:
    """Gap, forces, torques and what probes see over time."""
    columns = [
        ("time [s]", found.times),
        *((f"gap {d} [um]", UM * found.gap[:, place]) for place, d in enumerate(DIRECTIONS)),
    ]
    for values, heading in (
        (found.drive_forces, "force of {} [N]"),
        (found.torques, "torque of the motor of {} [Nm]"),
    ):
        if values is not None:
            columns += [
                (heading.format(name), values[:, place]) for place, name in enumerate(found.drives)
            ]
    for probe in found.probes.values():
        columns += list_trace_columns(probe.trace)
    return tabulate_curves("contour", columns)


def _list_tables(run: Results) -> Iterator[PlainTable]:
    contour = run.find(ContourAnswer)[-1]
    yield _tabulate_contour(contour)
    yield from (listing.tabulate() for listing in _list_listings(contour))
    for face in contour.milled:
        yield from _tabulate_profiles(face)


def _list_listings(contour: ContourAnswer) -> Iterator[Listing[Any]]:
    title = "Faces along the contour [µm]"
    yield Listing(title, FACE_COLUMNS, _list_faces(contour), "contour_faces")
    if contour.probes:
        title, rows = (
            "Largest stress at probes along the contour",
            list_moved(contour, contour.probes, "probe"),
        )
        yield Listing(title, PROBE_MOTION_PEAKS, rows, "probes_contour")


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    contour = run.find(ContourAnswer)[-1]
    faces, *probes = _list_listings(contour)
    yield faces
    for words in (_contour_words(contour), _contour_error_words(contour), _limit_words(contour)):
        if words:
            yield f"  {words}"
            yield ""
    yield from probes


def _write_section(run: Results) -> Section:
    contour = run.find(ContourAnswer)[-1]
    rows = _list_faces(contour)
    names = {
        "contour": contour,
        "columns": {
            "faces": FACE_COLUMNS,
            "gaps": _list_gap_columns(),
            "drives": _list_drive_columns(contour),
            "stability": STABILITY_COLUMNS,
            "probes": PROBE_MOTION_PEAKS,
        },
        "rows": rows,
        "gap_rows": [row for row in rows if row.gap is not None],
        "probes": list_moved(contour, contour.probes, "probe"),
        "draw_contour": draw_contour,
        "draw_milled_faces": draw_milled_faces,
        "contour_words": _contour_words(contour),
        "error_words": _contour_error_words(contour),
        "deflection": [
            float(UM * values[0])
            for values in (contour.least_gravity_deflection, contour.most_gravity_deflection)
        ],
        "largest_deflection": float(abs(UM * contour.most_gravity_deflection).max()),
    }
    return Section("contour", "Contouring", template="views/contouring.html", names=names)


VIEW = View(tables=_list_tables, terminal=_list_parts, section=_write_section)
