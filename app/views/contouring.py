"""Gaps, milled faces, forces and stresses along a contour."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

from headstock.app.drawings.lobes import draw_milled_faces
from headstock.app.drawings.path import draw_contour
from headstock.app.tables.probes import PROBE_MOTION_PEAKS
from headstock.app.tables.table import Column, Listing, PlainTable
from headstock.app.texts.bounded_values import NO_BOUND, show_bound, show_bounded
from headstock.app.views.view import FinishedRun, Section, TerminalPart, View
from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.answers.contouring import (
    LOCKED_MOTORS,
    ContourSummary,
    FaceSummary,
    StabilitySummary,
)
from headstock.pipeline.answers.milled_faces import MilledFaceSummary
from headstock.pipeline.numbers.estimates import CUTTING

type MilledKey = Literal[
    "location_error_um", "ra_um", "rz_um", "wt_um", "pt_um", "mark_at_start_um", "mark_at_end_um"
]

LEAST_WAVE_UM = 1e-3  # that is told of a profile


class _FaceRow(NamedTuple):
    """A face of a contour: the gap beside it, its profile and its limit of stability where it has
    them.
    """

    face: int
    at: str
    gap: FaceSummary | None
    milled: MilledFaceSummary | None
    stability: StabilitySummary | None


def _list_faces(found: ContourSummary) -> list[_FaceRow]:
    """Faces of a contour in the order of the path."""
    gaps = {face["face"]: face for face in found["faces"]}
    milled = {face["face"]: face for face in found.get("milled_faces", [])}
    stability = {face["face"]: face for face in found.get("stability", [])}
    names = {number: face["at"] for number, face in (gaps | milled).items()}
    return [
        _FaceRow(number, names[number], gaps.get(number), milled.get(number), stability.get(number))
        for number in sorted(names)
    ]


def _of_milled(key: MilledKey) -> Callable[[_FaceRow], float | None]:
    return lambda row: None if row.milled is None else row.milled[key]


def _profile_error(key: MilledKey) -> Callable[[_FaceRow], float | None]:
    return lambda row: None if row.milled is None else row.milled["errors"][key]


def _tell_wave(row: _FaceRow) -> str | None:
    if row.milled is None or row.milled["strongest_wave"]["amplitude_um"] < LEAST_WAVE_UM:
        return None
    wave = row.milled["strongest_wave"]
    return f"{wave['length_mm']:.3g} mm, {wave['amplitude_um']:.2g} µm"


def _profile(
    key: MilledKey, file: str, report: str, screen: str = "", digits: int = 3
) -> Column[_FaceRow]:
    """Return the column of a parameter of the profile of a face."""
    return Column(_of_milled(key), file, screen, report, digits=digits, error=_profile_error(key))


def _gap(
    key: Literal["outward_um", "outward_peak_to_peak_um"],
) -> tuple[Callable[[_FaceRow], float | None], Callable[[_FaceRow], float | None]]:
    """Return what reads a number of the gap beside a face, and its ±."""
    return (
        lambda row: None if row.gap is None else row.gap[key],
        lambda row: None if row.gap is None else row.gap["errors"][key],
    )


(_mean_gap, _mean_gap_error), (_gap_span, _gap_span_error) = (
    _gap("outward_um"),
    _gap("outward_peak_to_peak_um"),
)
FACE_COLUMNS: tuple[Column[_FaceRow], ...] = (
    Column(lambda row: row.face, "face", screen=">face", report="Face"),
    Column(lambda row: row.at, "at", screen="<at", report="At"),
    Column(_mean_gap, "mean gap outward [um]", ">gap", "Mean gap [µm]", error=_mean_gap_error),
    Column(
        _gap_span,
        "gap peak to peak [um]",
        ">ripple",
        "peak to peak [µm]",
        digits=3,
        error=_gap_span_error,
    ),
    Column(_mean_gap_error, "± mean gap [um]"),
    Column(_gap_span_error, "± gap peak to peak [um]"),
    Column(_profile_error("location_error_um"), "± location error [um]"),
    Column(_profile_error("ra_um"), "± Ra [um]"),
    Column(_profile_error("rz_um"), "± Rz [um]"),
    Column(_profile_error("wt_um"), "± Wt [um]"),
    _profile(
        "location_error_um", "location error [um]", "Location error [µm]", ">location", digits=4
    ),
    _profile("ra_um", "Ra [um]", "Ra [µm]", ">Ra"),  # by its name in ISO 21920
    _profile("rz_um", "Rz [um]", "Rz [µm]", ">Rz"),
    _profile("wt_um", "Wt [um]", "Wt [µm]", ">Wt"),
    _profile("pt_um", "Pt [um]", "Pt [µm]"),
    _profile("mark_at_start_um", "mark at the start [um]", "Mark at start [µm]", ">at start"),
    _profile("mark_at_end_um", "mark at the end [um]", "at end [µm]", ">at end"),
    Column(_tell_wave, "strongest wave", report="Strongest wave"),
    Column(
        lambda row: None if row.stability is None else row.stability["limit_depth_mm"],
        "limit depth of cut, motors locked [mm]",
    ),
)


def _contour_words(found: ContourSummary) -> str | None:
    """Say how the profiles were measured; None where there is none."""
    if not found.get("milled_faces"):
        return None
    face = found["milled_faces"][0]
    low, high = face["evaluated_mm"]
    by_height = [depth["location_error_um"] for depth in face["location_by_height"]]
    return (
        f"Profiles {face['height_mm']:.3g} mm above the end of the tool, ideal edges. Location error: mean, positive where material is left;"
        f" {min(by_height):.4g} to {max(by_height):.4g} µm over the depth of face {face['face']}. Ra, Rz, Wt (ISO 21920) over {high - low:.3g} mm, line"
        f" removed, Gaussian filter with a cut-off of {face['cut_off_mm']:.3g} mm. At start and end: mean line off the location error outside"
        f" that length. Cusps of a rigid machine: {face['rigid_cusp_um']:.3g} µm."
    )


def _contour_error_words(found: ContourSummary) -> str | None:
    """Where the errors of a contour come from, and what is not in them; None where nothing is said."""
    sources, left_out = found["error_sources"], "; ".join(found["error_left_out"])
    if not sources:
        return f"{NO_BOUND} : nothing is known of {left_out}." if left_out else None
    rest = f" Not in ±: {left_out}." if left_out else ""
    ways = [
        f"with {source} at the ends of their ranges" if source == CUTTING else f"without {source}"
        for source in sources
    ]
    return f"± of gaps, forces, torques and profiles: the contour once more {' and '.join(ways)}.{rest}"


def _limit_words(found: ContourSummary) -> str | None:
    """At which depth of cut chatter starts on each face; None where nobody asked."""
    faces = found.get("stability", [])
    if not faces:
        return None
    depths = ", ".join(
        f"{show_bounded(face['limit_depth_mm'], face['error_mm'])} {show_bound(face['limit_depth_mm'], face['error_mm'])} mm on face {face['face']}"
        for face in faces
    )
    return f"Chatter starts at a depth of cut of {depths}; {LOCKED_MOTORS}."


def _tabulate_profiles(face: MilledFaceSummary) -> list[PlainTable]:
    """Profile over the whole face in cells, and a short piece of it sample by sample."""
    profile, detail = face["profile"], face["detail"]
    return [
        PlainTable(
            f"profile_face_{face['face']}",
            ("along [mm]", "lowest [um]", "highest [um]", "mean line [um]"),
            tuple(
                zip(
                    profile["at_mm"],
                    profile["lowest_um"],
                    profile["highest_um"],
                    profile["waviness_um"],
                    strict=True,
                )
            ),
        ),
        PlainTable(
            f"profile_detail_face_{face['face']}",
            ("along [mm]", "height [um]"),
            tuple(zip(detail["at_mm"], detail["height_um"], strict=True)),
        ),
    ]


def _tabulate_contour(found: ContourSummary) -> PlainTable:
    """Gap, forces, torques and what probes see over time."""
    series, drives = found["series"], found["drives"]
    headings = [
        "time [s]",
        *(f"gap {d} [um]" for d in DIRECTIONS),
        *(f"force of {name} [N]" for name in drives),
    ]
    rows = [
        (time, *gap, *forces)
        for time, gap, forces in zip(
            series["time_s"], series["gap_um"], series["drive_force_n"], strict=True
        )
    ]
    if "motor_torque_nm" in series:
        headings += [f"torque of the motor of {name} [Nm]" for name in drives]
        rows = [
            (*row, *torques) for row, torques in zip(rows, series["motor_torque_nm"], strict=True)
        ]
    for name, probe in series["probes"].items():
        headings.append(f"von Mises {name} [MPa]")
        headings += [f"stress {pair} {name} [MPa]" for pair in probe["stress_mpa"]]
        headings += [f"displacement {along} {name} [um]" for along in DIRECTIONS]
        rows = [
            (*row, *own)
            for row, *own in zip(
                rows,
                probe["von_mises_mpa"],
                *probe["stress_mpa"].values(),
                *zip(*probe["displacement_um"], strict=True),
                strict=True,
            )
        ]
    return PlainTable("contour", tuple(headings), tuple(rows))


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    contour = run.summary["contouring"]
    yield _tabulate_contour(contour)
    yield from (listing.tabulate() for listing in _list_listings(run))
    for face in contour.get("milled_faces", []):
        yield from _tabulate_profiles(face)


def _list_listings(run: FinishedRun) -> Iterator[Listing[Any]]:
    contour = run.summary["contouring"]
    title = "Faces along the contour [µm]"
    yield Listing(title, FACE_COLUMNS, _list_faces(contour), "contour_faces")
    if contour["probes"]:
        title, rows = "Largest stress at probes along the contour", contour["probes"].items()
        yield Listing(title, PROBE_MOTION_PEAKS, rows, "probes_contour")


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    contour = run.summary["contouring"]
    faces, *probes = _list_listings(run)
    yield faces
    for words in (_contour_words(contour), _contour_error_words(contour), _limit_words(contour)):
        if words:
            yield f"  {words}"
            yield ""
    yield from probes


def _find_largest(rows: Iterable[Mapping[str, Sequence[float]]], *keys: str) -> float:
    """Return the largest magnitude in lists of the same unit: the scale of their roundoff."""
    return max(
        (abs(value) for row in rows for key in keys for value in row.get(key, ())), default=0.0
    )


VIEW = View(
    tables=_list_tables,
    terminal=_list_parts,
    section=Section(
        "contour",
        "Contouring",
        template="views/contouring.html",
        names={
            "columns": {"faces": FACE_COLUMNS, "probe_peaks_over_time": PROBE_MOTION_PEAKS},
            "draw_contour": draw_contour,
            "draw_milled_faces": draw_milled_faces,
            "list_faces": _list_faces,
            "contour_words": _contour_words,
            "contour_error_words": _contour_error_words,
            "largest": _find_largest,
        },
    ),
)
