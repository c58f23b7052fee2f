"""The state space of a machine as a record, and its files for MATLAB and numpy."""

import io
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.io

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.pipeline.storage.provenance import Provenance
from headstock.scene.scene import LOAD
from headstock.solvers.control.drive_loops import ENCODER, SET_POINTS
from headstock.solvers.control.drive_trains import FORCE, MOTOR, SCALE, SLIDE
from headstock.solvers.second_order import Channel, name_channel
from headstock.solvers.state_spaces.balanced_truncation import truncate_balanced
from headstock.solvers.state_spaces.held_inputs import hold_inputs
from headstock.solvers.state_spaces.state_space import StateSpace

OF_DRIVES = (FORCE, MOTOR, SCALE, ENCODER, SLIDE)
UNIT_OF_LOADS = "1"
NAMES = ("inputs", "outputs", "states", "input_units", "output_units")


@dataclass(frozen=True, eq=False)
class MachineStateSpace:
    """A machine between its channels: ``x' = A x + B u``, ``y = C x + D u``; at a step
    ``x+ = A x + B u`` with u held over it.

    Attributes:
        A: ``(n, n)``.
        B: ``(n, k)``.
        C: ``(p, n)``.
        D: ``(p, k)``.
        inputs: Names of the ``k`` inputs, such as ``tcp x``.
        outputs: Names of the ``p`` outputs.
        states: Names of the ``n`` states.
        input_units: N, N.m, or 1 for a load of the scene; m, m/s, m/s2 (rad) of set points.
        output_units: m or rad; N or N.m of forces of drives.
        positions: Position of each axis in the pose [m, rad].
        step: Time over which inputs are held [s]; None in continuous time.
        highest_hz: Highest frequency of a mode among the states [Hz].
        bounds: ``(p, k)`` largest error of each entry of the frequency response by truncation, at any
            frequency; zero where nothing is truncated.
        bound: The same as a share of the largest response, channels scaled.
        pairs: With a step, how many blocks of two states A begins with; else 0.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    pose: str
    positions: Mapping[str, float]
    step: float | None
    highest_hz: float
    bounds: FloatArray
    bound: float = 0.0
    pairs: int = 0

    @property
    def contents(self) -> dict[str, Any]:
        """Return what files hold; a step of 0 means continuous time."""
        return {
            **{name: getattr(self, name) for name in ("A", "B", "C", "D", "bounds", "pose")},
            **{name: list(getattr(self, name)) for name in NAMES},
            "axes": list(self.positions),
            "positions": np.array(list(self.positions.values())),
            "step": self.step or 0.0,
        }


def find_fastest_hz(space: StateSpace) -> float:
    """Return the highest frequency of a mode, continuous in time [Hz]."""
    return float(np.abs(np.linalg.eigvals(space.a).imag).max(initial=0.0)) / (2.0 * np.pi)


def describe_space(
    space: StateSpace,
    *,
    pose: Pose,
    step_s: float | None = None,
    balanced: float | None = None,
    rotary: Collection[str] = (),
) -> MachineStateSpace:
    """Return the record of a state space.

    Args:
        space: Continuous in time.
        step_s: Over which inputs are held [s]; None for continuous time.
        balanced: Error that leaving out states may cause, as a share of the largest response; None
            to keep all states.
        rotary: Axes and drives that turn.

    Raises:
        ModelError: No state can be left out.
    """
    units = list_units((space.inputs, space.outputs), rotary)
    bounds, highest = np.zeros_like(space.d), find_fastest_hz(space)
    bound = 0.0
    if balanced is not None:
        smaller = truncate_balanced(space, balanced, *units)
        space, bounds, bound = smaller.space, smaller.bounds, smaller.share
    held = None if step_s is None else hold_inputs(space, step_s)
    system = space if held is None else held
    states = space.states if held is None else tuple(f"state {n + 1}" for n in range(len(held.a)))
    return MachineStateSpace(
        A=system.a, B=system.b, C=system.c, D=system.d,
        inputs=tuple(map(name_channel, space.inputs)),
        outputs=tuple(map(name_channel, space.outputs)),
        states=states, input_units=units[0], output_units=units[1],
        pose=pose.name, positions=pose.positions, step=step_s, highest_hz=highest,
        bounds=bounds, bound=bound, pairs=0 if held is None else held.pairs,
    )  # fmt: skip


def _find_unit(channel: Channel, *, is_input: bool, rotary: Collection[str]) -> str:
    name, word = channel
    if word == LOAD:
        return UNIT_OF_LOADS
    turns = name in rotary if word in (*OF_DRIVES, *SET_POINTS) else "r" in word
    length, force = ("rad", "N.m") if turns else ("m", "N")
    if word == FORCE or (is_input and word not in SET_POINTS):
        return force
    return length + {"velocity": "/s", "acceleration": "/s2"}.get(word, "")


def name_variable(kind: str, name: str) -> str:
    """Return what a simulator calls a channel.

    Args:
        kind: ``force`` for inputs, ``motion`` for outputs; what is of a drive or a set point says so.
        name: Such as ``tcp x``.
    """
    owner, word = name.rsplit(" ", 1)
    kind = "drive" if word in OF_DRIVES else "set" if word in SET_POINTS else kind
    return f"{kind}.{owner}.{word}"


def list_units(
    channels: tuple[Sequence[Channel], Sequence[Channel]], rotary: Collection[str] = ()
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the units of inputs and outputs.

    Args:
        rotary: Axes and drives that turn.
    """
    inputs, outputs = (
        tuple(_find_unit(channel, is_input=number == 0, rotary=rotary) for channel in listed)
        for number, listed in enumerate(channels)
    )
    return inputs, outputs


def encode_npz(contents: Mapping[str, Any]) -> bytes:
    """Return a file of numpy."""
    image = io.BytesIO()
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in contents.items()}
    np.savez(image, **arrays)
    return image.getvalue()


def encode_mat(contents: Mapping[str, Any], origin: Provenance | None = None) -> bytes:
    """Return a MATLAB 5 file: ``sys = ss(A, B, C, D, step, 'InputName', inputs, ...)``; where it comes
    from as a structure.
    """
    image = io.BytesIO()
    words = {} if origin is None else {"provenance": origin.summarise_for_export()}
    scipy.io.savemat(image, _as_cells({**contents, **words}))
    return image.getvalue()


def _as_cells(content: Any) -> Any:
    """Return tables with lists as cells, and nothing as an empty text."""
    if isinstance(content, Mapping):
        return {name: _as_cells(value) for name, value in content.items()}
    if isinstance(content, list):
        return np.array(content, dtype=object)
    return "" if content is None else content
