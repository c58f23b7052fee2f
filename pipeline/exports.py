"""Files for other programs and scenes: a component as matrices or as a mesh, and a machine as a state
space or with the modes and responses of a test.
"""

import dataclasses
import io
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from headstock.geometry.loading import load_library
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import PointMass, SuperelementFile
from headstock.meshing.formats import find_format
from headstock.pipeline.exchange.files import encode_body
from headstock.pipeline.exchange.fmus import FmuModel, encode_fmu
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.stages.components import load_or_make_mesh
from headstock.pipeline.stages.frf import add_load_inputs
from headstock.pipeline.stages.machine import couple_pose, damp_system
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.storage.outputs import (
    OutputError,
    PendingOutputs,
    check_output,
    naming_output,
    write_output,
)
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store
from headstock.pipeline.test_data_export import export_test_data
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.exports import DEFAULT_STEP_S, EXPORT_FORMATS, Export
from headstock.scene.reading.findings import Findings, SceneError
from headstock.scene.scene import Analyses, Scene, require_name
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.held_inputs import hold_inputs
from headstock.solvers.linear.state_space import StateSpace, to_state_space
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root, share_from_root
from headstock.solvers.second_order import Channel, name_channel

# loaded only where a mesh is written: it takes meshio and netCDF4 with it
WRITING_MODULE = "headstock.meshing.files.writing"
FMUS = {"fmu3": 3, "fmu2": 2}


def export(
    scene: Scene,
    wanted: Export,
    path: Path,
    *,
    comm: MPI.Comm,
    store: Store | None = None,
    origin: Provenance | None = None,
) -> str:
    """Write what is asked for; collective.

    Args:
        scene: The same on every rank.
        path: File to write, whole or not at all; of several files what their names begin with.
        store: Where meshes and superelements are kept; by default the user's.

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        SceneError: There is no such component or pose.
        HeadstockError: A computation or a file failed.
    """
    of = wanted.kind.of
    if of == "mesh":
        return export_mesh(scene, wanted.component, path, comm=comm, store=store)
    if of == "test":
        return export_test_data(scene, path, pose=wanted.pose, comm=comm, store=store)
    if of == "body":
        return export_superelement(
            scene,
            wanted.component or "",
            path,
            comm=comm,
            form=wanted.format,
            store=store,
            origin=origin,
        )
    return export_state_space(
        scene,
        path,
        up_to_hz=wanted.hz or 0.0,
        pose=wanted.pose,
        comm=comm,
        form=wanted.format,
        step_s=wanted.step or DEFAULT_STEP_S,
        store=store,
        origin=origin,
    )


def export_state_space(
    scene: Scene,
    path: Path,
    *,
    up_to_hz: float,
    pose: str | None,
    comm: MPI.Comm,
    form: str = "mat",
    step_s: float = DEFAULT_STEP_S,
    store: Store | None = None,
    origin: Provenance | None = None,
) -> str:
    """Write the state space between the channels of ``[analyses.frf]``, or x, y and z of every point,
    as a file or an FMU.

    Args:
        scene: The same on every rank; its damping counts.
        path: File to write, whole or not at all.
        up_to_hz: Modes up to here become states, the others act statically.
        pose: Name of a pose; default: the first.
        form: One of those of state spaces.
        step_s: Of an FMU, over which it holds its inputs [s].

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        SceneError: There is no such pose.
        ModelError: There is no point.
        HeadstockError: A computation or the file failed.
    """
    name = pose or next(iter(scene.poses))
    require_name(scene, "poses", name, scene.poses)
    check_output(path)
    inputs, outputs = _channels(scene)
    request = FrfRequest(inputs, outputs, up_to_hz, poses=(name,))
    wanted = dataclasses.replace(scene, analyses=Analyses(request))
    state = start_run(wanted, comm, store)
    make_superelements(state)
    text = ""
    if state.is_root:
        if scene.is_lumped:
            raise ModelError(
                "a state space is exported for machines of coupled components only, not for a lumped mechanism"
            )
        coupled = couple_pose(state.parts, state.plan.poses[name]).coupled
        system = add_load_inputs(damp_system(scene, coupled.system), coupled.loads, inputs)
        space = to_state_space(system, inputs=inputs, outputs=outputs, up_to_hz=up_to_hz)
        write_output(path, _encode_space(space, form, step_s, scene.name, origin))
        sizes = f"{len(space.a)} states, {len(space.inputs)} inputs, {len(space.outputs)} outputs"
        text = f"{path}: pose {name}, {sizes}, modes up to {up_to_hz:g} Hz"
        if EXPORT_FORMATS[form].stepped:
            text += f"; inputs held over {1e3 * step_s:g} ms, a delay of {180.0 * step_s:.3g} deg per Hz"
    return str(share_from_root(comm, text))


def _encode_space(
    space: StateSpace, form: str, step_s: float, name: str, origin: Provenance | None
) -> bytes:
    """Return a state space as a file of a form."""
    if form == "npz":
        image = io.BytesIO()
        np.savez(
            image,
            A=space.a, B=space.b, C=space.c, D=space.d, states=np.array(space.states),
            inputs=np.array(list(map(name_channel, space.inputs))),
            outputs=np.array(list(map(name_channel, space.outputs))),
        )  # fmt: skip
        return image.getvalue()
    if form in FMUS:
        inputs, outputs = (
            tuple(
                (f"{kind}.{channel[0]}.{channel[1]}", units["r" in channel[1]])
                for channel in channels
            )
            for kind, channels, units in (
                ("force", space.inputs, ("N", "N.m")),
                ("motion", space.outputs, ("m", "rad")),
            )
        )
        words = f"{name}: forces in, motions out; inputs are held over {step_s:g} s"
        model = FmuModel(name, hold_inputs(space, step_s), inputs, outputs, words)
        return encode_fmu(model, FMUS[form])
    return _encode_mat(space, origin)


def _encode_mat(space: StateSpace, origin: Provenance | None = None) -> bytes:
    """A state space as a MATLAB 5 file: ``sys = ss(A, B, C, D, 'InputName', inputs, ...)``; where
    it comes from as a structure.
    """
    image = io.BytesIO()
    names = {"inputs": space.inputs, "outputs": space.outputs}
    cells = {
        key: np.array([name_channel(channel) for channel in channels], dtype=object)
        for key, channels in names.items()
    }
    states = np.array(space.states, dtype=object)
    content: dict[str, Any] = {
        "A": space.a,
        "B": space.b,
        "C": space.c,
        "D": space.d,
        **cells,
        "states": states,
    }
    if origin is not None:
        words = origin.summarise_for_export()
        content["provenance"] = {
            key: np.array(value, dtype=object)
            if isinstance(value, list)
            else ""
            if value is None
            else value
            for key, value in words.items()
        }
    scipy.io.savemat(image, content)
    return image.getvalue()


def _channels(scene: Scene) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
    if FrfRequest in scene.analyses:
        return scene.analyses[FrfRequest].inputs, scene.analyses[FrfRequest].outputs
    channels = tuple((point, direction) for point in scene.machine.points for direction in "xyz")
    if not channels:
        raise ModelError(
            "there is no point whose motion could be an output; write [points], or [analyses.frf] with inputs"
        )
    return channels, channels


def export_superelement(
    scene: Scene,
    component: str,
    path: Path,
    *,
    comm: MPI.Comm,
    form: str = "h5",
    store: Store | None = None,
    origin: Provenance | None = None,
) -> str:
    """Reduce a component as its scene says and write it; read it back with ``solid = { superelement
    = "x.h5" }``.

    Args:
        scene: The scene; the same on every rank.
        path: File to write, whole or not at all; of several files what their names begin with.
        form: One of those of bodies.
        store: Where meshes and superelements are kept; by default the user's.

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        SceneError: The scene has no such component.
        HeadstockError: The reduction or the file failed.
    """
    if not path.absolute().parent.is_dir():
        raise OutputError(f"{path} cannot be written: there is no folder {path.parent}")
    check_output(path)
    # the masses of sensors belong to the test, not to the part
    bare = dataclasses.replace(scene.machine, probes={}, sensors={})
    scene = dataclasses.replace(scene, machine=bare)
    plan = plan_scene(scene)
    require_name(scene, "components", component, plan.components)
    state = start_run(scene, comm, store, plan=plan)
    made = make_superelements(state, only=[component])
    text = ""
    if state.is_root:
        superelement = made[component]
        files = encode_body(superelement, form, origin)
        # a single file is called what it was asked to be
        single = len(files) == 1
        names = [path.name] if single else [path.stem + ending for ending in files]
        with naming_output(path), PendingOutputs() as pending:
            for name, content in zip(names, files.values(), strict=True):
                pending.add(path.with_name(name), content)
            pending.publish()
        written = ", ".join(str(path.with_name(name)) for name in names)
        text = (
            f"{written}: {component}, {superelement.full_dofs} -> {len(superelement.labels)} dofs"
        )
    return str(share_from_root(comm, text))


def export_mesh(
    scene: Scene,
    component: str | None,
    path: Path,
    *,
    comm: MPI.Comm,
    store: Store | None = None,
) -> str:
    """Write the mesh of a component with its patches as named sets, in metres.

    Args:
        scene: The scene; the same on every rank.
        component: Name of one of its components; None for the only one that has a shape.
        path: File to write, whole or not at all; its ending chooses the format.
        comm: Collective; rank 0 meshes and writes.
        store: Where meshes are kept; by default the user's.

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        SceneError: The scene has no such component, or it has no shape.
        MeshError: It cannot be meshed, or the format cannot hold the mesh.
        OutputError: The file cannot be written.
    """
    find_format(path, written=True)
    if not path.absolute().parent.is_dir():
        raise OutputError(f"{path} cannot be written: there is no folder {path.parent}")
    check_output(path)
    plan = plan_scene(scene)
    shaped = [
        name
        for name, part in plan.components.items()
        if not isinstance(part.solid, SuperelementFile | PointMass)
    ]
    if component is None and len(shaped) == 1:
        (component,) = shaped
    if component is None:
        findings = Findings(str(scene.path))
        listed = ", ".join(shaped) or "none"
        findings.add(("components",), f"name the one to mesh; those with a shape: {listed}")
        raise SceneError(problem for _, problem in findings.problems)
    require_name(scene, "components", component, shaped)
    state = start_run(scene, comm, store, plan=plan)
    return make_on_root(comm, partial(_write_mesh, state, plan.components[component], path))


def _write_mesh(state: RunState, component: Component, path: Path) -> str:
    writing = load_library(WRITING_MODULE)
    mesh, _ = load_or_make_mesh(state, component)
    with naming_output(path), PendingOutputs() as pending:
        for name, content in writing.encode_mesh(mesh, path).items():
            pending.add(path.with_name(name), content)
        pending.publish()
    sets = ", ".join(mesh.patches) or "none"
    size = f"{len(mesh.cells)} {mesh.kind}, {len(mesh.points)} nodes in metres"
    return f"{path}: {component.name}, {size}, sets: {sets}"
