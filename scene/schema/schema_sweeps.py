"""Schema of sweeps: the poses in which the analyses are repeated, as a grid, as a list, or along a path."""

from typing import Annotated, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from headstock.scene.reading.units import ANGLE, LENGTH, Quantity
from headstock.scene.schema.connections import PoseTable
from headstock.scene.schema.types import AxisPosition, Count, JsonForm, Name, QuantityPattern, StrictTable, Text, one_of, problem

MAX_SWEEP_POSES = 100_000


def _read_span(value: object) -> object:
    if not isinstance(value, list) or len(value) != 3:
        raise problem('is not a span; write lowest, highest and number of positions: ["-100 mm", "100 mm", 21]')
    return {"low": value[0], "high": value[1], "positions": value[2]}


class SpanTable(StrictTable):
    """Lowest and highest position of an axis and the number of positions."""

    low: AxisPosition
    high: AxisPosition
    positions: Count

    def ends(self) -> tuple[float, float]:
        """Lowest and highest position in SI units."""
        return self.low.value, self.high.value


Span = Annotated[
    SpanTable,
    BeforeValidator(_read_span),
    JsonForm(
        {
            "type": "array",
            "examples": [["-100 mm", "100 mm", 21]],
            "prefixItems": [
                *2 * [{"type": "string", "pattern": QuantityPattern((LENGTH, ANGLE))}],
                {"type": "integer", "minimum": 1},
            ],
            "minItems": 3,
            "maxItems": 3,
        }
    ),
]
Places = Annotated[list[Text | PoseTable], Field(min_length=1, max_length=MAX_SWEEP_POSES)]
Waypoints = Annotated[list[PoseTable], Field(min_length=2, max_length=1000)]
# tags in brackets are no part of a key
Way = Annotated[
    Annotated[Waypoints, Tag("[waypoints]")] | Annotated[Text, Tag("[file]")],
    Discriminator(lambda value: "[file]" if isinstance(value, str) else "[waypoints]"),
]


class SweepTable(StrictTable):
    """Poses in which the analyses are repeated: a grid of `axes`, a list of `poses`, or a `path` in steps of at most `step`.

    A path is a list of waypoints, or the name of a CSV file of them.
    """

    model_config = one_of("axes", "poses", "path")

    axes: Annotated[dict[Name, Span], Field(min_length=1)] | None = None
    poses: Places | None = None
    path: Way | None = None
    step: AxisPosition | None = None
    variant: Text | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = [key for key in ("axes", "poses", "path") if getattr(self, key) is not None]
        if len(given) != 1:
            what = "gives neither axes nor poses nor path" if not given else f"gives {' and '.join(given)}; keep one"
            raise problem(f'{what}; write for example axes = {{ X = ["-100 mm", "100 mm", 21] }}')
        if (self.path is None) != (self.step is None) and not isinstance(self.path, str):
            raise problem('path and step go together; write path = [{ X = "0 mm" }, { X = "100 mm" }] and step = "5 mm"')
        if self.step is not None and self.step.value <= 0.0:
            raise problem("step must be above zero")
        return self

    def quantities(self) -> list[tuple[tuple[str | int, ...], str, Quantity]]:
        """Every position the table itself names: the rest of its key, its axis, its value."""
        found: list[tuple[tuple[str | int, ...], str, Quantity]] = []
        for axis, span in (self.axes or {}).items():
            found += [(("axes", axis, index), axis, value) for index, value in enumerate((span.low, span.high))]
        for key in ("poses", "path"):
            for index, place in enumerate(() if isinstance(self.path, str) else getattr(self, key) or ()):
                if not isinstance(place, str):
                    found += [((key, index, axis), axis, value) for axis, value in place.items()]
        return found
