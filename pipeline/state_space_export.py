"""The state space of a machine: found, written as a file or as an FMU."""

import dataclasses
import itertools
from pathlib import Path

from headstock.geometry.machine.machine import Pose
from headstock.pipeline.exchange.fmu_numbers import fixed_model, varying_model
from headstock.pipeline.exchange.fmus import encode_fmu
from headstock.pipeline.exchange.state_spaces import (
    MachineStateSpace,
    describe_space,
    encode_mat,
    encode_npz,
    find_fastest_hz,
)
from headstock.pipeline.exchange.varying_spaces import VaryingStateSpace
from headstock.pipeline.stages.machine import couple_pose
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.stages.state_spaces import make_state_space
from headstock.pipeline.storage.outputs import check_output, write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store
from headstock.pipeline.varying_state_space import find_varying_state_space
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.building.exports import require_space
from headstock.scene.exports import DEFAULT_STEP_S, SAMPLES, Export, find_step_fault
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Analyses, Scene, require_name
from headstock.solvers.control.drive_trains import DRIVE_CHANNELS
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.solvers.second_order import Channel

FMUS = {"fmu3": 3, "fmu2": 2}


def find_state_space(
    scene: Scene, wanted: Export, *, comm: MPI.Comm, store: Store | None = None
) -> MachineStateSpace:
    """Return the state space in a pose between the channels of ``[analyses.frf]``, or x, y and z of
    every point; on every rank.

    Args:
        scene: The same on every rank; its damping counts.
        store: Where superelements are kept; by default the user's.

    Raises:
        SceneError: The machine cannot have it, there is no such pose, or a mode vibrates faster than
            half the sampling rate.
        HeadstockError: A computation failed.
    """
    require_space(scene, wanted)
    pose, (inputs, outputs) = _find_pose(scene, wanted), _channels(scene)
    state = _reduce(scene, wanted, comm, store)

    def find() -> MachineStateSpace:
        space = make_state_space(
            couple_pose(state.parts, pose),
            inputs=inputs,
            outputs=outputs,
            up_to_hz=wanted.hz or 0.0,
            motors=wanted.motors,
            warn=state.warn,
        )
        fastest_hz = find_fastest_hz(space)
        record = describe_space(
            space,
            pose=pose,
            step_s=_choose_step(wanted, fastest_hz),
            balanced=wanted.balanced,
            rotary=_list_rotary(scene),
        )
        _require_short(scene, wanted, fastest_hz)
        return record

    return make_on_root(comm, find)


def _list_rotary(scene: Scene) -> set[str]:
    """Return the rotary axes and their drives."""
    axes = {name for name, axis in scene.machine.axes.items() if axis.kind == "rotary"}
    return axes | {drive.name for drive in scene.drives.values() if drive.axis in axes}


def find_varying(
    scene: Scene, wanted: Export, *, comm: MPI.Comm, store: Store | None = None
) -> VaryingStateSpace:
    """Return the state space along the travel of some axes; see ``find_state_space``.

    Raises:
        SceneError: The machine cannot have it, or the step is too long.
    """
    require_space(scene, wanted)
    pose, channels = _find_pose(scene, wanted), _channels(scene)
    wanted = dataclasses.replace(wanted, step=_choose_step(wanted, wanted.hz or 0.0))
    state = _reduce(scene, wanted, comm, store)
    return make_on_root(
        comm,
        lambda: find_varying_state_space(state, wanted, channels, pose, _list_rotary(scene)),
    )


def _find_pose(scene: Scene, wanted: Export) -> Pose:
    name = wanted.pose or next(iter(scene.poses))
    require_name(scene, "poses", name, scene.poses)
    return scene.poses[name]


def _reduce(scene: Scene, wanted: Export, comm: MPI.Comm, store: Store | None) -> RunState:
    """Reduce the components of a machine for responses up to a frequency; collective."""
    pose, (inputs, outputs) = _find_pose(scene, wanted), _channels(scene)
    request = FrfRequest(inputs, outputs, wanted.hz or 0.0, poses=(pose.name,))
    state = start_run(dataclasses.replace(scene, analyses=Analyses(request)), comm, store)
    make_superelements(state)
    return state


def _choose_step(wanted: Export, fastest_hz: float) -> float | None:
    """Return the step that is asked for; of an FMU otherwise the longest of 1, 0.5, 0.2, 0.1 ms ...
    that is not too long for the fastest mode. None for continuous time [s].
    """
    if wanted.step is not None or wanted.format not in FMUS:
        return wanted.step
    steps = (
        DEFAULT_STEP_S * share / 10.0**power
        for power in itertools.count()
        for share in (1, 0.5, 0.2)
    )
    return next(step for step in steps if step * fastest_hz < SAMPLES)


def _require_short(scene: Scene, wanted: Export, highest_hz: float) -> None:
    """Refuse a step that samples a mode less than twice in a period.

    Raises:
        SceneError: It does.
    """
    if fault := find_step_fault(wanted.step or 0.0, highest_hz):
        # modes of control loops are as fast whatever the frequency up to which modes count
        other = ", or a lower highest frequency" if highest_hz <= (wanted.hz or 0.0) else ""
        raise SceneError([scene.findings.describe(("step",), fault + other)])


def export_state_space(
    scene: Scene,
    wanted: Export,
    path: Path,
    *,
    comm: MPI.Comm,
    store: Store | None = None,
    origin: Provenance | None = None,
) -> str:
    """Write a state space as a file or an FMU, whole or not at all; see ``find_state_space``.

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        HeadstockError: A computation or the file failed.
    """
    check_output(path)
    find = find_varying if wanted.travel else find_state_space
    record = find(scene, wanted, comm=comm, store=store)

    def write() -> None:
        if wanted.format in FMUS:
            model = (
                varying_model(scene.name, record)
                if isinstance(record, VaryingStateSpace)
                else fixed_model(scene.name, record)
            )
            content = encode_fmu(model, FMUS[wanted.format])
        elif wanted.format == "npz":
            content = encode_npz(record.contents)
        else:
            content = encode_mat(record.contents, origin)
        write_output(path, content)

    make_on_root(comm, write)
    return f"{path}: {_summarise(record, wanted, has_drives=bool(scene.drives))}"


def _summarise(
    record: MachineStateSpace | VaryingStateSpace, wanted: Export, *, has_drives: bool
) -> str:
    """Return what was written in a few words, with errors and the delay of a step."""
    parts = [f"modes up to {wanted.hz:g} Hz"]
    if isinstance(record, VaryingStateSpace):
        states = 2 * len(record.matrices.stiffness)
        where = f"travel of {', '.join(record.axes)}"
        error = f"frozen-pose error {100.0 * record.frozen_pose_error:.2g} % in {record.held_out} poses between those of the basis"
        if record.frozen_pose_error > record.target:
            error += (
                f", more than the {100.0 * record.target:g} % asked for: the budget of {record.solved} poses is spent; "
                "let fewer axes travel, or write a lower hz or a larger error"
            )
        parts.append(error)
    else:
        states, where = len(record.A), f"pose {record.pose}"
        if wanted.balanced is not None:
            parts.append(
                f"balanced: error at most {100.0 * record.bound:.2g} % of the largest response"
            )
    parts += [f"motors {wanted.motors}"] if has_drives else []
    if record.step is not None:
        parts.append(
            f"inputs held over {1e3 * record.step:g} ms, a delay of {180.0 * record.step:.3g} deg per Hz"
        )
    sizes = f"{states} states, {len(record.inputs)} inputs, {len(record.outputs)} outputs"
    return f"{where}, {sizes}, {'; '.join(parts)}"


def _channels(scene: Scene) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
    """Return those of the frequency response but channels of drives, on which motors decide."""
    if FrfRequest in scene.analyses:
        request = scene.analyses[FrfRequest]
        inputs, outputs = (
            tuple(channel for channel in channels if channel[1] not in DRIVE_CHANNELS)
            for channels in (request.inputs, request.outputs)
        )
        return inputs, outputs
    channels = tuple((point, direction) for point in scene.machine.points for direction in "xyz")
    return channels, channels
