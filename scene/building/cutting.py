"""Mills and cutting coefficients, built from the tables of what cuts: lobes, paths, contours."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Protocol

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.scene.building.draft import Draft
from headstock.scene.expansion.catalogue import read_cutting_materials
from headstock.scene.reading.findings import Findings, KeyPath, suggest_names
from headstock.scene.schema.cutting import (
    TYPICAL_RANGES,
    TYPICAL_RATIOS,
    CuttingTable,
    MillTable,
    ToolModeTable,
)
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.milling.coefficients import (
    CuttingCoefficients,
    build_coefficients,
    mean_chip_thickness,
)
from headstock.solvers.milling.forces import EndMill, MillingCut, Sense, Side, clockwise_side
from headstock.solvers.milling.tool_dynamics import ToolMode, across_axis

SECTION = "cutting"
# outside a number is likely a slip of units [SI]
PLAUSIBLE = {
    "kc11": (200e6, 6000e6, "N/mm^2", 1e-6),
    "Ktc": (50e6, 10000e6, "N/mm^2", 1e-6),
    "mc": (0.05, 0.5, "", 1.0),
    "Kte": (0.0, 200e3, "N/mm", 1e-3),
    "chip_thickness": (1e-6, 1e-3, "mm", 1e3),
}
MOST_LEAD = 45.0  # between the travel and the plane across the tool [deg]
MOST_ACROSS = 1.5  # of the tangential force
THIN, THICK = 1e-6, 2e-3  # feed per tooth [m]

CUTTING_FORCE = "cutting_force"


class _CutTable(Protocol):
    """The table of what cuts: depth of cut across the tool [m], and the side of the part if it is
    written.
    """

    mill: MillTable
    radial_depth: float
    sense: Sense
    part_side: Side | None

    @property
    def material(self) -> str | None:
        """Name of the work material."""


class _MilledTable(_CutTable, Protocol):
    """The table of a cut at one speed of the spindle [rad/s], with its depth along the tool [m]."""

    spindle: float
    axial_depth: float


@dataclass(frozen=True)
class _Chips:
    """How thick chips are.

    Attributes:
        thickness: [m].
        share: Half width of its range over it.
        how: It was chosen, in words.
    """

    thickness: float
    share: float
    how: str


USUAL_CHIPS = _Chips(1e-4, 0.5, "assumed, as no feed per tooth is known")


def build_mill(table: MillTable) -> EndMill:
    """The tool."""
    return table.fill(EndMill)


def part_side(table: _CutTable) -> Side:
    """Return where the part lies: as written, or where a clockwise tool mills in this sense."""
    return table.part_side or clockwise_side(table.sense)


def build_tool_mode(table: ToolModeTable, up: tuple[float, float, float]) -> ToolMode:
    """A mode in its direction, or in both across the tool.

    Args:
        up: Direction along the tool.
    """
    if table.direction is None:
        directions = across_axis(np.array(up))
    else:
        along = np.array(table.direction)
        directions = (along / np.linalg.norm(along))[:, None]
    return ToolMode(table.name, table.frequency, table.damping, table.stiffness, directions)


def build_cut(scene: SceneTable, table: _MilledTable, feeds: Sequence[float]) -> MillingCut:
    """Tool, material and engagement of a path or a contour; without a material (forces are measured,
    or there are none) coefficients are zero.

    Args:
        feeds: Per tooth [m].
    """
    coefficients = CuttingCoefficients((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "")
    if table.material is not None:
        coefficients = resolve_material(scene, table.material, table, feeds)
    return MillingCut(
        build_mill(table.mill),
        coefficients,
        table.spindle,
        table.axial_depth,
        table.radial_depth,
        sense=table.sense,
    )


def tooth_period(table: _MilledTable) -> float:
    """Return the time between two teeth [s]."""
    return 2.0 * math.pi / (table.spindle * table.mill.teeth)


def resolve_material(
    scene: SceneTable, name: str, table: _CutTable, feeds: Sequence[float]
) -> CuttingCoefficients:
    """The coefficients of a material in a cut: of the scene, else of the catalogue.

    Args:
        feeds: Per tooth [m]; none where they are not known.
    """
    written = scene.cutting.get(name)
    if written is None:
        return catalogue_coefficients(name, _find_chips(table, feeds))
    source = written.source or f"[{SECTION}.{name}] of the scene"
    return _fill_in(written, name, source, _find_chips(table, feeds))


def catalogue_coefficients(name: str, chips: _Chips | None = None) -> CuttingCoefficients:
    """The coefficients of a material of the catalogue.

    Args:
        chips: How thick they are, for Kienzle's force; of usual thickness where that is not known.
    """
    material = read_cutting_materials()[name]
    return _fill_in(material.table, name, material.source, chips or USUAL_CHIPS)


def _fill_in(table: CuttingTable, name: str, source: str, chips: _Chips) -> CuttingCoefficients:
    """With typical ratios and the thickness of chips where these are left out."""
    values = table.values
    ranges: dict[str, float] = {str(key): share for key, share in table.ranges.items()}
    for ratio, across in (("radial_ratio", "Krc"), ("axial_ratio", "Kac")):
        if ratio not in values and across not in values:
            values[ratio], ranges[ratio] = TYPICAL_RATIOS[ratio], TYPICAL_RANGES[ratio]
    how = "as written"
    if "kc11" in values and "chip_thickness" not in values:
        values["chip_thickness"], ranges["chip_thickness"], how = astuple(chips)
    return build_coefficients(values, ranges, name=name, source=source, thickness_from=how)


def _find_chips(table: _CutTable, feeds: Sequence[float]) -> _Chips:
    """Mean thickness of the chips of a cut; of several feeds in the middle of them."""
    if not feeds:
        return USUAL_CHIPS
    low, high = min(feeds), max(feeds)
    feed, immersion = 0.5 * (low + high), table.radial_depth / table.mill.diameter
    feeds_mm = f"{1e3 * feed:.3g}" if low == high else f"{1e3 * low:.3g} to {1e3 * high:.3g}"
    return _Chips(
        mean_chip_thickness(feed, min(immersion, 1.0)),
        (high - low) / (high + low),
        f"mean of a chip at {feeds_mm} mm per tooth and {100.0 * immersion:.3g} % immersion",
    )


def find_lead_fault(up: FloatArray, travel: FloatArray) -> str:
    """Say why a tool cannot mill along a travel; empty where it can.

    Args:
        up: ``(3,)`` along the tool.
        travel: ``(3,)``.
    """
    along = abs(float(up @ travel)) / float(np.linalg.norm(up) * np.linalg.norm(travel))
    lead = math.degrees(math.asin(min(along, 1.0)))
    if lead <= MOST_LEAD:
        return ""
    return f"at a lead angle of {lead:.3g} deg; a mill travels across its axis, up to {MOST_LEAD:g} deg"


def check_cutting(draft: Draft) -> None:
    """Warn of coefficients that no material has."""
    for name, table in draft.table.cutting.items():
        _check_coefficients((SECTION, name), table, draft.findings)


def check_cutter(
    key: KeyPath,
    table: _CutTable,
    feeds: Sequence[float],
    draft: Draft,
    *,
    always: bool = False,
) -> None:
    """Report a material that does not exist and a cut that no tool can make; note what is assumed of
    the material, and warn of chips of unusual thickness.

    Args:
        feeds: Per tooth [m]; none where they are not known.
        always: It cuts without the effect ``cutting_force`` too.
    """
    scene, material = draft.table, table.material
    written = draft.sections.get(SECTION, frozenset())
    if table.radial_depth > table.mill.diameter:
        draft.add(
            (*key, "radial_depth"),
            f"is {1e3 * table.radial_depth:g} mm and the tool has {1e3 * table.mill.diameter:g} mm; take at most its diameter",
        )
        return
    if material is None or (material in written and material not in scene.cutting):
        return  # what is wrong with its own entry is said there
    if material not in scene.cutting and material not in read_cutting_materials():
        names = [*sorted(written), *read_cutting_materials()]
        hint = suggest_names(material, names, what="materials")
        example = material if material.isidentifier() else "NAME"
        draft.add(
            (*key, "material"),
            f'there is no {material[:80]!r}; {hint}; or write [{SECTION}.{example}] with Ktc = "800 N/mm^2" and so on',
        )
        return
    coefficients = resolve_material(scene, material, table, feeds)
    entry = scene.cutting.get(material)
    cuts = always or CUTTING_FORCE in scene.active
    # what was measured is not assumed, and what a scene writes is known; a tangent is told anyway
    assumed = coefficients.ranges if entry is None else set(coefficients.ranges) - set(entry.ranges)
    if cuts and (assumed or coefficients.chip_thickness is not None):
        given = f"[{SECTION}.{material}]" if entry is not None else f"catalogue {material}"
        draft.findings.assume((*key, "material"), f"{given}: {coefficients.describe()}")
    for feed in feeds:
        if not THIN <= feed <= THICK:
            draft.findings.warn(
                key,
                f"the feed per tooth is {1e3 * feed:.3g} mm, outside {1e3 * THIN:g} to {1e3 * THICK:g} mm; check feed, spindle and teeth",
            )


def _check_coefficients(key: KeyPath, table: CuttingTable, findings: Findings) -> None:
    values = table.values
    for name, (low, high, unit, factor) in PLAUSIBLE.items():
        value = values.get(name)
        if value is not None and not low <= value <= high:
            findings.warn(
                (*key, name),
                f"{factor * value:.3g} {unit} is outside {factor * low:g} to {factor * high:g} {unit}; check the unit".replace(
                    "  ", " "
                ),
            )
    tangential = values.get("Ktc")
    for name in ("Krc", "Kac") if tangential else ():
        if abs(values.get(name, 0.0)) > MOST_ACROSS * (tangential or 0.0):
            findings.warn(
                (*key, name),
                f"{1e-6 * values[name]:.4g} N/mm^2 is more than {MOST_ACROSS:g} times Ktc, {1e-6 * (tangential or 0.0):.4g} N/mm^2; check both",
            )
    for name, unit, factor, reason in (
        ("Krc", "N/mm^2", 1e-6, "with a rake above the angle of friction (Merchant 1945)"),
        ("Kre", "N/mm", 1e-3, "where a fit of small chips bends it"),
    ):
        if values.get(name, 0.0) < 0.0:
            findings.warn(
                (*key, name),
                f"{factor * values[name]:.4g} {unit} draws the edge into the part, as only happens {reason}; check the sign",
            )
