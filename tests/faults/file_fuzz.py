"""Mesh, superelement, STEP, force, path and target files damaged at random: read, or refused by
name; the process that asks never falls.
"""

import random
import resource
from pathlib import Path

import meshio
import numpy as np

from faults.mutations import mutate_bytes, mutate_text
from faults.runs import FaultError, Outcome
from faults.scene_fuzz import MACHINES
from fixture_machines import stored_scene
from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import DOF_NAMES, Frame
from headstock.geometry.parts.components import Component, Material
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.components.meshing import describe_component, mesh_component
from headstock.pipeline.planning.resources import peak_memory_mb
from headstock.pipeline.storage.superelements import read_superelement, write_superelement
from headstock.reduction.superelement import InterfaceMap, Superelement
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.csv_files import read_forces
from headstock.scene.reading.findings import SceneError
from headstock.studies.identification.target_files import load_targets
from headstock.validation.parts.structured_meshes import lattice_mesh, straight_lattice

SIZE = (0.04, 0.06, 0.2)
# the last two of a 10-node tet come in another order than gmsh's
TET10_ORDER = (0, 1, 2, 3, 4, 5, 6, 7, 9, 8)
SECONDS_ALLOWED = 10.0
MB_ALLOWED = 1024.0
STEEL = Material("steel", 2.1e11, 0.3, 7850.0)
FORCES, PATH, TARGETS = "forces.csv", "path.csv", "targets.toml"
KINDS = ("part.msh", "part.inp", "part.bdf", "part.h5", FORCES, PATH, TARGETS)
STEP = "part.step"
STEP_EVERY = 10  # the shipped STEP part takes a second to read
# beside the path: a rotary axis and one without limits; small enough to load in milliseconds
PATH_SCENE = stored_scene("file_fuzz_path_scene")


def write_meshes(folder: Path) -> None:
    """Write a box of 10-node tets with its corner at the origin [m] in three formats."""
    box = lattice_mesh(straight_lattice((1, 2, 4), SIZE), "tet10", straight=True)
    numbers = [np.full(len(box.cells), 99)]
    mesh = meshio.Mesh(
        box.points,
        [("tetra10", box.cells[:, TET10_ORDER])],
        cell_data={"gmsh:physical": numbers, "gmsh:geometrical": numbers},
        field_data={"solid": np.array([99, 3])},
    )
    mesh.write(folder / "part.msh", file_format="gmsh22", binary=False)
    for name in ("part.inp", "part.bdf"):
        mesh.write(folder / name)


def forces_text() -> str:
    """Text of a file of measured forces, a hundred samples long."""
    rows = [f"{1e-3 * i!r},{(17 * i) % 50},{-3.5 * i},1e1" for i in range(100)]
    return "\n".join(["time [s],fx,fy,fz", *rows, ""])


def path_text() -> str:
    """Text of a file of forty waypoints of a linear and a rotary axis."""
    rows = [f"{1.5 * ((7 * i) % 40):g},{-90 + 4.5 * i:g}" for i in range(40)]
    return "\n".join(["X [mm],C [deg]", *rows, ""])


def box_superelement() -> Superelement:
    """A superelement of one interface and two modes of 100 and 200 Hz whose other numbers mean
    nothing.
    """
    numbers = np.arange(64.0).reshape(8, 8)
    numbers[6:, 6:] = np.diag(0.5 * (2.0 * np.pi * np.array([100.0, 200.0])) ** 2)
    labels = (*(("foot", dof) for dof in DOF_NAMES), ("mode", "1"), ("mode", "2"))
    return Superelement(
        name="column",
        labels=labels,
        frames=(Frame(),),
        interface_maps={"foot": InterfaceMap(0, Frame())},
        stiffness=numbers + numbers.T,
        mass=np.eye(8),
        constraints=np.zeros((0, 8)),
        modal_frequencies_hz=np.array([100.0, 200.0]),
        cutoff_hz=300.0,
        full_dofs=100,
        mass_kg=1.0,
        center_of_mass=np.zeros(3),
        inertia=np.eye(3),
        residual=1e-12,
    )


def write_samples(folder: Path) -> dict[str, bytes]:
    """Content of a sound file by its name; STEP files and targets are not among them."""
    write_meshes(folder)
    (folder / FORCES).write_text(forces_text())
    (folder / PATH).write_text(path_text())
    write_superelement(folder / "part.h5", box_superelement())
    return {name: (folder / name).read_bytes() for name in KINDS if name != TARGETS}


def run_file_fuzz(runs: int, *, seed: int, root: Path) -> Outcome:
    """Read damaged files of each kind in turn.

    A fault is anything but success or a named error, more than ``SECONDS_ALLOWED`` of processor
    time, or a process that grows beyond ``MB_ALLOWED``. Readers of superelements, forces, paths and
    targets run in this process, the first once a child has survived the file."""
    outcome, samples, earlier_mb = Outcome(), write_samples(root), _largest_child_mb()
    (root / "scene.toml").write_text(PATH_SCENE)
    steps = sorted(MACHINES.glob("*.step"))
    if steps:
        samples[STEP] = steps[0].read_bytes()
    samples[TARGETS] = (MACHINES / "three_axis_targets.toml").read_bytes()
    for kind, content in samples.items():
        ending = try_file(root / kind, content)
        if ending != "read":
            raise FaultError(f"a sound {kind} is not read: {ending}")
    for number in range(runs):
        kind = STEP if steps and number % STEP_EVERY == 0 else KINDS[number % len(KINDS)]
        damaged = _damage(kind, samples[kind], random.Random(f"{seed}/{number}"))
        before = _used_seconds()
        try:
            ending = try_file(root / kind, damaged)
        except Exception as error:
            ending = f"{type(error).__name__}: {str(error)[:300]}"
            outcome.faults.append(f"file {number} ({kind}): {ending}")
        seconds = _used_seconds() - before
        outcome.note_trial(f"{kind} {ending.partition(':')[0]}", seconds=seconds)
        if seconds > SECONDS_ALLOWED:
            outcome.faults.append(f"file {number} ({kind}) took {seconds:.1f} s")
    outcome.peak_mb = _largest_child_mb()
    # the largest of all children there ever were, each starting at the size of the process that
    # forked it
    if outcome.peak_mb > max(MB_ALLOWED, earlier_mb, peak_memory_mb()):
        outcome.faults.append(
            f"a reader grew to {outcome.peak_mb:.0f} MB, {MB_ALLOWED:.0f} are allowed"
        )
    return outcome


def try_file(path: Path, content: bytes) -> str:
    """Write and read a file as a scene would; how it ended."""
    path.write_bytes(content)
    try:
        if path.suffix == ".h5":
            read_superelement(path)
        elif path.name == FORCES:
            read_forces(path)
        elif path.name == PATH:
            load_scene(path.with_name("scene.toml"))
        elif path.name == TARGETS:
            load_targets(path, MACHINES / "three_axis.toml")
        elif path.suffix == ".step":
            describe_component(Component("part", StepFile(path), STEEL))
        else:
            mesh_component(Component("part", MeshFile(path, 1.0), STEEL))
    except (HeadstockError, SceneError) as error:
        return f"refused: {error}"
    return "read"


def _damage(kind: str, content: bytes, chance: random.Random) -> bytes:
    # half of the paths as a hand damages text, the others as a disk does
    if kind != TARGETS and not (kind == PATH and chance.random() < 0.5):
        return mutate_bytes(content, chance)
    text = content.decode()
    return mutate_text(text, (text,), chance).encode(errors="surrogatepass")


def _used_seconds() -> float:
    """Processor time of this process and of all children that ended."""
    usages = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def _largest_child_mb() -> float:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0
