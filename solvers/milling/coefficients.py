"""Cutting coefficients of a work material: of the chip and of the edge, tangential, radial, axial,
and how far each may be off.

Kienzle's force per width ``kc1.1 h^(1 - mc)``, with ``h`` in millimetres, is replaced by its tangent
at a chip thickness: the slope is the chip coefficient, what is left at no thickness that of the edge
(Altintas 2012, Manufacturing Automation, sec. 2.3).
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

MM = 1e3
Three = tuple[float, float, float]


@dataclass(frozen=True)
class _CoefficientRange:
    """What is known within a range only.

    Attributes:
        share: Half width over the value.
        ends: Coefficients at its lower and its upper end.
    """

    share: float
    ends: "tuple[CuttingCoefficients, CuttingCoefficients]"


@dataclass(frozen=True)
class CuttingCoefficients:
    """Coefficients of a work material.

    Attributes:
        chip: Tangential, radial, axial force per width and chip thickness [N/m^2].
        edge: Tangential, radial, axial force per width of an edge that cuts [N/m].
        chip_thickness: At which Kienzle's force is replaced by its tangent [m]; None of coefficients
            that are given as such.
        thickness_from: How that thickness was chosen, in words.
        ranges: What is known within a range only, by its key.
    """

    chip: Three
    edge: Three
    source: str
    name: str = ""
    chip_thickness: float | None = None
    thickness_from: str = ""
    ranges: Mapping[str, _CoefficientRange] = field(default_factory=dict)

    def spread(
        self, value: float, find: Callable[["CuttingCoefficients"], float]
    ) -> dict[str, float]:
        """Return how far a number may be off, by key: the larger of its changes at both ends of each range.

        Args:
            find: The number with other coefficients.
        """
        return {
            key: max(abs(find(end) - value) for end in own.ends) for key, own in self.ranges.items()
        }

    def farther_end(self, key: str) -> "CuttingCoefficients":
        """The end of a range at which coefficients change most, the lower one of two alike."""

        def change(end: "CuttingCoefficients") -> float:
            pairs = zip((*end.chip, *end.edge), (*self.chip, *self.edge), strict=True)
            # to what is no more than roundoff both ends are alike
            return round(max(abs(other - value) / (abs(value) or 1.0) for other, value in pairs), 9)

        return max(self.ranges[key].ends, key=change)

    def describe(self) -> str:
        """The numbers that count, in words."""
        numbers = [
            f"K{letter}{kind} {value * factor:.4g}"
            for kind, values, factor in (("c", self.chip, 1e-6), ("e", self.edge, 1e-3))
            for letter, value in zip("tra", values, strict=True)
        ]
        text = f"{', '.join(numbers[:3])} N/mm^2; {', '.join(numbers[3:])} N/mm"
        if self.chip_thickness is not None:
            text += f"; tangent at a chip thickness of {MM * self.chip_thickness:.3g} mm ({self.thickness_from})"
        spreads = [f"{key} ± {100.0 * own.share:.3g} %" for key, own in self.ranges.items()]
        return f"{text}; {', '.join(spreads)}" if spreads else text


def _find_coefficients(values: Mapping[str, float]) -> tuple[Three, Three]:
    """Coefficients of the chip [N/m^2] and of the edge [N/m].

    Args:
        values: By key: Ktc, and Kte where the edge has a part; or kc11, mc and chip_thickness. Krc
            and Kac with Kre and Kae, or radial_ratio and axial_ratio to the tangential ones. SI.
    """
    if "kc11" in values:
        # the tangent to Kienzle's force, whose kc11 is that of a millimetre by a millimetre
        mc, thickness = values["mc"], values["chip_thickness"]
        specific = values["kc11"] * (MM * thickness) ** -mc
        chip, edge = (1.0 - mc) * specific, mc * specific * thickness
    else:
        chip, edge = values["Ktc"], values.get("Kte", 0.0)
    across = [
        (values[own], values.get(own_edge, 0.0))
        if own in values
        else (values[ratio] * chip, values[ratio] * edge)
        for own, own_edge, ratio in (("Krc", "Kre", "radial_ratio"), ("Kac", "Kae", "axial_ratio"))
    ]
    (krc, kre), (kac, kae) = across
    return (chip, krc, kac), (edge, kre, kae)


def build_coefficients(
    values: Mapping[str, float],
    ranges: Mapping[str, float],
    *,
    name: str,
    source: str,
    thickness_from: str = "",
) -> CuttingCoefficients:
    """Coefficients with those at the ends of their ranges.

    Args:
        values: As in :func:`find_coefficients`.
        ranges: Half width of a range over its value, by key.
        thickness_from: How the chip thickness was chosen, in words.
    """

    def build(own: Mapping[str, float]) -> CuttingCoefficients:
        chip, edge = _find_coefficients(own)
        thickness = own.get("chip_thickness")
        return CuttingCoefficients(chip, edge, source, name, thickness, thickness_from)

    def reach(key: str, share: float) -> _CoefficientRange:
        low, high = (build({**values, key: (1.0 + side * share) * values[key]}) for side in (-1, 1))
        return _CoefficientRange(share, (low, high))

    reaches = {key: reach(key, share) for key, share in ranges.items() if share > 0.0}
    return dataclasses.replace(build(values), ranges=reaches)


def mean_chip_thickness(feed_per_tooth: float, immersion: float) -> float:
    """Mean over the arc in which a tooth cuts [m].

    Args:
        feed_per_tooth: [m].
        immersion: Radial depth over diameter, at most one.
    """
    return feed_per_tooth * 2.0 * immersion / math.acos(1.0 - 2.0 * min(immersion, 1.0))
