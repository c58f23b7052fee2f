"""Displacements of joints over time, as further inputs of a machine."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from headstock.geometry.frames import FloatArray
from headstock.pipeline.motion.probe_motions import probe_values
from headstock.pipeline.stages.control import DrivenMachine
from headstock.pipeline.stages.prescribed import list_parts, place_displacement
from headstock.pipeline.stages.run_state import PoseModel
from headstock.scene.analyses.transient import TransientRequest
from headstock.solvers.errors import ModelError
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.state_spaces.load_history import LoadHistory, differentiate_load
from headstock.solvers.state_spaces.state_space import Feedthrough


@dataclass(frozen=True, eq=False)
class PrescribedMotion:
    """Displacements of joints over time.

    Attributes:
        inputs: Generalised load ``(n,)`` of each displacement, and of each rate and acceleration that
            acts.
        histories: Rate [m/s, rad/s] or acceleration [m/s^2, rad/s^2] over time, where it acts.
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
    driven: DrivenMachine | None,
) -> PrescribedMotion:
    """Return the displacements among the loads of a request.

    Args:
        system: Of the machine, with all damping that acts over time.
        driven: The machine with motors under control; None where they are locked.

    Raises:
        ModelError: A displacement jumps where it moves a mass.
    """
    inputs: dict[Channel, FloatArray] = {}
    histories: dict[Channel, LoadHistory] = {}
    direct = []
    displacements = machine.parts.scene.machine.displacements
    for load in request.loads:
        name = str(load.target)
        if name not in displacements:
            continue
        placed = place_displacement(
            machine,
            system,
            name,
            outputs=request.outputs,
            probes=probe_values(probes),
            driven=driven,
            with_joints=True,
        )
        value, *derivatives = list_parts(name)
        inputs[value], history = placed.inputs[value], load.history
        for channel in derivatives:
            if not placed.loads[:, derivatives.index(channel) + 1 :].any():
                break
            try:
                history = differentiate_load(history)
            except ModelError as error:
                raise ModelError(f"load {load.name}: displacement {name} {error}") from error
            inputs[channel], histories[channel] = placed.inputs[channel], history
        # a rate that does not act has no history, and moves nothing at once
        kept = [channel for channel in placed.direct.inputs if channel in inputs]
        direct.append(
            Feedthrough(placed.direct.outputs, tuple(kept), placed.direct.shares[:, : len(kept)])
        )
    return PrescribedMotion(inputs, histories, tuple(direct))
