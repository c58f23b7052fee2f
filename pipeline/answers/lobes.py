"""Stability lobes as results: the types, and how they read in ``summary.json`` and ``results.h5``."""

from dataclasses import dataclass, field
from typing import ClassVar, TypedDict

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.libraries import h5py
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.estimates import Estimate, scale_shares

MM = 1e3
RPM = 30.0 / np.pi
HZ = 0.5 / np.pi


class LobeSummary(TypedDict):
    """A lobe, or the one at the lowest limit: where its limit is lowest, and what vibrates there."""

    rpm: float
    limit_depth_mm: float
    chatter_hz: float
    waves: int
    from_rpm: float
    to_rpm: float
    mode: str
    mode_hz: float | None
    mode_share: float
    part: str


class BestSpeedSummary(TypedDict):
    """A speed between two lobes; not limited where no cut up to the deepest one chatters."""

    rpm: float
    limit_depth_mm: float
    limited: bool


class LimitCheckSummary(TypedDict):
    """Largest Floquet multipliers below a limit depth (at 0.45, 0.7 and 0.95 of it; in the sample of a
    sweep at 0.95 alone) and at 1.05 of it; stable below one. Without a limit, the deepest cut has only
    to be stable.
    """

    rpm: float
    limit_depth_mm: float
    multipliers: list[float]
    confirmed: bool


class LobeSeries(TypedDict):
    """Over the speeds: null where there is no limit up to the deepest cut that was tried."""

    rpm: list[float]
    limit_depth_mm: list[float]
    zeroth_order_mm: list[float]
    chatter_hz: list[float | None]
    lobe: list[int | None]


class DirectionSummary(TypedDict):
    """Lobes of a direction of travel; errors are those of the lowest limit and of its chatter, by
    source, null where no bound is known.
    """

    direction: list[float]
    name: str
    lowest: LobeSummary | None
    lowest_error_mm: float | None
    lowest_error_share: dict[str, float | None]
    chatter_error_hz: float | None
    chatter_error_share: dict[str, float | None]
    error_left_out: list[str]
    lowest_any_speed_mm: float | None
    best_speeds: list[BestSpeedSummary]
    lobes: list[LobeSummary]
    checks: list[LimitCheckSummary]
    bisected: int
    series: LobeSeries


class LobesSummary(TypedDict):
    """The entry of a pose in ``lobes``."""

    material: str
    radial_depth_mm: float
    immersion: float
    teeth: int
    diameter_mm: float
    tool: str
    up_to_hz: float
    deepest_mm: float
    method: str
    directions: list[DirectionSummary]


@dataclass(frozen=True)
class Lobe:
    """Neighbouring speeds at which the same number of waves of the same mode chatter.

    Attributes:
        place: Index of the speed with the lowest limit.
        first: Index of the lowest speed.
        last: Index of the highest one.
        waves: Whole waves between two teeth.
        mode: Name of what contributes most to the motion that chatters.
        mode_hz: Its natural frequency; None where it has none of its own.
        mode_share: Its share of the motion.
        part: Component or joint with most of the mode's strain energy.
    """

    place: int
    first: int
    last: int
    waves: int
    mode: str
    mode_hz: float | None
    mode_share: float
    part: str


@dataclass(frozen=True)
class LimitCheck:
    """A limit depth checked by Floquet multipliers.

    Attributes:
        place: Index of the speed.
        depth: By zeroth order [m].
        below: Largest multiplier below the limit: at 0.45, 0.7 and 0.95 of it.
        above: At 1.05 of it.
        limited: False where no limit was found up to the deepest cut, which is the depth then.
    """

    place: int
    depth: float
    below: float
    above: float
    limited: bool = True

    @property
    def confirmed(self) -> bool:
        """Stable below, unstable above where there is a limit."""
        return self.below < 1.0 and (self.above >= 1.0 or not self.limited)


@dataclass(frozen=True)
class LimitErrors:
    """How far the lowest limit may be off.

    Attributes:
        depth: Of the limit depth [m].
        chatter: Of the frequency of chatter [Hz].
    """

    depth: Estimate = field(default_factory=Estimate)
    chatter: Estimate = field(default_factory=Estimate)


@dataclass(frozen=True, eq=False)
class DirectionLobes:
    """Lobes of a direction of travel.

    Attributes:
        name: Of the direction of travel.
        direction: Machine frame.
        depths: ``(n,)`` limit depth [m].
        zeroth: ``(n,)`` the same by zeroth order.
        chatter: ``(n,)`` angular frequency of chatter by zeroth order [rad/s]; NaN where there is none.
        owner: ``(n,)`` index into the lobes; -1 for none.
        lowest_any_speed: Limit depth at the worst speed of all, by zeroth order [m].
        lobes: Rising in speed.
        best: Indices of the speeds with the deepest limits between lobes, the deepest first.
        checks: At a sample of speeds and at minima.
        bisected: How many limits were found by bisection.
        errors: Of the lowest limit.
    """

    name: str
    direction: tuple[float, float, float]
    depths: FloatArray
    zeroth: FloatArray
    chatter: FloatArray
    owner: NDArray[np.intp]
    lowest_any_speed: float
    lobes: tuple[Lobe, ...]
    best: tuple[int, ...]
    checks: tuple[LimitCheck, ...]
    bisected: int
    errors: LimitErrors = field(default_factory=LimitErrors)

    @property
    def lowest(self) -> Lobe | None:
        """The lobe with the lowest limit; None where there is none."""
        if not self.lobes:
            return None
        return min(self.lobes, key=lambda lobe: float(self.depths[lobe.place]))


@dataclass(frozen=True, eq=False)
class PoseLobes(Answer):
    """Stability lobes in a pose.

    Attributes:
        pose: Its name.
        material: That is cut.
        radial_depth: [m].
        diameter: Of the tool [m].
        teeth: Of the tool.
        tool: What stands between the machine and the tip, in plain words.
        up_to_hz: Modes of the machine count up to here.
        deepest: Depth up to which a limit was looked for [m].
        method: In plain words.
        speeds: ``(n,)`` [rad/s].
        directions: One per direction of travel.
    """

    pose: str
    material: str
    radial_depth: float
    diameter: float
    teeth: int
    tool: str
    up_to_hz: float
    deepest: float
    method: str
    speeds: FloatArray
    directions: tuple[DirectionLobes, ...]
    units: ClassVar[dict[str, str]] = {
        r"lobes/.*/speeds": "rad/s",
        r"lobes/.*/direction": "1",
        r"lobes/.*/(limit_depth|zeroth_order)": "m",
        r"lobes/.*/lowest_error": "m",
        r"lobes/.*/(chatter_hz|chatter_error_hz)": "Hz",
    }

    def summarise(self) -> LobesSummary:
        """As it stands in ``summary.json``."""
        return {
            "material": self.material,
            "radial_depth_mm": MM * self.radial_depth,
            "immersion": self.radial_depth / self.diameter,
            "teeth": self.teeth,
            "diameter_mm": MM * self.diameter,
            "tool": self.tool,
            "up_to_hz": self.up_to_hz,
            "deepest_mm": MM * self.deepest,
            "method": self.method,
            "directions": [self._summarise(own) for own in self.directions],
        }

    def fill(self, file: "h5py.File") -> None:
        """Write limits and frequencies of chatter over the speeds."""
        group = file.create_group(f"lobes/{self.pose}")
        group["speeds"] = self.speeds
        for own in self.directions:
            inner = group.create_group(own.name)
            inner["direction"] = np.array(own.direction)
            inner["limit_depth"], inner["zeroth_order"] = own.depths, own.zeroth
            inner["chatter_hz"] = HZ * own.chatter
            for name, error in (
                ("lowest_error", own.errors.depth.total),
                ("chatter_error_hz", own.errors.chatter.total),
            ):
                inner[name] = np.nan if error is None else error

    def _summarise(self, own: DirectionLobes) -> DirectionSummary:
        rpm = RPM * self.speeds
        lowest, errors = own.lowest, own.errors
        size = errors.depth.total
        return {
            "direction": list(own.direction),
            "name": own.name,
            "lowest": None if lowest is None else self._summarise_lobe(own, lowest),
            "lowest_error_mm": None if size is None else MM * size,
            "lowest_error_share": scale_shares(errors.depth, MM),
            "chatter_error_hz": errors.chatter.total,
            "chatter_error_share": scale_shares(errors.chatter, 1.0),
            "error_left_out": list(errors.depth.left_out),
            "lowest_any_speed_mm": MM * own.lowest_any_speed
            if np.isfinite(own.lowest_any_speed)
            else None,
            "best_speeds": [
                {
                    "rpm": float(rpm[place]),
                    "limit_depth_mm": float(MM * own.depths[place]),
                    "limited": bool(own.depths[place] < self.deepest),
                }
                for place in own.best
            ],
            "lobes": [self._summarise_lobe(own, lobe) for lobe in own.lobes],
            "checks": [
                {
                    "rpm": float(rpm[check.place]),
                    "limit_depth_mm": MM * check.depth,
                    "multipliers": [check.below, check.above],
                    "confirmed": check.confirmed,
                }
                for check in own.checks
            ],
            "bisected": own.bisected,
            "series": {
                "rpm": list(map(float, rpm)),
                "limit_depth_mm": list(map(float, MM * own.depths)),
                "zeroth_order_mm": list(map(float, MM * own.zeroth)),
                "chatter_hz": [
                    None if np.isnan(value) else float(HZ * value) for value in own.chatter
                ],
                "lobe": [None if value < 0 else int(value) for value in own.owner],
            },
        }

    def _summarise_lobe(self, own: DirectionLobes, lobe: Lobe) -> LobeSummary:
        rpm = RPM * self.speeds
        return {
            "rpm": float(rpm[lobe.place]),
            "limit_depth_mm": float(MM * own.depths[lobe.place]),
            "chatter_hz": float(HZ * own.chatter[lobe.place]),
            "waves": lobe.waves,
            "from_rpm": float(rpm[lobe.first]),
            "to_rpm": float(rpm[lobe.last]),
            "mode": lobe.mode,
            "mode_hz": lobe.mode_hz,
            "mode_share": lobe.mode_share,
            "part": lobe.part,
        }
