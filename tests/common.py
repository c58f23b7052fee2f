"""What tests share: what has to be there, small structured meshes with tagged patches, their dense
matrices.
"""

import contextlib
import csv
import dataclasses
import io
import json
import os
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, SupportsFloat, cast

import h5py
import numpy as np
import pytest
import scipy.linalg
from _pytest.capture import CaptureResult
from mpi4py import MPI

from fixture_machines import write_scene
from headstock.app.command_line import main
from headstock.app.pictures import pictures
from headstock.app.pictures import worker as renderer
from headstock.geometry.frames import BoolArray, FloatArray, rigid_map
from headstock.geometry.parts.components import (
    Component,
    Interface,
    Material,
    Patch,
    ReductionSettings,
)
from headstock.geometry.parts.solids import Box, Solid
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.elements.surface import extract_surface
from headstock.meshing.process import worker
from headstock.meshing.process.isolation import WorkerEnd, WorkerLimits
from headstock.validation.parts.structured_meshes import (
    integrate_over_cells,
    lattice_mesh,
    straight_lattice,
)

RUN_RENDERER = pictures._run
Done = subprocess.CompletedProcess[str]
STEEL = Material("steel", 2.1e11, 0.3, 7850.0)
# a side such as ``z+``, or from facet centres ``(n, 3)`` those wanted
Choice = str | Callable[[FloatArray], BoolArray]

# scenes, without targets and the fits beside them
SHIPPED = sorted(
    path
    for path in (Path(__file__).parents[1] / "machines").glob("*.toml")
    if not path.stem.endswith("_targets") and "." not in path.stem
)


def run_process(command: Sequence[str | Path], *, check: bool = False, **options: Any) -> Done:
    """Run a program to its end, with what it prints as text, whatever bytes there are."""
    options |= {"capture_output": True, "text": True, "errors": "replace"}
    return subprocess.run(command, check=check, **options)


def place_launcher(folder: Path) -> Path:
    """A folder in which ``./headstock`` can be typed."""
    program = folder / "headstock"
    started = f'"{sys.executable}" -P -m headstock.app.command_line'
    program.write_text(f'#!/bin/sh\nexec {started} "$@"\n')
    program.chmod(0o755)
    return folder


def run_in(folder: Path, *command: str, **variables: str) -> str:
    """What a command prints that ends well in a folder, with the store of all such commands beside it:
    parts of shipped machines that one test reduced serve the next.
    """
    paths = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    own = {**os.environ, **paths, "HEADSTOCK_STORE": str(folder.parent / "store"), **variables}
    done = run_process(command, cwd=folder, env=own, timeout=300)
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done.stdout


def rank_words(ranks: int) -> list[str]:
    """How MPI starts Python on so many ranks, which share cores: MPICH lets them without being told."""
    mpirun = shutil.which("mpirun")
    assert mpirun is not None
    shared = ["--oversubscribe"] if "Open MPI" in MPI.Get_library_version() else []
    return [mpirun, *shared, "--bind-to", "none", "-n", str(ranks), sys.executable]


def run_on_ranks(ranks: int, folder: Path, *program: str) -> Done:
    """A Python program on so many ranks, with a store of their own, started as the launcher does."""
    start = Path(__file__).parents[1] / "environment" / "start_ranks.sh"
    variables = {
        **os.environ,
        "HEADSTOCK_STORE": str(folder / f"store{ranks}"),
        "OMP_NUM_THREADS": "1",
        "HEADSTOCK_THREADS": "1",  # the core of a sleeping rank would change the last digits
    }
    command = ["/bin/sh", str(start), *rank_words(ranks), "-P", *program]
    return run_process(command, timeout=120, env=variables)


def run_alone(folder: Path, *words: str) -> Done:
    """A command in this process, with the store and the thread that `run_on_ranks` gives one rank."""
    printed, said = io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(said),
    ):
        patch.setenv("HEADSTOCK_STORE", str(folder / "store1"))
        patch.setenv("HEADSTOCK_THREADS", "1")
        code = main([*words])
    return subprocess.CompletedProcess(words, code, printed.getvalue(), said.getvalue())


def run_once(folder: Path, text: str, *words: str) -> Path:
    """The results of a scene that several tests look at."""
    scene, out = write_scene(folder, text), folder / "out"
    done = run_alone(folder, "run", str(scene), "-o", str(out), "--no-figures", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def run_command(ranks: int, folder: Path, *words: str) -> Done:
    """A command on so many ranks, on one in this process: starting it takes longer than the command."""
    if ranks == 1:
        return run_alone(folder, *words)
    return run_on_ranks(ranks, folder, "-m", "mpi4py", "-m", "headstock.app.command_line", *words)


def read_json(path: Path) -> Any:
    return json.loads(path.read_text())


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file by their headings."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def read_datasets[T](path: Path, take: Callable[[h5py.Dataset], T]) -> dict[str, T]:
    """What is taken of each array of an HDF5 file, by its name."""
    found: dict[str, T] = {}

    def keep(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = take(item)

    with h5py.File(path) as file:
        file.visititems(keep)
    return found


def read_units(path: Path) -> dict[str, str | None]:
    """Unit of each array of an HDF5 file; None for one without."""
    return read_datasets(path, lambda item: item.attrs.get("unit"))


class Shell:
    """Commands in this process, typed in a folder that has a store of its own."""

    def __init__(self, folder: Path, capture: pytest.CaptureFixture[str]) -> None:
        self.folder = folder
        self.capture = capture

    def __call__(self, line: str, *words: str | Path, code: int = 0) -> CaptureResult[str]:
        """What a command prints; behind its line stand words that hold blanks or quotes."""
        self.capture.readouterr()
        found = main([*shlex.split(line), *map(str, words)])
        printed = self.capture.readouterr()
        assert found == code, printed.out + printed.err
        return printed

    def prints(self, line: str, *words: str | Path, code: int = 0) -> str:
        """Its output with the lines joined, however wide the terminal is."""
        return " ".join(self(line, *words, code=code).out.split())

    def refuses(self, line: str, *words: str | Path, code: int = 2) -> str:
        """Its message with the lines joined."""
        return " ".join(self(line, *words, code=code).err.split())

    def write(self, text: str, *changes: tuple[str, str], name: str = "scene") -> Path:
        return write_scene(self.folder, text, *changes, name=name)

    def change(self, *changes: tuple[str, str], add: str = "") -> Path:
        """Replace texts in ``scene.toml``, and add others behind it."""
        path = self.write(self.text("scene.toml"), *changes)
        path.write_text(path.read_text() + add)
        return path

    def text(self, name: str) -> str:
        return (self.folder / name).read_text()

    def json(self, name: str) -> Any:
        return read_json(self.folder / name)

    def rows(self, name: str) -> list[dict[str, str]]:
        return read_rows(self.folder / name)

    def files(self, name: str = ".") -> set[str]:
        """Names of what lies in a folder."""
        return {path.name for path in (self.folder / name).iterdir()}


def find_difference(
    one: object,
    other: object,
    place: str = "",
    *,
    loose: tuple[str, ...] = (),
    skip: tuple[type, ...] = (),
) -> str:
    """Where two values differ in type or content; empty where they do not.

    Args:
        loose: Beginnings of places in which entries may stand in another order.
        skip: Types that are not compared.
    """
    if type(one) is not type(other):
        return f"{place}: {type(one).__name__} and {type(other).__name__}"
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        same = one.dtype == other.dtype and one.shape == other.shape
        return "" if same and one.tobytes() == other.tobytes() else place
    pairs: list[tuple[str, object, object]] = []
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one)]
        pairs = [(f".{name}", getattr(one, name), getattr(other, name)) for name in names]
    elif isinstance(one, list | tuple) and isinstance(other, list | tuple):
        if len(one) != len(other):
            return place
        pairs = [(f"[{i}]", *both) for i, both in enumerate(zip(one, other, strict=True))]
    elif isinstance(one, Mapping) and isinstance(other, Mapping):
        order = sorted if place.startswith(loose) else list
        if order(one) != order(other):
            return place
        pairs = [(f"[{key}]", one[key], other[key]) for key in one]
    elif one != other and not (one != one and other != other):
        return f"{place}: {one!r} and {other!r}"
    found = (
        find_difference(mine, theirs, place + where, loose=loose, skip=skip)
        for where, mine, theirs in pairs
        if not isinstance(mine, skip)
    )
    return next(filter(None, found), "")


def read_leaves(
    value: Any, leave_out: Callable[[str], bool] = lambda key: False, place: str = ""
) -> dict[str, Any]:
    """What nested tables and lists hold by its place, without what stands under some keys."""
    if not value or not isinstance(value, dict | list):
        return {place: value}
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return {
        inner: leaf
        for key, item in items
        if not leave_out(str(key))
        for inner, leaf in read_leaves(item, leave_out, f"{place}/{key}").items()
    }


def loaded_by(code: str) -> set[str]:
    """Packages that a fresh interpreter has loaded after some code."""
    listing = f"{code}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    done = run_process([sys.executable, "-P", "-c", listing], timeout=120)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


def approx(expected: object, rel: float | None = None, abs: SupportsFloat | None = None) -> object:
    """`pytest.approx` without its absolute tolerance of 1e-12, within which compliances of 1e-9 m/N
    are all alike: an expected zero needs an ``abs`` of its own.
    """
    if rel is None and abs is None:
        rel = 1e-6
    return pytest.approx(expected, rel=rel, abs=abs or 0.0)


def present[T](value: T | None) -> T:
    """What a test relies on to be there."""
    assert value is not None
    return value


def sketch[T](kind: type[T], content: Mapping[str, object]) -> T:
    """A typed dictionary that holds what a test needs and not all that it has to."""
    return cast(T, content)


def tag_patches(mesh: ComponentMesh, groups: Mapping[str, Choice]) -> ComponentMesh:
    """Patch groups of a mesh: a side such as ``z+``, or a function from facet centres ``(n, 3)`` to
    the facets wanted.
    """
    surface = extract_surface(mesh.cells, mesh.kind)
    centers = mesh.points[surface.facets[:, : surface.corners]].mean(axis=1)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)

    def facets(group: Choice) -> IntArray:
        if not isinstance(group, str):
            return np.asarray(surface.facets[group(centers)])
        axis = "xyz".index(group[0])
        level = low[axis] if group[1] == "-" else high[axis]
        return np.asarray(
            surface.facets[np.abs(centers[:, axis] - level) < 1e-9 * (high - low).max()]
        )

    return dataclasses.replace(
        mesh, patches={name: facets(group) for name, group in groups.items()}
    )


def make_box(
    counts: Sequence[int],
    size: Sequence[float],
    groups: Mapping[str, Choice] | None = None,
    *,
    kind: CellKind = "hex27",
    warp: Callable[[FloatArray], FloatArray] | None = None,
    straight: bool = True,
) -> ComponentMesh:
    """A structured box from the origin, perhaps warped, with patch groups chosen before the
    warp.
    """
    mesh = tag_patches(
        lattice_mesh(straight_lattice(counts, size), kind, straight=straight), groups or {}
    )
    if warp is None:
        return mesh
    points = warp(mesh.points)
    volume = float(integrate_over_cells(points, mesh.cells, kind, lambda x: np.ones(len(x))))
    return dataclasses.replace(
        mesh, points=points, quality=dataclasses.replace(mesh.quality, volume=volume)
    )


def make_component(
    interfaces: Mapping[str, str] | None = None,
    *,
    modes: int = 0,
    material: Material = STEEL,
    name: str = "body",
    size: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Component:
    """A component for a structured mesh; interfaces map names to ``rigid`` or ``average``, with
    ``!`` behind it where forced.
    """
    made = {
        label: Interface(
            label,
            (Patch("z+"),),
            "average" if coupling.startswith("average") else "rigid",
            allow_singular=coupling.endswith("!"),
        )
        for label, coupling in (interfaces or {}).items()
    }
    return Component(
        name, Box(size), material, interfaces=made, reduction=ReductionSettings(modes=modes)
    )


def make_faced(name: str, solid: Solid, faces: Mapping[str, str], **settings: Any) -> Component:
    """A component of steel with interfaces on faces, those that average written ``average z+``."""
    interfaces = {}
    for label, text in faces.items():
        average, face = text.startswith("average "), text.removeprefix("average ")
        interfaces[label] = Interface(label, (Patch(face),), "average" if average else "rigid")
    return Component(name, solid, **{"material": STEEL, "interfaces": interfaces, **settings})


class Dense:
    """Methods that share no solver with the code under test: dense matrices in the order of the mesh
    points.
    """

    def pencil(self, mesh: ComponentMesh, material: Material) -> tuple[FloatArray, FloatArray]:
        """Stiffness and mass ``(3 n, 3 n)`` in the order of the mesh points, for methods that share
        no solver with the code under test.
        """
        # here, so that tests without finite elements start without dolfinx
        from headstock.solvers.elastic.elasticity import assemble_elasticity

        operators = assemble_elasticity(mesh, material, comm=MPI.COMM_SELF, with_mass=True)
        order = np.argsort(operators.nodes)
        dofs = (3 * order[:, None] + np.arange(3)).ravel()
        assert operators.scalar_mass is not None
        mass = np.kron(operators.scalar_mass.toarray(), np.eye(3))
        return operators.stiffness.toarray()[np.ix_(dofs, dofs)], mass[np.ix_(dofs, dofs)]

    def rigid_map(
        self, mesh: ComponentMesh, groups: Iterable[str]
    ) -> tuple[FloatArray, FloatArray]:
        """Displacements of all mesh points from 6 dofs at each rigid patch's nodal mean, then the
        dofs of the points outside.

        Returns the matrix ``(3 n, 6 p + n_i)`` and the reference points ``(p, 3)``.
        """
        patches = [np.unique(mesh.patches[name]) for name in groups]
        inside = np.unique(np.concatenate(patches)) if patches else np.zeros(0, dtype=int)
        outside = np.setdiff1d(np.arange(len(mesh.points)), inside)
        boundary, origins = np.zeros((3 * len(mesh.points), 6 * len(patches))), []
        for number, nodes in enumerate(patches):
            origin = 0.5 * (mesh.points[nodes].min(axis=0) + mesh.points[nodes].max(axis=0))
            dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
            boundary[dofs, 6 * number : 6 * number + 6] = rigid_map(mesh.points[nodes], origin)
            origins.append(origin)
        interior = (3 * outside[:, None] + np.arange(3)).ravel()
        return np.hstack([boundary, np.eye(3 * len(mesh.points))[:, interior]]), np.array(origins)

    def frequencies(self, stiffness: FloatArray, mass: FloatArray) -> FloatArray:
        """All natural frequencies [Hz] of a dense pencil."""
        return np.asarray(np.sqrt(np.abs(scipy.linalg.eigvalsh(stiffness, mass))) / (2.0 * np.pi))


def work_here(
    functions: Sequence[str],
    *words: str,
    limits: WorkerLimits,
    content: bytes = b"",
    result: BinaryIO,
    readable: Sequence[Path] = (),
    progress: Callable[[str], None] | None = None,
) -> WorkerEnd:
    """A job of meshing in this process, as `call_apart` has it done in one of its own: loading gmsh
    there takes longer than what most tests mesh.
    """
    gmsh = sys.modules.get("gmsh")
    open_model = gmsh is not None and gmsh.isInitialized()  # the test has a model of its own there
    # gmsh and standard input are one for all threads
    if open_model or threading.current_thread() is not threading.main_thread():
        return worker.call_apart(
            functions,
            *words,
            limits=limits,
            readable=readable,
            content=content,
            result=result,
            progress=progress,
        )
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(said):
        patch.setattr(worker, "accept_limits", lambda arguments: arguments[1:])
        patch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(content)))
        arguments = [json.dumps(functions), json.dumps(words), str(os.dup(result.fileno()))]
        code = worker._run_worker(["", *arguments])
    if progress is not None:
        progress(said.getvalue().strip().rpartition("\n")[2])
    return WorkerEnd(code, said.getvalue(), limits, limits)


def draw_here(kind: str, source: str, target: int, files: Sequence[int]) -> str | None:
    """What `pictures._run` has drawn in a process of its own, in this one: loading VTK and matplotlib
    there takes longer than drawing. A window still has its own.
    """
    if kind == "window":
        return RUN_RENDERER(kind, source, target, files)
    given = source if kind == "charts" else str(os.dup(int(source)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(pictures.GL_WINDOW, "vtkEGLRenderWindow")
        patch.setattr("signal.alarm", lambda seconds: 0)
        renderer.main([kind, given, str(os.dup(target))])
    return None
