"""Kinds of numbers of a run: roles of their keys, units on screen, and the safety factors behind
their ±.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from headstock.pipeline.numbers.estimates import CUTTING

# SI unit to unit on screen and factor, unless a kind has its own
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
    """Describe what numbers of a kind have in common.

    Attributes:
        label: Plural in plain words.
        roles: Roles that a key may name, in this order.
        shown: SI unit to unit on screen and factor, where :data:`SHOWN_UNITS` says another.
        of_size: The ± is that of the magnitude, else of the value.
        cover: Source of error to the safety factor on its change in the ±; an empty text for any
            other source.
        evidence: The validation case behind these factors.
        across: Roles of the components of a vector, which may be zero by symmetry: their changes
            are relative to the largest component. Without, they are relative to the number itself.
        compared: Comparisons of runs list the kind. Of modes only frequencies are listed, as close
            modes change their order.
        words: Name of a single number, with roles in braces; by default built from the label.
    """

    label: str
    roles: tuple[str, ...]
    shown: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    of_size: bool = False
    cover: Mapping[str, float] = field(default_factory=dict)
    evidence: str = ""
    across: tuple[str, ...] = ()
    compared: bool = True
    words: str = ""

    def cover_of(self, source: str) -> float:
        """Return the safety factor on changes by a source of error."""
        return self.cover.get(source, self.cover.get("", 1.0))

    def show_unit(self, unit: str) -> tuple[str, float]:
        """Return the unit on screen and its factor for an SI unit."""
        return self.shown.get(unit) or SHOWN_UNITS.get(unit) or (unit, 1.0)


def _along_path(label: str, *roles: str, across: tuple[str, ...] = ()) -> Kind:
    """Return a kind of numbers of a move: its cover allows for residual vibration that rises and
    falls as a resonance shifts; ranges of coefficients count with their whole width.
    """
    cover = {"": 1.5, CUTTING: 1.0}
    return Kind(
        label, roles, of_size=True, cover=cover, evidence="validate axes-estimates", across=across
    )


def _on_contour(label: str, *roles: str, across: tuple[str, ...] = ()) -> Kind:
    """Return a kind of numbers of a face: its cover allows for excitation by teeth and corners that
    rises and falls as modes shift.
    """
    cover = {"": 2.0, CUTTING: 1.0}
    return Kind(label, roles, cover=cover, evidence="validate contour-estimates", across=across)


KINDS: Mapping[str, Kind] = {
    "mass": Kind("masses", ("component",), compared=False),
    "frequency": Kind(
        "frequencies",
        ("pose", "mode"),
        evidence="validate coverage",
        words="frequency {mode}",
    ),
    "damping_ratio": Kind(
        "damping ratios", ("pose", "mode"), shown={"1": ("%", 100.0)}, compared=False
    ),
    "damped_frequency": Kind("damped frequencies", ("pose", "mode"), compared=False),
    "compliance": Kind(
        "static compliance",
        ("pose", "point", "direction"),
        evidence="validate coverage",
        words="{direction} compliance at {point}",
        across=("direction",),
    ),
    "displacement": Kind(
        "displacement under loads", ("pose", "point", "direction"), across=("direction",)
    ),
    "load_displacement": Kind(
        "displacement by load", ("pose", "point", "load", "direction"), compared=False
    ),
    "probe_displacement": Kind(
        "displacement at probes", ("pose", "probe", "direction"), across=("direction",)
    ),
    "probe_stress": Kind("stress at probes", ("pose", "probe", "component"), across=("component",)),
    "peak": Kind(
        "peaks of frequency responses",
        ("pose", "output", "input", "mode"),
        compared=False,
        words="peak of {output} under {input} at mode {mode}",
    ),
    "level": Kind(
        "levels of frequency responses",
        ("pose", "output", "input"),
        words="static level of {output} under {input}",
    ),
    "response_line": Kind(
        "lines of frequency responses",
        ("pose", "line"),
        compared=False,
        words="frequency response at {line}",
    ),
    "dynamic_stiffness": Kind("dynamic stiffness", ("pose", "output")),
    "negative_real": Kind("most negative real parts", ("pose", "output")),
    "peak_frequency_stress": Kind("peak stress per load", ("pose", "probe", "input")),
    "limit_depth": Kind(
        "limit depth of cut",
        ("pose", "face", "direction"),
        shown=MILLIMETRES,
        evidence="validate milling-stability",
    ),
    "chatter_frequency": Kind("frequency of chatter", ("pose", "direction")),
    "multiplier": Kind("multipliers of cuts", ("face",)),
    "volumetric_range": Kind(
        "volumetric error", ("point", "source", "component"), across=("component",)
    ),
    "volumetric_error": Kind("largest volumetric error", ("point",)),
    "line_deviation": Kind(
        "deviation along axes", ("point", "axis", "component"), across=("component",)
    ),
    "squareness": Kind("squareness", ("point", "axes"), across=("axes",)),
    "path_deviation": _along_path(
        "path deviation", "feed", "zone", "output", "figure", across=("figure",)
    ),
    "time_deviation": Kind(
        "peaks over time", ("pose", "output", "figure"), of_size=True, across=("figure",)
    ),
    "settling_time": Kind("settling times", ("pose", "feed", "zone", "output")),
    "motor_torque": _along_path("motor torques", "pose", "feed", "drive"),
    "position_error": _along_path("position errors", "pose", "feed", "drive"),
    "joint_force": _along_path(
        "joint forces", "pose", "feed", "joint", "direction", across=("joint", "direction")
    ),
    "peak_stress": _along_path("peak stress over time", "pose", "feed", "probe"),
    "peak_displacement": _along_path("peak displacement over time", "pose", "feed", "probe"),
    "pole_frequency": Kind("control poles", ("pose", "pole")),
    "pole_damping": Kind(
        "damping of control poles", ("pose", "pole"), shown={"1": ("%", 100.0)}, compared=False
    ),
    "guard_frequency": Kind(
        "frequencies to guard",
        ("pose", "drive", "mode"),
        compared=False,
        evidence="validate coverage",
    ),
    "guard_band": Kind(
        "bands of frequencies to guard", ("drive", "mode", "figure"), compared=False
    ),
    "velocity_lag": Kind("velocity lag", ("pose", "drive")),
    "loop_margin": Kind("margins of drive loops", ("pose", "drive", "figure")),
    "gravity_deflection": Kind(
        "deflection under gravity on the contour", ("direction", "figure"), across=("direction",)
    ),
    "outward_gap": _on_contour("outward contour gap", "face", "figure", across=("figure",)),
    "contour_gap": _on_contour("contour gap", "face", "direction", "figure", across=("direction",)),
    "drive_force": _on_contour("drive forces", "face", "drive", "figure", across=("drive",)),
    "drive_torque": _on_contour("torques on faces", "face", "drive", "figure", across=("drive",)),
    "profile": _on_contour("profiles of faces", "face", "figure"),
    "map_extreme": Kind("map over poses", ("quantity", "figure"), shown=MILLIMETRES),
    "joint_coordinate": Kind("positions of joints", ("pose", "joint"), compared=False),
    "condition_number": Kind("condition numbers", ("pose",)),
}
