"""Schema of the cutting coefficients of a work material, and of a mill with its own modes."""

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from headstock.scene.schema import types

# of the radial and the axial force to the tangential one where a source gives the latter alone: sets
# of coefficients that give all of them have 0.15 to 0.5 and 0.3 (docs/cutting_coefficients.md)
TYPICAL_RATIOS = {"radial_ratio": 0.35, "axial_ratio": 0.25}
TYPICAL_RANGES = {"radial_ratio": 0.6, "axial_ratio": 1.0}
MOST_RATIO = 3.0
CoefficientKey = Literal[
    "Ktc",
    "Krc",
    "Kac",
    "Kte",
    "Kre",
    "Kae",
    "kc11",
    "mc",
    "chip_thickness",
    "radial_ratio",
    "axial_ratio",
]
DIRECT, KIENZLE = ("Kte", "Krc", "Kre", "Kac", "Kae"), ("mc", "chip_thickness")


def _find_ratio_fault(value: float) -> str:
    text = f"is {value:g}; a ratio to the tangential force lies between 0 and {MOST_RATIO:g}"
    return "" if 0.0 <= value <= MOST_RATIO else text


def _find_exponent_fault(value: float) -> str:
    text = f"is {value:g}; Kienzle's exponent lies between 0 and 1; write for example 0.25"
    return "" if 0.0 < value < 1.0 else text


Ratio = Annotated[types.Number, types.without_fault(_find_ratio_fault)]


class CuttingTable(types.StrictTable):
    """Cutting coefficients of a work material: of chip and edge, or Kienzle's specific force, of
    which the tangent at a chip thickness counts.
    """

    model_config = types.one_of("Ktc", "kc11")

    Ktc: types.PositiveSpecificForce | None = None
    """tangential force on a tooth per width and thickness of its chip"""
    Krc: types.SpecificForce | None = None
    """radial one, positive away from the chip; default: `radial_ratio` times `Ktc`"""
    Kac: types.SpecificForce | None = None
    """axial one, positive the way the helix pulls the tool; default: `axial_ratio` times `Ktc`"""
    Kte: types.NotNegativeEdgeForce | None = None
    """tangential force per width of an edge that cuts"""
    Kre: types.EdgeForce | None = None
    """radial one; default: `radial_ratio` times `Kte`, none together with `Krc`"""
    Kae: types.EdgeForce | None = None
    """axial one; default: `axial_ratio` times `Kte`, none together with `Kac`"""
    kc11: types.PositiveSpecificForce | None = None
    """Kienzle's kc1.1, in place of `Ktc`: tangential force at a chip of 1 mm by 1 mm"""
    mc: Annotated[types.Number, types.without_fault(_find_exponent_fault)] | None = None
    """Kienzle's exponent: the force per width is `kc11 h^(1 - mc)`; required with `kc11`"""
    chip_thickness: types.PositiveLength | None = None
    """where the tangent to Kienzle's force is taken; default: the mean of a chip at the feed per tooth, 0.1 mm where there is none"""
    radial_ratio: Ratio | None = None
    """radial forces over tangential ones; default: 0.35 ± 60 % without `Krc`"""
    axial_ratio: Ratio | None = None
    """axial forces over tangential ones; default: 0.25 ± 100 % without `Kac`"""
    ranges: dict[CoefficientKey, types.NotNegativeShare] = {}
    """half width of what is known within a range only: `{ Ktc = "10 %", radial_ratio = "50 %" }`; goes into ±"""
    source: types.Text | None = None
    """where the numbers are from; named in reports"""

    @property
    def values(self) -> dict[str, float]:
        """Coefficients that are written, by key, in SI units."""
        return self.given(("Ktc", "kc11", *DIRECT, *KIENZLE, *TYPICAL_RATIOS))

    def _faults(self) -> Iterator[str]:
        values = self.values
        if "Ktc" in values and "kc11" in values:
            yield "gives both Ktc and kc11; keep one"
        if "Ktc" not in values and "kc11" not in values:
            yield 'gives no tangential force; write Ktc = "800 N/mm^2", or kc11 = "1500 N/mm^2" and mc = 0.25'
        if "kc11" in values and "mc" not in values:
            yield "gives kc11 without mc, by which the specific force falls; write mc = 0.25"
        base, foreign, owner = (
            ("kc11", DIRECT, "Ktc; write radial_ratio and axial_ratio")
            if "kc11" in values
            else ("Ktc", KIENZLE, "kc11")
        )
        for key in self.given(foreign):
            yield f"gives {key} beside {base}; {key} belongs to {owner}, or remove it"
        for ratio, chip, edge in (("radial_ratio", "Krc", "Kre"), ("axial_ratio", "Kac", "Kae")):
            for key in self.given((chip, edge) if ratio in values else ()):
                yield f"gives {ratio} beside {key}; keep one"
            if edge in values and chip not in values:
                yield f"gives {edge} without {chip}; write {chip} as well"
        yield from self._range_faults()

    def _range_faults(self) -> Iterator[str]:
        for key, share in self.ranges.items():
            value = self.values.get(key)
            if value is None:
                yield f"gives a range of {key}, which it does not give; write {key} as well"
            elif key in ("Ktc", "kc11", "chip_thickness", "mc") and share >= 1.0:
                yield f"gives a range of {key} that reaches down to zero; write less than 100 %"
            elif key == "mc" and value * (1.0 + share) >= 1.0:
                yield "gives a range of mc that reaches one; write less"


MOST_TEETH = 40
LEAST_DIAMETER, MOST_DIAMETER = 2e-5, 1.0  # of mills [m]
MOST_HELIX = 75.0  # [deg]
MOST_RUNOUT = 0.1  # of the diameter


def _find_diameter_fault(value: float) -> str:
    if LEAST_DIAMETER <= value <= MOST_DIAMETER:
        return ""
    return f"is {1e3 * value:g} mm; mills measure {1e3 * LEAST_DIAMETER:g} to {1e3 * MOST_DIAMETER:g} mm; check the unit"


def _find_helix_fault(value: float) -> str:
    if abs(value) <= math.radians(MOST_HELIX) * (1.0 + 1e-12):
        return ""
    return (
        f"is {math.degrees(value):g} deg; a helix angle, counted from the tool's axis, lies between {-MOST_HELIX:g} and {MOST_HELIX:g} deg;"
        " check the unit"
    )


class MillTable(types.StrictTable):
    """A cylindrical end mill; a positive helix pulls a tool that turns clockwise down."""

    diameter: Annotated[types.PositiveLength, types.without_fault(_find_diameter_fault)]
    """diameter of the tool"""
    teeth: Annotated[types.WholeNumber, types.Between(1, MOST_TEETH)]
    """number of teeth"""
    helix: Annotated[types.Angle, types.without_fault(_find_helix_fault)] = 0.0
    """helix angle; a positive one pulls the tool down"""
    runout: types.NotNegativeLength = 0.0
    """distance of the tool axis from the spindle axis"""

    def _faults(self) -> Iterator[str]:
        if self.runout > MOST_RUNOUT * self.diameter:
            yield f"has a runout of {1e3 * self.runout:g} mm, more than {100.0 * MOST_RUNOUT:g} % of its diameter; check the unit"


class ToolModeTable(types.StrictTable):
    """A lumped mode of spindle or tool: a mass on a spring on what stands before it."""

    name: types.Name
    """name in tables"""
    frequency: types.PositiveFrequency
    """natural frequency on a rigid base"""
    damping: types.DampingShare
    """damping ratio on a rigid base"""
    stiffness: types.PositiveStiffness
    """stiffness of its spring; its mass follows from the frequency"""
    direction: types.Direction | None = None
    """direction in which it moves; default: both directions across the tool"""
