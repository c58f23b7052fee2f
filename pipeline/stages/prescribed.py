"""Displacements of joints as inputs of a machine: what their springs push, their dampers, and the
inertia of what fixed directions move.

The machine moves by ``q = B y + O e``: ``y`` follows loads by the offset e, its rate and its
acceleration, and outputs see ``O e`` directly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.stages.control import DrivenMachine, find_driven_offsets
from headstock.pipeline.stages.run_state import PoseModel
from headstock.reduction.coupling.error_travel import (
    ErrorTravel,
    find_offset_motions,
)
from headstock.reduction.coupling.guide_errors import ErrorPlaces, find_displacements
from headstock.reduction.motions.path_errors import pass_offsets
from headstock.scene.scene import LOAD
from headstock.solvers.linear.mixed_inputs import MixedInput
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.state_spaces.state_space import Feedthrough

RATE, ACCELERATION = "rate", "acceleration"


@dataclass(frozen=True, eq=False)
class Displacement:
    """A displacement of a joint, as large as the scene writes it.

    Attributes:
        loads: ``(n, 3)`` generalised load of its value, rate and acceleration.
        moved: ``(n_all,)`` motion of the stacked dofs that fixed directions make.
        direct: What its value and its rate add to outputs at once.
    """

    name: str
    loads: FloatArray
    moved: FloatArray
    direct: Feedthrough

    @property
    def inputs(self) -> dict[Channel, FloatArray]:
        """Channels of its value, rate and acceleration with their loads."""
        return dict(zip(list_parts(self.name), self.loads.T, strict=True))

    @property
    def mixed(self) -> MixedInput:
        """The same as one input over frequency."""
        shares = dict(zip(self.direct.outputs, self.direct.shares, strict=True))
        return MixedInput(
            list_parts(self.name),
            lambda omega: np.vander(1j * omega, 3, increasing=True),
            {output: (float(value), float(rate)) for output, (value, rate) in shares.items()},
        )


def list_parts(name: str) -> tuple[Channel, Channel, Channel]:
    """Return the channels of the value, the rate and the acceleration of a displacement."""
    return (name, LOAD), (name, RATE), (name, ACCELERATION)


def place_displacement(
    machine: PoseModel,
    system: SecondOrderSystem,
    name: str,
    *,
    outputs: Sequence[Channel],
    probes: Mapping[str, Sequence[Channel]],
    driven: DrivenMachine | None = None,
    with_joints: bool = False,
) -> Displacement:
    """Return a displacement of the scene in the pose of a machine.

    Args:
        machine: Of superelements.
        system: Its equations with all damping that acts.
        outputs: Points or interfaces, with a direction.
        probes: Names of probes to what they see.
        driven: The machine with motors that are under control; None where they are locked or free.
        with_joints: Also to forces of joints, whose springs rest elsewhere.

    Raises:
        ModelError: It moves what linear scales read, wherever motors are.
    """
    scene, coupled = machine.parts.scene.machine, machine.coupled
    if coupled is None:
        raise ValueError("a lumped mechanism has no joints")
    ((joint, offset),) = find_displacements(scene, coupled.fixed.springs)[name].items()
    dofs = [int(dof) for dof in np.flatnonzero(offset)]
    directions = tuple((joint, dof) for dof in dofs)
    travel = ErrorTravel(scene, np.zeros(1), ErrorPlaces({}, {}, {}, {}), directions, np.inf)
    motions = (
        find_offset_motions(coupled, travel, system)
        if driven is None
        else find_driven_offsets(driven, travel, system)
    )
    shares = offset[dofs]
    joints = machine.joints if with_joints else ()
    passed = pass_offsets(coupled, travel, motions, outputs, joints, probes)
    return Displacement(
        name,
        np.column_stack(
            [part @ shares for part in (motions.loads, motions.rates, motions.accelerations)]
        ),
        motions.moved @ shares,
        Feedthrough(
            passed.outputs,
            list_parts(name)[:2],
            np.column_stack([part @ shares for part in np.split(passed.shares, 2, axis=1)]),
        ),
    )
