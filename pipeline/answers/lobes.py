"""Stability lobes as results: the types, and how they read in ``summary.json`` and ``results.h5``."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.numbers.estimates import Estimate, scale_shares, scale_total
from headstock.pipeline.numbers.numbers import Number, Series, make_key
from headstock.pipeline.storage.json_texts import find_known

MM = 1e3
RPM = 30.0 / np.pi
HZ = 0.5 / np.pi


LOBE_KEYS = "rpm limit_depth_mm chatter_hz waves from_rpm to_rpm mode mode_hz mode_share part"


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


@dataclass(frozen=True, eq=False)
class DirectionLobes:
    """Lobes of a direction of travel.

    Attributes:
        depths: ``(n,)`` limit depth [m]; the deepest that was looked for where there is none, NaN
            where it was not looked for.
        limited: ``(n,)`` whether there is a limit.
        zeroth: ``(n,)`` limits of a single frequency (zeroth order) [m].
        chatter: ``(n,)`` angular frequency of chatter [rad/s]; NaN where there is none.
        owner: ``(n,)`` index into the lobes; -1 for none.
        best: Indices of the speeds with the deepest limits between lobes, the deepest first.
        depth_errors: Source of error to ``(n,)`` sizes in the limits [m]; NaN where there is no bound.
        chatter_errors: The same in frequencies of chatter [Hz].
        left_out: What is not in them, in plain words.
    """

    name: str
    direction: tuple[float, float, float]
    depths: FloatArray
    limited: BoolArray
    zeroth: FloatArray
    chatter: FloatArray
    owner: NDArray[np.intp]
    lobes: tuple[Lobe, ...]
    best: tuple[int, ...]
    depth_errors: Mapping[str, FloatArray] = field(default_factory=dict)
    chatter_errors: Mapping[str, FloatArray] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    @property
    def errors(self) -> FloatArray:
        """``(n,)`` ± of the limits [m]; NaN where there is none."""
        if not self.depth_errors:
            return np.full(len(self.depths), np.nan)
        return np.asarray(sum(self.depth_errors.values()))

    def estimate(self, place: int) -> tuple[Estimate, Estimate]:
        """± of the limit [m] and of the frequency of chatter [Hz] at a speed."""
        depth, chatter = (
            {
                source: float(sizes[place]) if np.isfinite(sizes[place]) else None
                for source, sizes in errors.items()
            }
            for errors in (self.depth_errors, self.chatter_errors)
        )
        return Estimate(depth, self.left_out), Estimate(chatter, self.left_out)

    @property
    def lowest(self) -> Lobe | None:
        """The lobe with the lowest limit; None where there is none."""
        if not self.lobes:
            return None
        return min(self.lobes, key=lambda lobe: float(self.depths[lobe.place]))

    @property
    def lowest_errors(self) -> tuple[Estimate, Estimate]:
        """± of the lowest limit [m] and of its frequency of chatter [Hz]; without shares where there is none."""
        return (Estimate(), Estimate()) if self.lowest is None else self.estimate(self.lowest.place)


@dataclass(frozen=True, eq=False)
class PoseLobes(Answer):
    """Stability lobes in a pose.

    Attributes:
        radial_depth: [m].
        diameter: Of the tool [m].
        tool: What stands between the machine and the tip, in plain words.
        sense: Of milling, with the side of the part, in plain words.
        up_to_hz: Modes of the machine count at least up to here.
        modes_to_hz: Up to here they do, with those of spindle and tool.
        deepest: Depth up to which a limit was looked for [m].
        confirmed: Whether limits were found by multipliers; else a single frequency says so.
        speeds: ``(n,)`` [rad/s].
        directions: One per direction of travel.
    """

    pose: str
    material: str
    radial_depth: float
    diameter: float
    teeth: int
    tool: str
    sense: str
    up_to_hz: float
    modes_to_hz: float
    deepest: float
    method: str
    confirmed: bool
    speeds: FloatArray
    directions: tuple[DirectionLobes, ...]
    units: ClassVar[dict[str, str]] = {
        r"lobes/.*/speeds": "rad/s",
        r"lobes/.*/direction": "1",
        r"lobes/.*/(limit_depth|limit_error|zeroth_order)": "m",
        r"lobes/.*/lowest_error": "m",
        r"lobes/.*/(chatter_hz|chatter_error_hz)": "Hz",
    }
    entry: ClassVar[str] = "lobes"
    keys: ClassVar[
        str
    ] = f"""lobes.*(material radial_depth_mm immersion teeth diameter_mm tool sense
        up_to_hz modes_to_hz deepest_mm method confirmed
        directions[](direction[] name lowest({LOBE_KEYS}) lowest_error_mm lowest_error_share.*
        chatter_error_hz chatter_error_share.* error_left_out[]
        best_speeds[](rpm limit_depth_mm error_mm limited) lobes[]({LOBE_KEYS})
        series(rpm[] limit_depth_mm[] error_mm[] limited[] zeroth_order_mm[] chatter_hz[] lobe[])))"""

    @property
    def rpm(self) -> FloatArray:
        """``(n,)`` speeds [rev/min]."""
        return RPM * self.speeds

    def list_numbers(self) -> Iterator[Number]:
        """Yield the lowest limit of each direction of travel and its frequency of chatter."""
        for own in self.directions:
            if (lowest := own.lowest) is not None:
                depth, chatter = own.estimate(lowest.place)
                at = {"pose": self.pose, "direction": own.name}
                key = make_key("limit_depth", **at)
                yield Number(key, float(own.depths[lowest.place]), "m", depth)
                hz = HZ * float(own.chatter[lowest.place])
                yield Number(make_key("chatter_frequency", **at), hz, "Hz", chatter)

    def list_series(self) -> Iterator[Series]:
        """Yield the limit over the speeds of each direction of travel, NaN where none was found."""
        for own in self.directions:
            yield Series(
                f"limit_depth(pose={self.pose},direction={own.name})",
                {"speed [rad/s]": self.speeds},
                np.where(own.limited, own.depths, np.nan),
                "m",
                own.depth_errors,
            )

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``."""
        return {
            "material": self.material,
            "radial_depth_mm": MM * self.radial_depth,
            "immersion": self.radial_depth / self.diameter,
            "teeth": self.teeth,
            "diameter_mm": MM * self.diameter,
            "tool": self.tool,
            "sense": self.sense,
            "up_to_hz": self.up_to_hz,
            "modes_to_hz": self.modes_to_hz,
            "deepest_mm": MM * self.deepest,
            "method": self.method,
            "confirmed": self.confirmed,
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
            inner["limit_error"], inner["limited"] = own.errors, own.limited
            inner["chatter_hz"] = HZ * own.chatter
            depth, chatter = own.lowest_errors
            for name, error in (("lowest_error", depth), ("chatter_error_hz", chatter)):
                inner[name] = np.nan if error.total is None else error.total

    def _summarise(self, own: DirectionLobes) -> Entry:
        rpm = self.rpm
        lowest, sizes = own.lowest, own.errors
        depth, chatter = own.lowest_errors
        return {
            "direction": list(own.direction),
            "name": own.name,
            "lowest": None if lowest is None else self._summarise_lobe(own, lowest),
            "lowest_error_mm": scale_total(depth, MM),
            "lowest_error_share": scale_shares(depth, MM),
            "chatter_error_hz": chatter.total,
            "chatter_error_share": scale_shares(chatter, 1.0),
            "error_left_out": list(own.left_out),
            "best_speeds": [
                {
                    "rpm": float(rpm[place]),
                    "limit_depth_mm": float(MM * own.depths[place]),
                    "error_mm": find_known(MM * sizes[place]),
                    "limited": bool(own.limited[place]),
                }
                for place in own.best
            ],
            "lobes": [self._summarise_lobe(own, lobe) for lobe in own.lobes],
            "series": {
                "rpm": list(map(float, rpm)),
                "limit_depth_mm": list(map(find_known, MM * own.depths)),
                "error_mm": list(map(find_known, MM * sizes)),
                "limited": list(map(bool, own.limited)),
                "zeroth_order_mm": list(map(float, MM * own.zeroth)),
                "chatter_hz": list(map(find_known, HZ * own.chatter)),
                "lobe": [None if value < 0 else int(value) for value in own.owner],
            },
        }

    def _summarise_lobe(self, own: DirectionLobes, lobe: Lobe) -> Entry:
        rpm = self.rpm
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
