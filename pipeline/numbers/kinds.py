"""Kinds of numbers of a run: roles of their keys, units on screen, and the factors behind their ±."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from headstock.pipeline.numbers.estimates import CUTTING

# SI unit to unit on screen and factor, where a kind has none of its own
SHOWN_UNITS: Mapping[str, tuple[str, float]] = {
    "m": ("µm", 1e6),
    "rad": ("µrad", 1e6),
    "m/N": ("µm/kN", 1e9),
    "N/m": ("N/µm", 1e-6),
    "Pa": ("MPa", 1e-6),
    "Pa/N": ("MPa/kN", 1e-3),
}
MILLIMETRES = {"m": ("mm", 1e3)}
WHOLE_ROLES = frozenset({"mode", "face", "pole"})


@dataclass(frozen=True)
class Kind:
    """What numbers of a kind have in common.

    Attributes:
        label: Plural in plain words.
        roles: That a key may name, in this order.
        shown: SI unit to unit on screen and factor, where :data:`SHOWN_UNITS` says another.
        of_size: ± is of the magnitude, else of the value.
        cover: Source of error to the factor by which a change counts in ±; under an empty text that of
            any other.
        evidence: The validation behind those factors.
        alone: A change counts relative to the number itself, else to the largest of its kind: components
            of a vector may be zero by symmetry.
        compared: Comparisons of runs list the kind.
        words: One of them in plain words, with roles in braces; built of the label without it.
    """

    label: str
    roles: tuple[str, ...]
    shown: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    of_size: bool = False
    cover: Mapping[str, float] = field(default_factory=dict)
    evidence: str = ""
    alone: bool = False
    compared: bool = True
    words: str = ""

    def cover_of(self, source: str) -> float:
        """Return the factor by which a change by a source of error counts."""
        return self.cover.get(source, self.cover.get("", 1.0))

    def show_unit(self, unit: str) -> tuple[str, float]:
        """Return unit on screen and factor of an SI unit."""
        return self.shown.get(unit) or SHOWN_UNITS.get(unit) or (unit, 1.0)


def _along_path(label: str, *roles: str, alone: bool = False) -> Kind:
    """Return a kind of numbers of a move: what a resonance does after a ramp goes up and down as it
    shifts; ranges of coefficients are whole widths.
    """
    cover = {"": 1.5, CUTTING: 1.0}
    return Kind(
        label, roles, of_size=True, cover=cover, evidence="validate axes-estimates", alone=alone
    )


def _on_contour(label: str, *roles: str, alone: bool = False) -> Kind:
    """Return a kind of numbers of a face: what teeth and corners excite goes up and down as modes shift."""
    cover = {"": 2.0, CUTTING: 1.0}
    return Kind(label, roles, cover=cover, evidence="validate contour-estimates", alone=alone)


KINDS: Mapping[str, Kind] = {
    "mass": Kind("masses", ("component",), alone=True, compared=False),
    "frequency": Kind(
        "frequencies",
        ("pose", "mode"),
        alone=True,
        evidence="validate coverage",
        words="frequency {mode}",
    ),
    "damping_ratio": Kind(
        "damping ratios", ("pose", "mode"), shown={"1": ("%", 100.0)}, alone=True
    ),
    "damped_frequency": Kind("damped frequencies", ("pose", "mode"), alone=True),
    "compliance": Kind(
        "static compliance",
        ("pose", "point", "direction"),
        evidence="validate coverage",
        words="{direction} compliance at {point}",
    ),
    "displacement": Kind("displacement under loads", ("pose", "point", "direction")),
    "load_displacement": Kind("displacement by load", ("pose", "point", "load", "direction")),
    "probe_displacement": Kind("displacement at probes", ("pose", "probe", "direction")),
    "probe_stress": Kind("stress at probes", ("pose", "probe", "component")),
    "peak": Kind(
        "peaks of frequency responses",
        ("pose", "output", "input", "mode"),
        alone=True,
        words="peak of {output} under {input} at mode {mode}",
    ),
    "level": Kind(
        "levels of frequency responses",
        ("pose", "output", "input"),
        alone=True,
        words="static level of {output} under {input}",
    ),
    "response_line": Kind(
        "lines of frequency responses",
        ("pose", "line"),
        compared=False,
        words="frequency response at {line}",
    ),
    "dynamic_stiffness": Kind("dynamic stiffness", ("pose", "output"), alone=True),
    "negative_real": Kind("most negative real parts", ("pose", "output"), alone=True),
    "peak_frequency_stress": Kind("peak stress per load", ("pose", "probe", "input"), alone=True),
    "limit_depth": Kind(
        "limit depth of cut",
        ("pose", "face", "direction"),
        shown=MILLIMETRES,
        alone=True,
        evidence="validate milling-stability",
    ),
    "chatter_frequency": Kind("frequency of chatter", ("pose", "direction"), alone=True),
    "multiplier": Kind("multipliers of cuts", ("face",), alone=True),
    "volumetric_range": Kind("volumetric error", ("point", "source", "component")),
    "volumetric_error": Kind("largest volumetric error", ("point",), alone=True),
    "line_deviation": Kind("deviation along axes", ("point", "axis", "component")),
    "squareness": Kind("squareness", ("point", "axes")),
    "path_deviation": _along_path("path deviation", "feed", "zone", "output", "figure"),
    "time_deviation": Kind("peaks over time", ("pose", "output", "figure"), of_size=True),
    "settling_time": Kind("settling times", ("pose", "feed", "zone", "output"), alone=True),
    "motor_torque": _along_path("motor torques", "pose", "feed", "drive"),
    "position_error": _along_path("position errors", "pose", "feed", "drive"),
    "joint_force": _along_path("joint forces", "pose", "feed", "joint", "direction"),
    "peak_stress": _along_path("peak stress over time", "pose", "feed", "probe", alone=True),
    "peak_displacement": _along_path(
        "peak displacement over time", "pose", "feed", "probe", alone=True
    ),
    "pole_frequency": Kind("control poles", ("pose", "pole"), alone=True),
    "pole_damping": Kind(
        "damping of control poles", ("pose", "pole"), shown={"1": ("%", 100.0)}, alone=True
    ),
    "velocity_lag": Kind("velocity lag", ("pose", "drive")),
    "loop_margin": Kind("margins of drive loops", ("pose", "drive", "figure"), alone=True),
    "gravity_deflection": Kind("deflection under gravity on the contour", ("direction", "figure")),
    "outward_gap": _on_contour("outward contour gap", "face", "figure"),
    "contour_gap": _on_contour("contour gap", "face", "direction", "figure"),
    "drive_force": _on_contour("drive forces", "face", "drive", "figure"),
    "drive_torque": _on_contour("torques on faces", "face", "drive", "figure"),
    "profile": _on_contour("profiles of faces", "face", "figure", alone=True),
    "joint_coordinate": Kind("positions of joints", ("pose", "joint"), compared=False),
    "condition_number": Kind("condition numbers", ("pose",), alone=True),
}
