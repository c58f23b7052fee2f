"""Displacements of joints over time: what their springs push, their dampers, and the inertia of what
fixed directions move.

The machine moves by ``q = B y + O e(t)``: ``y`` follows loads by the offsets e, their rates and their
accelerations, and outputs see ``O e`` directly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.motion.probe_motions import probe_values
from headstock.pipeline.stages.run_state import PoseModel
from headstock.reduction.coupling.error_travel import ErrorTravel, find_offset_motions
from headstock.reduction.coupling.guide_errors import ErrorPlaces, find_displacements
from headstock.reduction.motions.path_errors import pass_offsets
from headstock.scene.analyses.transient import TransientRequest
from headstock.scene.scene import LOAD
from headstock.solvers.errors import ModelError
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.state_spaces.load_history import LoadHistory, differentiate_load
from headstock.solvers.state_spaces.state_space import Feedthrough

RATE, ACCELERATION = "rate", "acceleration"


@dataclass(frozen=True, eq=False)
class PrescribedMotion:
    """Displacements of joints over time, as further inputs of a machine.

    Attributes:
        inputs: Generalised load ``(n,)`` of each rate and acceleration that acts.
        histories: Rate [m/s, rad/s] or acceleration [m/s^2, rad/s^2] over time, for each of ``inputs``.
        direct: What displacements add to outputs; one for each load.
    """

    inputs: Mapping[Channel, FloatArray] = field(default_factory=dict)
    histories: Mapping[Channel, LoadHistory] = field(default_factory=dict)
    direct: tuple[Feedthrough, ...] = ()


def prescribe_motion(
    machine: PoseModel,
    system: SecondOrderSystem,
    request: TransientRequest,
    probes: Sequence[str],
) -> PrescribedMotion:
    """Return the displacements among the loads of a request.

    Args:
        system: Of the machine, with all damping that acts over time.

    Raises:
        ModelError: A displacement jumps where it moves a mass.
    """
    scene = machine.parts.scene.machine
    moved = [load for load in request.loads if load.target in scene.displacements]
    coupled = machine.coupled
    if coupled is None or not moved:
        return PrescribedMotion()
    inputs: dict[Channel, FloatArray] = {}
    histories: dict[Channel, LoadHistory] = {}
    direct = []
    offsets = find_displacements(scene, coupled.fixed.springs)
    for load in moved:
        name = str(load.target)
        ((joint, offset),) = offsets[name].items()
        dofs = [int(dof) for dof in np.flatnonzero(offset)]
        travel = ErrorTravel(
            scene,
            np.zeros(1),
            ErrorPlaces({}, {}, {}, {}),
            tuple((joint, dof) for dof in dofs),
            np.inf,
        )
        motions, shares = find_offset_motions(coupled, travel, system), offset[dofs]
        history = load.history
        for kind, columns in ((RATE, motions.rates), (ACCELERATION, motions.accelerations)):
            column = columns @ shares
            if not column.any() and not motions.accelerations.any():
                break
            try:
                history = differentiate_load(history)
            except ModelError as error:
                raise ModelError(f"load {load.name}: displacement {name} {error}") from error
            inputs[name, kind], histories[name, kind] = column, history
        passed = pass_offsets(
            coupled, travel, motions, request.outputs, machine.joints, probe_values(probes)
        )
        values, rates = np.split(passed.shares, 2, axis=1)
        channels: tuple[Channel, ...] = ((name, LOAD),)
        parts = [values @ shares]
        if (name, RATE) in inputs:
            channels, parts = (*channels, (name, RATE)), [*parts, rates @ shares]
        direct.append(Feedthrough(passed.outputs, channels, np.column_stack(parts)))
    return PrescribedMotion(inputs, histories, tuple(direct))
