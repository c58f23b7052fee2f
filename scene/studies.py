"""Studies of a scene, and the points they consist of."""

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

VARIANT = "variant"  # varied like a key of the scene, by names of variants; "" is the scene as it stands
MAX_POINTS = 100_000
TRUTH = "truth"  # family of the one point that the others are held against


@dataclass(frozen=True, eq=False)
class StudyFamily:
    """Points of a study that share their settings.

    Attributes:
        name: Empty where a study has no families.
        label: How it is called in tables and figures.
        settings: Dotted key to value, the same in every point.
        vary: Dotted key (or ``variant``) to its values.
        pairwise: The first values go together, then the second ones; else every combination is a point.
        analyses: What is computed; empty for all the scene asks for.
        other_model: It computes another machine than the truth of a cost study (other interfaces, say): how far its numbers lie
            apart is a spread of the model, no error.
    """

    name: str
    label: str
    settings: Mapping[str, Any]
    vary: Mapping[str, tuple[Any, ...]]
    pairwise: bool = False
    analyses: tuple[str, ...] = ()
    other_model: bool = False


@dataclass(frozen=True, eq=False)
class Study:
    """What is varied in a scene and what is looked at.

    Attributes:
        name: In the scene.
        families: At least one.
        watch: Paths into a point's summary.
        cold: Every point starts with an empty store, so that seconds are those of the whole computation.
        repeats: How often each point is computed, for the spread of its seconds.
        truth: Settings of the run that all others are held against, so that errors stand beside costs; None without one.
        reference: Published study that the results are held against; None for studies of one's own.
    """

    name: str
    families: tuple[StudyFamily, ...]
    watch: tuple[str, ...] = ()
    cold: bool = False
    repeats: int = 1
    reference: str | None = None
    truth: Mapping[str, Any] | None = None


@dataclass(frozen=True, eq=False)
class StudyPoint:
    """One computation of a study.

    Attributes:
        family: Name of its family.
        varied: Dotted key (or ``variant``) to the value it has here.
        settings: Every override, fixed and varied, in the order in which they apply.
        variant: Variant of the scene that applies after the one the study was started with; empty for none.
        analyses: What is computed; empty for all the scene asks for.
    """

    family: str
    varied: Mapping[str, Any]
    settings: Mapping[str, Any] = field(default_factory=dict)
    variant: str = ""
    analyses: tuple[str, ...] = ()


def count_points(study: Study) -> int:
    """How many points a study has, without making them."""
    return sum(
        min(map(len, family.vary.values())) if family.pairwise else math.prod(map(len, family.vary.values()))
        for family in study.families
    )


def expand_study(study: Study) -> tuple[StudyPoint, ...]:
    """The points of a study, family by family; of a grid the last key changes fastest."""
    return tuple(
        make_point(family, dict(zip(family.vary, values, strict=True)))
        for family in study.families
        for values in _combinations(family)
    )


def make_point(family: StudyFamily, varied: Mapping[str, Any]) -> StudyPoint:
    """The point of a family at which varied keys have these values."""
    settings = {**family.settings, **{key: value for key, value in varied.items() if key != VARIANT}}
    return StudyPoint(family.name, dict(varied), settings, str(varied.get(VARIANT, "")), family.analyses)


def _combinations(family: StudyFamily) -> Iterator[tuple[Any, ...]]:
    if family.pairwise:
        return zip(*family.vary.values(), strict=True)
    return itertools.product(*family.vary.values())


def describe_point(point: StudyPoint) -> str:
    """A point in a few words: ``tet10, column.mesh.size = 25 mm``."""
    return ", ".join([*([point.family] if point.family else []), *list_varied(point.varied)])


def list_varied(varied: Mapping[str, Any]) -> list[str]:
    """Varied keys with their values; those that differ in the component only stand together: ``mesh.size = 76 mm, 100 mm``."""
    groups: dict[str, list[str]] = {}
    for key in varied:
        groups.setdefault(_without_owner(key), []).append(key)
    return [
        f"{shorten_key(keys[0]) if len(keys) == 1 else name} = {', '.join(dict.fromkeys(show_value(varied[key]) for key in keys))}"
        for name, keys in groups.items()
    ]


def _without_owner(key: str) -> str:
    """A key without its component or joint: ``components.bed.mesh.size`` is ``mesh.size``."""
    parts = key.split(".")
    return ".".join(parts[2:]) if parts[0] in {"components", "joints"} and len(parts) > 2 else key


def shorten_key(key: str) -> str:
    """A key without the section it begins with."""
    return key.removeprefix("components.").removeprefix("joints.")


def show_value(value: Any) -> str:
    """A varied value as a reader knows it from the scene."""
    if isinstance(value, list | tuple):
        return ", ".join(map(show_value, value))
    return value if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)
