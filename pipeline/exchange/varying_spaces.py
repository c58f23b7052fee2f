"""The state space of a machine whose axes move: a record, evaluated at positions, and what its files
hold.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, cast

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose, find_limit_fault
from headstock.pipeline.exchange.state_spaces import MachineStateSpace, describe_space, list_units
from headstock.scene.reading.findings import Problem, SceneError
from headstock.scene.reading.units import ANGLE, LENGTH, UnitError, parse_quantity
from headstock.solvers.second_order import Channel, name_channel
from headstock.solvers.state_spaces.state_space import StateSpace
from headstock.solvers.state_spaces.varying_matrices import PosedMatrices, VaryingMatrices


@dataclass(frozen=True, eq=False)
class VaryingStateSpace:
    """A machine between its channels wherever its axes stand, in states that are the same in all poses:
    ``x = (r z, z')``, ``z'' + C(p) z' + K(p) z = B(p) u``, ``y = L(p) z``.

    Attributes:
        channels: ``k`` inputs, then ``p`` outputs.
        rotary: Axes and drives that turn.
        axis_units: ``m`` or ``rad`` of each axis.
        positions: Where the axes stand at the start [m, rad].
        rate: ``r`` [rad/s], above all natural frequencies and decay rates.
        step: Over which an FMU holds its inputs [s]; None for continuous time.
        frozen_pose_error: Largest error of the frequency response in poses that did not serve to make
            it, as a share of the response at that frequency.
        highest_hz: Highest natural frequency in question: up to it responses are right [Hz].
        target: What was asked for.
        held_out: Number of those poses.
        solved: Number of poses solved with all modes.
    """

    matrices: VaryingMatrices
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]]
    rotary: tuple[str, ...]
    axis_units: tuple[str, ...]
    positions: Mapping[str, float]
    rate: float
    step: float | None
    frozen_pose_error: float
    highest_hz: float
    target: float
    held_out: int
    solved: int

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes that move."""
        return tuple(self.matrices.knots[0])

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(map(name_channel, self.channels[0]))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(map(name_channel, self.channels[1]))

    @property
    def input_units(self) -> tuple[str, ...]:
        """Units of the inputs."""
        return list_units(self.channels, self.rotary)[0]

    @property
    def output_units(self) -> tuple[str, ...]:
        """Units of the outputs."""
        return list_units(self.channels, self.rotary)[1]

    def at(self, **positions: float | str) -> MachineStateSpace:
        """Return the state space at positions of axes; the others stay where they start.

        Args:
            positions: By axis, as ``"-100 mm"`` or a number [m, rad].

        Raises:
            SceneError: There is no such axis, it does not move so far, or that is no position.
        """
        read = {name: self._read_position(name, given) for name, given in positions.items()}
        place = {**self.positions, **read}
        space = to_first_order(self.matrices.at(place), self.rate, self.channels)
        return describe_space(space, pose=Pose("", place), step_s=self.step, rotary=self.rotary)

    def _read_position(self, name: str, given: object) -> float:
        """Return where an axis shall stand [m, rad].

        Raises:
            SceneError: There is no such axis, it does not move so far, or that is no position.
        """
        fault, position = f"there is no axis {name}; axes: {', '.join(self.axes)}", 0.0
        if name in self.axes:
            knots = self.matrices.knots[0][name].positions
            unit = self.axis_units[self.axes.index(name)]
            try:
                is_number = isinstance(given, Real) and not isinstance(given, bool)
                dimension = LENGTH if unit == "m" else ANGLE
                position = (
                    float(cast(Real, given))
                    if is_number
                    else parse_quantity(given, dimension).value
                )
                fault = find_limit_fault(
                    name, position, low=float(knots[0]), high=float(knots[-1]), unit=unit
                )
            except UnitError as error:
                fault = str(error)
        if fault or not math.isfinite(position):
            raise SceneError(
                [Problem("VaryingStateSpace.at", name, "", fault or f"{position} is no position")]
            )
        return position

    @property
    def contents(self) -> dict[str, Any]:
        """Return what files hold: matrices at all knots, and the rows they are made of."""
        grid = self.matrices.grid
        poses = [self.at(**place) for place in grid]
        fields = {
            "damping_amounts": self.matrices.further,
            "loads": self.matrices.loads,
            "rows": self.matrices.rows,
        }
        for number, spring in enumerate(self.matrices.springs, 1):
            names = (f"joint_{number}_{part}" for part in ("rows", "stiffness", "damping"))
            fields |= zip(names, spring.fields, strict=True)
        return {
            **{letter: np.array([getattr(pose, letter) for pose in poses]) for letter in "ABCD"},
            **{
                name: list(getattr(self, name))
                for name in (
                    "inputs",
                    "outputs",
                    "input_units",
                    "output_units",
                    "axes",
                    "axis_units",
                )
            },
            "poses": np.array([list(place.values()) for place in grid]),
            **{
                f"knots_{name}_{what}": knots.positions
                for what, level in zip(("joints", "channels"), self.matrices.knots, strict=True)
                for name, knots in level.items()
            },
            "constant_stiffness": self.matrices.stiffness,
            "constant_damping": self.matrices.damping,
            "damping_patterns": self.matrices.patterns,
            **{name: field.values for name, field in fields.items()},
            "rate": self.rate,
            "step": self.step or 0.0,
            "frozen_pose_error": self.frozen_pose_error,
        }


def to_first_order(
    matrices: PosedMatrices, rate: float, channels: tuple[tuple[Channel, ...], tuple[Channel, ...]]
) -> StateSpace:
    """Return ``x' = A x + B u``, ``y = C x`` of states ``(r z, z')``."""
    size = len(matrices.stiffness)
    zero = np.zeros((size, size))
    a: FloatArray = np.block(
        [[zero, rate * np.eye(size)], [-matrices.stiffness / rate, -matrices.damping]]
    )
    b = np.vstack([np.zeros_like(matrices.loads), matrices.loads])
    c = np.hstack([matrices.rows / rate, np.zeros_like(matrices.rows)])
    inputs, outputs = channels
    names = tuple(f"{part} {k + 1}" for part in ("displacement", "velocity") for k in range(size))
    return StateSpace(a, b, c, np.zeros((len(outputs), len(inputs))), inputs, outputs, names)
