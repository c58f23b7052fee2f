"""The state space of a machine: found, written as a file or as an FMU."""

import dataclasses
from pathlib import Path

from headstock.pipeline.exchange.fmus import FmuModel, encode_fmu
from headstock.pipeline.exchange.state_spaces import (
    MachineStateSpace,
    describe_space,
    encode_mat,
    encode_npz,
)
from headstock.pipeline.stages.machine import couple_pose
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.stages.state_spaces import make_state_space
from headstock.pipeline.storage.outputs import check_output, write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.exports import DEFAULT_STEP_S, Export
from headstock.scene.reading.findings import Findings
from headstock.scene.scene import Analyses, Scene, require_name
from headstock.solvers.errors import ModelError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.solvers.second_order import Channel

FMUS = {"fmu3": 3, "fmu2": 2}
SAMPLES = 0.5  # periods of the highest mode that a step may last: below, it is seen as it vibrates


def find_state_space(
    scene: Scene, wanted: Export, *, comm: MPI.Comm, store: Store | None = None
) -> MachineStateSpace:
    """Return the state space between the channels of ``[analyses.frf]``, or x, y and z of every point;
    on every rank.

    Args:
        scene: The same on every rank; its damping counts.
        store: Where superelements are kept; by default the user's.

    Raises:
        SceneError: There is no such pose, or a mode vibrates faster than half the sampling rate.
        ModelError: There is no point.
        HeadstockError: A computation failed.
    """
    name, up_to_hz = wanted.pose or next(iter(scene.poses)), wanted.hz or 0.0
    require_name(scene, "poses", name, scene.poses)
    _require_drives(scene, wanted)
    inputs, outputs = _channels(scene)
    request = FrfRequest(inputs, outputs, up_to_hz, poses=(name,))
    state = start_run(dataclasses.replace(scene, analyses=Analyses(request)), comm, store)
    make_superelements(state)

    def find() -> MachineStateSpace:
        if scene.is_lumped:
            raise ModelError(
                "a state space is exported for machines of coupled components only, not for a lumped mechanism"
            )
        space = make_state_space(
            couple_pose(state.parts, state.plan.poses[name]),
            inputs=inputs,
            outputs=outputs,
            up_to_hz=up_to_hz,
            motors=wanted.motors,
            warn=state.warn,
        )
        record = describe_space(
            space,
            pose=scene.poses[name],
            step_s=wanted.step,
            balanced=wanted.balanced,
            rotary=_list_rotary(scene),
        )
        if wanted.step is not None:
            _require_short(scene, wanted.step, record.highest_hz)
        return record

    return make_on_root(comm, find)


def _require_drives(scene: Scene, wanted: Export) -> None:
    """Refuse free or controlled motors of a scene without drives.

    Raises:
        SceneError: It has none.
    """
    if wanted.motors != "locked" and not scene.drives:
        findings = Findings(str(scene.path))
        findings.add(
            ("effects", "drive_control"),
            f"no drive has a motor that is {wanted.motors}; describe one in [drives.NAME] and write drive_control = true",
        )
        findings.raise_if_any()


def _list_rotary(scene: Scene) -> set[str]:
    """Return the rotary axes and their drives."""
    axes = {name for name, axis in scene.machine.axes.items() if axis.kind == "rotary"}
    return axes | {drive.name for drive in scene.drives.values() if drive.axis in axes}


def _require_short(scene: Scene, step_s: float, highest_hz: float) -> None:
    """Refuse a step that samples a mode less than twice in a period.

    Raises:
        SceneError: It does.
    """
    if step_s * highest_hz >= SAMPLES:
        findings = Findings(str(scene.path))
        findings.add(
            ("step",),
            f"{1e3 * step_s:g} ms is too long for a mode at {highest_hz:.4g} Hz; "
            f"write a step below {1e3 * SAMPLES / highest_hz:.3g} ms, or a lower highest frequency",
        )
        findings.raise_if_any()


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
    if wanted.format in FMUS:
        wanted = dataclasses.replace(wanted, step=wanted.step or DEFAULT_STEP_S)
    record = find_state_space(scene, wanted, comm=comm, store=store)

    def write() -> None:
        if wanted.format in FMUS:
            content = encode_fmu(FmuModel(scene.name, record), FMUS[wanted.format])
        elif wanted.format == "npz":
            content = encode_npz(record.contents)
        else:
            content = encode_mat(record.contents, origin)
        write_output(path, content)

    make_on_root(comm, write)
    sizes = f"{len(record.A)} states, {len(record.inputs)} inputs, {len(record.outputs)} outputs"
    text = f"{path}: pose {record.pose}, {sizes}, modes up to {wanted.hz:g} Hz"
    text += f"; motors {wanted.motors}" if scene.drives else ""
    if wanted.balanced is not None:
        text += f"; balanced: error at most {100.0 * record.bound:.2g} % of the largest response"
    if record.step is not None:
        text += f"; inputs held over {1e3 * record.step:g} ms, a delay of {180.0 * record.step:.3g} deg per Hz"
    return text


def _channels(scene: Scene) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
    if FrfRequest in scene.analyses:
        return scene.analyses[FrfRequest].inputs, scene.analyses[FrfRequest].outputs
    channels = tuple((point, direction) for point in scene.machine.points for direction in "xyz")
    if not channels:
        raise ModelError(
            "there is no point whose motion could be an output; write [points], or [analyses.frf] with inputs"
        )
    return channels, channels
