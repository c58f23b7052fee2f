"""Schema of sensors and point masses on components."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from headstock.scene.reading.units import LENGTH, UnitError, quote_value, read_unit
from headstock.scene.schema import types

AXES = ("x", "y", "z")
SensorAxes = Literal["machine", "component"]


def _read_measured(value: object) -> object:
    if isinstance(value, str) and value in AXES:
        return value
    if not isinstance(value, list):
        raise types.problem(
            f"{quote_value(value)} is no direction of a sensor; write x, y, z or three plain numbers such as [1, 1, 0]"
        )
    return types.read_direction(value)


Measured = Annotated[
    str | tuple[float, float, float],
    BeforeValidator(_read_measured),
    types.describe_direction("x, y, z or three plain numbers", AXES, "x", [1, 1, 0]),
]


def _find_unit_fault(value: str) -> str:
    try:
        read_unit(value, LENGTH)
    except UnitError as error:
        return str(error)
    return ""


class MassTable(types.StrictTable):
    """A point mass on a component, or many from a table."""

    component: types.Text | None = None
    """component that it is mounted on; in a table the default of its column `component`"""
    at: types.Position | None = None
    """position on the component's surface or inside it"""
    file: types.Text | None = None
    """a `.csv` table in the folder of the scene, a place in each row: columns `x [mm]`, `y [mm]`, `z [mm]` and, as wanted, `name`,
    `component` (or `part`), `directions` and `mass [g]`; or a `.uff` file of a test with its points and what was measured there"""
    unit: Annotated[types.Text, types.without_fault(_find_unit_fault)] | None = None
    """unit of positions in a table whose columns name none"""
    frame: SensorAxes = "component"
    """frame of the position: of the component, or of the machine with all axes at zero"""
    reach: types.NotNegativeLength = 1e-3
    """largest distance from the component's surface: within it the nearest place is taken, beyond it the place is refused"""
    mass: types.PositiveMass | None = None
    """mass; in a table the default of its column `mass`"""

    def _faults(self) -> Iterator[str]:
        if (self.at is None) == (self.file is None):
            yield 'needs either at = ["0 mm", "20 mm", "110 mm"] or a table of places, file = "points.csv"'
        if self.at is not None and self.component is None:
            yield 'needs the component that it is mounted on; write component = "name"'
        if self.unit is not None and self.file is None:
            yield '`unit` goes with file; write units with the position, at = ["0 mm", "20 mm", "110 mm"]'


class SensorTable(MassTable):
    """A sensor on a component, or many from a table: its motion is a row of the results, it adds no
    degrees of freedom, and forces may act there.
    """

    directions: Annotated[list[Measured], Field(min_length=1, max_length=3)] = ["x", "y", "z"]
    """directions that are measured: `x`, `y`, `z`, or own vectors, which are the sensor's `x`, `y`, `z` in their order; what was not
    measured is left out"""
    axes: SensorAxes = "machine"
    """axes of the directions: of the machine, or of the component, with which they turn"""
    mass: types.PositiveMass | None = None
    """mass of the sensor, which counts; default: none"""
    residual_modes: types.Flag = False
    """keep the static response to forces there, as is done anyway where one acts: motion is then as exact as at an interface, and the part is
    reduced again when the sensor is moved"""

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if len({str(one) for one in self.directions}) < len(self.directions):
            yield "names a direction twice"
