"""Studies and sweeps of a scene, and the points and poses they consist of."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose, show_position
from headstock.scene.reading.files import TomlValue

VARIANT = (
    "variant"  # varied like a key of the scene, by names of variants; "" is the scene as written
)
MAX_POINTS = 100_000
REFERENCE_RUN = "reference_run"  # family of the one point that the others are compared with
SweepKind = Literal["grid", "list", "path"]


@dataclass(frozen=True, eq=False)
class StudyFamily:
    """Points of a study that share their settings.

    Attributes:
        name: Empty where a study has no families.
        label: How it is called in tables and figures.
        settings: Dotted key to value, the same in every point.
        vary: Dotted key (or ``variant``) to its values.
        pairwise: The first values go together, then the second ones; else every combination is a
            point.
        analyses: What is computed; empty for all the scene asks for.
        other_model: It computes another machine than the reference run of a cost study (other interfaces,
            say): how far its numbers lie apart is a spread of the model, no error.
    """

    name: str
    label: str
    settings: Mapping[str, TomlValue]
    vary: Mapping[str, tuple[TomlValue, ...]]
    pairwise: bool = False
    analyses: tuple[str, ...] = ()
    other_model: bool = False


@dataclass(frozen=True, eq=False)
class Study:
    """What is varied in a scene and what is looked at.

    Attributes:
        watch: Paths into a point's summary.
        cold: Every point starts with an empty store, so that seconds are those of the whole
            computation.
        repeats: How often each point is computed, for the spread of its seconds.
        reference_run: Settings of the run that all others are compared with, so that errors stand beside
            costs; None without one.
        reference: Published study that the results are compared with; None for studies of one's own.
    """

    name: str
    families: tuple[StudyFamily, ...]
    watch: tuple[str, ...] = ()
    cold: bool = False
    repeats: int = 1
    reference: str | None = None
    reference_run: Mapping[str, TomlValue] | None = None


@dataclass(frozen=True, eq=False)
class StudyPoint:
    """One computation of a study.

    Attributes:
        varied: Dotted key (or ``variant``) to the value it has here.
        settings: Every override, fixed and varied, in the order in which they apply.
        variant: Variant of the scene that applies after the one the study was started with; empty
            for none.
        analyses: What is computed; empty for all the scene asks for.
    """

    family: str
    varied: Mapping[str, TomlValue]
    settings: Mapping[str, TomlValue] = field(default_factory=dict)
    variant: str = ""
    analyses: tuple[str, ...] = ()


def expand_study(study: Study) -> tuple[StudyPoint, ...]:
    """The points of a study, family by family; of a grid the last key changes fastest."""
    return tuple(
        make_point(family, dict(zip(family.vary, values, strict=True)))
        for family in study.families
        for values in _combinations(family)
    )


def make_point(family: StudyFamily, varied: Mapping[str, TomlValue]) -> StudyPoint:
    """The point of a family at which varied keys have these values."""
    settings = {
        **family.settings,
        **{key: value for key, value in varied.items() if key != VARIANT},
    }
    return StudyPoint(
        family.name, dict(varied), settings, str(varied.get(VARIANT, "")), family.analyses
    )


def _combinations(family: StudyFamily) -> Iterator[tuple[TomlValue, ...]]:
    if family.pairwise:
        return zip(*family.vary.values(), strict=True)
    return itertools.product(*family.vary.values())


def describe_point(point: StudyPoint) -> str:
    """A point in a few words: ``tet10, column.mesh.size = 25 mm``."""
    return ", ".join([*([point.family] if point.family else []), *list_varied(point.varied)])


def list_varied(varied: Mapping[str, TomlValue]) -> list[str]:
    """Varied keys with their values; those that differ in the component only stand together:
    ``mesh.size = 76 mm, 100 mm``.
    """
    groups: dict[str, list[str]] = {}
    for key in varied:
        groups.setdefault(_without_owner(key), []).append(key)
    return [
        f"{shorten_key(keys[0]) if len(keys) == 1 else name} = {', '.join(dict.fromkeys(show_setting(varied[key]) for key in keys))}"
        for name, keys in groups.items()
    ]


def _without_owner(key: str) -> str:
    """A key without its component or joint: ``components.bed.mesh.size`` is ``mesh.size``."""
    parts = key.split(".")
    return ".".join(parts[2:]) if parts[0] in {"components", "joints"} and len(parts) > 2 else key


def shorten_key(key: str) -> str:
    """A key without the section it begins with."""
    return key.removeprefix("components.").removeprefix("joints.")


def show_setting(value: TomlValue) -> str:
    """A varied value as a reader knows it from the scene."""
    if isinstance(value, list):
        return ", ".join(map(show_setting, value))
    return (
        value
        if isinstance(value, str)
        else f"{value:g}"
        if isinstance(value, float)
        else str(value)
    )


@dataclass(frozen=True, eq=False)
class Sweep:
    """Poses in which the analyses are repeated.

    Attributes:
        kind: A grid, whose last axis changes fastest; a list; or a path, whose neighbours follow
            each other.
        axes: Names of the axes that are set; others stand at zero.
        units: ``m`` or ``rad`` of each.
        positions: ``(n, k)`` of every pose [m, rad].
        shape: Number of positions of each axis of a grid; ``(n,)`` otherwise.
        labels: Names of the poses of a list; empty where they have none.
        variant: Variant of the scene that is swept; None for the scene as it is.
    """

    name: str
    kind: SweepKind
    axes: tuple[str, ...]
    units: tuple[str, ...]
    positions: FloatArray
    shape: tuple[int, ...]
    labels: tuple[str, ...] = ()
    variant: str | None = None


def make_grid(name: str, units: dict[str, str], spans: dict[str, FloatArray]) -> Sweep:
    """Every combination of the axes' positions.

    Args:
        units: ``m`` or ``rad`` of each axis.
        spans: Positions ``(n,)`` of each axis [m, rad]; the last changes fastest.
    """
    positions = np.array(list(itertools.product(*spans.values())), dtype=float) + 0.0
    shape = tuple(len(values) for values in spans.values())
    return Sweep(name, "grid", tuple(spans), tuple(units[axis] for axis in spans), positions, shape)


def make_list(
    name: str, units: dict[str, str], places: list[dict[str, float]], labels: list[str]
) -> Sweep:
    """Poses one by one; axes that a pose does not name stand at zero in it.

    Args:
        units: ``m`` or ``rad`` of each axis.
        places: Axis to position [m, rad], one per pose.
        labels: Names of the poses; empty for none.
    """
    axes, positions = _stack(places)
    shape, kinds = (len(positions),), tuple(units[axis] for axis in axes)
    return Sweep(name, "list", axes, kinds, positions, shape, tuple(labels))


def make_path(
    name: str, units: dict[str, str], waypoints: list[dict[str, float]], step: float, unit: str
) -> Sweep:
    """Poses along straight legs between waypoints, each leg divided evenly into steps of at most
    ``step``.

    An infinite step gives no poses but the waypoints. The length of a leg is that of the way of the
    axes that are measured like the step.

    Args:
        units: ``m`` or ``rad`` of each axis.
        waypoints: Axis to position [m, rad], one per corner.
        step: Largest distance of poses [m, rad].
        unit: ``m`` or ``rad``: that of the step.
    """
    axes, corners, counts = _divide_legs(units, waypoints, step, unit)
    places = [corners[:1]]
    for start, end, count in zip(corners[:-1], corners[1:], counts, strict=True):
        # corners as they are written, not as the sum of a leg
        places += [start + np.arange(1, count)[:, None] / count * (end - start), end[None]]
    positions = np.vstack(places)
    kinds = tuple(units[axis] for axis in axes)
    return Sweep(name, "path", axes, kinds, positions, (len(positions),))


def count_path(
    units: dict[str, str], waypoints: list[dict[str, float]], step: float, unit: str
) -> int:
    """Count the poses of a path without making them, 1e15 at most; arguments as ``make_path``."""
    _, _, counts = _divide_legs(units, waypoints, step, unit)
    return 1 + int(min(counts.sum(), 1e15))


def _divide_legs(
    units: dict[str, str], waypoints: list[dict[str, float]], step: float, unit: str
) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Axes, corners ``(n, k)`` and the number of steps of each leg ``(n - 1,)`` of a path."""
    axes, corners = _stack(waypoints)
    measured = np.array([units.get(axis) == unit for axis in axes], dtype=bool)
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(np.diff(corners, axis=0)[:, measured], axis=1)
        return axes, corners, np.maximum(1.0, np.ceil(lengths / step * (1.0 - 1e-9)))


def sweep_pose(sweep: Sweep, number: int) -> Pose:
    """One pose of a sweep, named by its label or its positions."""
    positions = sweep.positions[number]
    name = sweep.labels[number] if sweep.labels else describe_positions(sweep, number)
    return Pose(name, dict(zip(sweep.axes, map(float, positions), strict=True)))


def describe_positions(sweep: Sweep, number: int) -> str:
    """Positions of a pose in words: ``X -100 mm, B 30 deg``; axes that stand still are left out."""
    columns = moving_axes(sweep) or range(len(sweep.axes))
    return ", ".join(
        f"{sweep.axes[column]} {show_position(float(sweep.positions[number, column]), sweep.units[column])}"
        for column in columns
    )


def moving_axes(sweep: Sweep) -> list[int]:
    """Return which of the axes stand in more than one place."""
    return [column for column in range(len(sweep.axes)) if np.ptp(sweep.positions[:, column]) > 0.0]


def sweep_neighbours(sweep: Sweep, present: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Pairs of poses that lie beside each other, along each axis of a grid or one after the other.

    Args:
        present: ``(n,)`` which of them count; those before and after one that does not are
            neighbours.
    """
    numbers = np.arange(len(sweep.positions)).reshape(sweep.shape)
    pairs: list[tuple[int, int]] = []
    for axis in range(numbers.ndim):
        for line in np.moveaxis(numbers, axis, -1).reshape(-1, sweep.shape[axis]):
            kept = line[present[line]].tolist()
            pairs += itertools.pairwise(kept)
    return pairs


def _stack(places: list[dict[str, float]]) -> tuple[tuple[str, ...], FloatArray]:
    axes = tuple(dict.fromkeys(axis for place in places for axis in place))
    rows = [[place.get(axis, 0.0) for axis in axes] for place in places]
    return axes, np.array(rows, dtype=float).reshape(len(places), len(axes)) + 0.0
