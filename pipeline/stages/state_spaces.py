"""State spaces of a machine between its channels, with those of its drives."""

from collections.abc import Callable, Sequence

from headstock.pipeline.stages.control import check_loops, drive_machine
from headstock.pipeline.stages.frf import add_load_inputs
from headstock.pipeline.stages.machine import damp_system
from headstock.pipeline.stages.run_state import PoseModel
from headstock.scene.exports import ExportMotors
from headstock.solvers.control.drive_loops import (
    close_loops,
    force_channels,
    open_plant,
    remove_anchors,
)
from headstock.solvers.control.drive_trains import MOTOR, SCALE
from headstock.solvers.second_order import Channel
from headstock.solvers.state_spaces.state_space import StateSpace, to_state_space


def make_state_space(
    model: PoseModel,
    *,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    up_to_hz: float,
    motors: ExportMotors = "locked",
    warn: Callable[[str], None],
) -> StateSpace:
    """Return the state space of a damped machine in a pose.

    With free motors the forces of drives are its first inputs, and motors and scales its last outputs.
    Under control set points of axes are its first inputs, and encoders, motors, slides and forces its
    last outputs.

    Args:
        up_to_hz: Modes up to here become states, the others act statically.

    Raises:
        UnstableControlError: A loop is unstable.
    """
    scene = model.parts.scene
    if motors == "locked":
        system = add_load_inputs(damp_system(scene, model.system), model.loads, inputs)
        return to_state_space(system, inputs=inputs, outputs=outputs, up_to_hz=up_to_hz)
    driven = drive_machine(model, warn)
    trains = driven.trains
    system = add_load_inputs(driven.system, driven.released.loads, inputs)
    scales = [(train.name, SCALE) for train in trains]
    if motors == "controlled":
        check_loops(driven, warn)
        moved = (*outputs, *scales)
        return close_loops(system, trains, inputs=inputs, outputs=moved, up_to_hz=up_to_hz).space
    plant = open_plant(
        system, trains, inputs=inputs, outputs=(*outputs, *scales), up_to_hz=up_to_hz
    )
    encoders = [(train.name, MOTOR) for train in trains]
    return remove_anchors(plant, trains).select(
        (*force_channels(trains), *inputs), (*outputs, *encoders, *scales)
    )
