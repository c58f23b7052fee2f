"""Schema of studies, which vary keys of a scene and watch results, and of sweeps, which repeat the
analyses in poses.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag

from headstock.geometry.frames import FloatArray
from headstock.scene.reading.findings import KeyPath
from headstock.scene.reading.units import ANGLE, LENGTH, Quantity
from headstock.scene.reading.watch_paths import MEASURED_NAMES, WatchError, parse_watch
from headstock.scene.schema import types
from headstock.scene.schema.axes import PoseTable
from headstock.scene.studies import MAX_POINTS, REFERENCE_RUN

MAX_REPEATS = 100
Values = Annotated[list[Any], Field(min_length=1, max_length=MAX_POINTS)]
Varied = Annotated[dict[str, Values], Field(min_length=1)]
MAX_SWEEP_POSES = 100_000


def _check_watches(paths: list[str]) -> list[str]:
    for path in paths:
        try:
            parse_watch(path)
        except WatchError as error:
            raise types.problem(str(error)) from error
    return paths


Watches = Annotated[types.Names, AfterValidator(_check_watches)]


def _length_faults(vary: Mapping[str, Sequence[object]], *, pairwise: bool) -> Iterator[str]:
    lengths = {key: len(values) for key, values in vary.items()}
    if not pairwise and math.prod(lengths.values()) > MAX_POINTS:
        yield f"has more than {MAX_POINTS} points; vary fewer keys at once, or write pairwise = true"
    if pairwise and len(set(lengths.values())) > 1:
        shown = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        yield f"pairwise combines the first values of all lists, then the second ones: lists must have equal lengths; {shown}"


class FamilyTable(types.StrictTable):
    """A named part of a study: settings that are the same in all its points, and what is varied."""

    label: types.Text | None = None
    """name in tables and figures; default: its name in the scene"""
    set: dict[str, Any] = {}
    """keys that are set to another value in every point of this family, in addition to those of the study"""
    vary: Varied
    """keys of the scene and their values, as in the study"""
    pairwise: types.Flag = False
    """combine values pairwise, as in the study"""
    analyses: types.Names | None = None
    """which analyses are run in this family; default: those of the study"""
    other_model: types.Flag = False
    """in a [cost study](studies.md#what-accuracy-costs): another model than the reference run (other interfaces, for instance); its
    difference is model spread, not error"""

    def _faults(self) -> Iterator[str]:
        yield from _length_faults(self.vary, pairwise=self.pairwise)


class StudyTable(types.StrictTable):
    """Keys of the scene that are varied and results that are watched: every combination is one
    point, computed like `run` would.
    """

    model_config = types.one_of("vary", "families")

    vary: Varied | None = None
    """keys of the scene and their values, `{ "components.column.mesh.size" = ["50 mm", "25 mm"] }`: every combination is a point; `variant
    = ["", "soft"]` varies the variant"""
    set: dict[str, Any] = {}
    """keys that are set to another value in every point"""
    pairwise: types.Flag = False
    """combine the first values of all lists, then the second ones, and so on, in place of every combination"""
    families: dict[types.Name, FamilyTable] = {}
    """several groups of points with their own settings, in place of `vary`"""
    watch: Watches | None = None
    """names of numbers: `"frequency(pose=reference,mode=1)"`, `"frequency"`, `"compliance(*point=tcp*)"`;
    paths into `summary.json`: `"modal.frequencies_hz[0:6]"`, `"static.tcp.compliance_um_per_kN[0][0]"`, `"seconds"`, `"cpu_seconds"`;
    required without `reference`"""
    analyses: types.Names | None = None
    """which analyses are run; default: all of the scene's"""
    store: Literal["warm", "cold"] = "warm"
    """`cold`: every point starts from an empty store, so that seconds are those of the whole computation"""
    repeats: Annotated[types.WholeNumber, types.Between(1, MAX_REPEATS)] = 1
    """runs per point, for the median and spread of seconds"""
    reference: Literal["kono-cantilever", "kono-fixed-beam"] | None = None
    """published study of this beam that the results are compared with"""
    reference_run: dict[str, Any] | None = None
    """settings of a run that all others are compared with: makes it a [cost study](studies.md#what-accuracy-costs)"""

    def _faults(self) -> Iterator[str]:
        if (self.vary is None) == (not self.families):
            yield (
                'needs either vary or families; write vary = { "components.NAME.mesh.size" = ["50 mm", "25 mm"] }'
                if self.vary is None
                else "gives both vary and families; move vary into a family"
            )
        if self.watch is None and self.reference is None:
            yield 'watches nothing; write watch = ["modal.frequencies_hz[0:6]", "seconds"]'
        if self.reference_run is not None and all(
            parse_watch(path).steps[0] in MEASURED_NAMES for path in self.watch or ()
        ):
            yield 'watches no result that could be compared with its reference run; write watch = ["modal.frequencies_hz[0:6]"]'
        if REFERENCE_RUN in self.families:
            yield f"calls a family {REFERENCE_RUN!r}, which is the name of the run that the others are compared with"
        yield from _length_faults(self.vary or {}, pairwise=self.pairwise)


class _AxisSpan(NamedTuple):
    """Lowest and highest position of an axis and the number of positions."""

    low: types.AxisPosition
    high: types.AxisPosition
    positions: types.Count

    def values(self) -> FloatArray:
        """Positions ``(n,)``, evenly spread [m, rad]."""
        return np.linspace(self.low.value, self.high.value, self.positions, dtype=np.float64)


Span = Annotated[
    _AxisSpan,
    types.read_span('positions: ["-100 mm", "100 mm", 21]'),
    types.describe_span((LENGTH, ANGLE), ["-100 mm", "100 mm", 21], 1),
]


Places = Annotated[list[types.Text | PoseTable], Field(min_length=1, max_length=MAX_SWEEP_POSES)]


Waypoints = Annotated[list[PoseTable], Field(min_length=2, max_length=1000)]


# tags in brackets are no part of a key
Way = Annotated[
    Annotated[Waypoints, Tag("[waypoints]")] | Annotated[types.Text, Tag("[file]")],
    Discriminator(lambda value: "[file]" if isinstance(value, str) else "[waypoints]"),
]


class SweepTable(types.StrictTable):
    """Poses in which the analyses are repeated: a grid of `axes`, a list of `poses`, or a `path` in
    steps of at most `step`.

    A path is a list of waypoints, or the name of a CSV file of them.
    """

    model_config = types.one_of("axes", "poses", "path")

    axes: Annotated[dict[types.Name, Span], Field(min_length=1)] | None = None
    """a grid: first and last position and how many, of each axis; axes left out are at zero"""
    poses: Places | None = None
    """names of poses and positions, one by one: `["reference", { X = "10 mm" }]`"""
    path: Way | None = None
    """corner points of a path: `[{ X = "-100 mm" }, { X = "100 mm", Y = "50 mm" }]`, or a CSV file that begins `X [mm],Y [mm]`"""
    step: types.PositiveAxisPosition | None = None
    """largest distance between two poses along a path, in the unit of its axes; default: one pose per row of the file"""
    variant: types.Text | None = None
    """variant of the scene that is swept, `A+B` for several; it applies after one of the command line"""

    def _faults(self) -> Iterator[str]:
        given = self.given(("axes", "poses", "path"))
        if len(given) != 1:
            what = (
                f"gives {' and '.join(given)}; keep one"
                if given
                else "gives neither axes nor poses nor path"
            )
            yield f'{what}; write for example axes = {{ X = ["-100 mm", "100 mm", 21] }}'
        if (self.path is None) != (self.step is None) and not isinstance(self.path, str):
            yield 'path and step go together; write path = [{ X = "0 mm" }, { X = "100 mm" }] and step = "5 mm"'

    def quantities(self) -> Iterator[tuple[KeyPath, str, Quantity]]:
        """Yield every position the table itself names: the rest of its key, its axis, its value."""
        for axis, span in (self.axes or {}).items():
            yield ("axes", axis, 0), axis, span.low
            yield ("axes", axis, 1), axis, span.high
        for key, places in (("poses", self.poses), ("path", self.path)):
            for index, place in enumerate(() if isinstance(places, str) else places or ()):
                if not isinstance(place, str):
                    yield from (((key, index, axis), axis, value) for axis, value in place.items())
