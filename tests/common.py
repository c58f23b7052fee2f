"""What tests share: what has to be there, small structured meshes with tagged patches, their dense
matrices.
"""

import contextlib
import dataclasses
import io
import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, SupportsFloat, cast

import numpy as np
import pytest
import scipy.linalg
from _pytest.capture import CaptureResult
from mpi4py import MPI

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
STEEL = Material("steel", 2.1e11, 0.3, 7850.0)
# a side such as ``z+``, or from facet centres ``(n, 3)`` those wanted
Choice = str | Callable[[FloatArray], BoolArray]


def run_process(
    command: Sequence[str | Path], *, check: bool = False, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, with what it prints as text."""
    return subprocess.run(command, capture_output=True, text=True, check=check, **options)


def rank_words(ranks: int) -> list[str]:
    """How MPI starts Python on so many ranks, which share cores: MPICH lets them without being told."""
    mpirun = shutil.which("mpirun")
    assert mpirun is not None
    shared = ["--oversubscribe"] if "Open MPI" in MPI.Get_library_version() else []
    return [mpirun, *shared, "--bind-to", "none", "-n", str(ranks), sys.executable]


def run_on_ranks(ranks: int, folder: Path, *program: str) -> subprocess.CompletedProcess[str]:
    """A Python program on so many ranks, with a store of their own, started as the launcher does."""
    start = Path(__file__).parents[1] / "environment" / "start_ranks.sh"
    variables = {
        **os.environ,
        "HEADSTOCK_STORE": str(folder / f"store{ranks}"),
        "OMP_NUM_THREADS": "1",
        "HEADSTOCK_THREADS": "1",  # the core of a sleeping rank would change the last digits
    }
    command = ["/bin/sh", str(start), *rank_words(ranks), "-P", *program]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, env=variables)


def run_alone(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
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


def run_command(ranks: int, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command on so many ranks, on one in this process: starting it takes longer than the command."""
    if ranks == 1:
        return run_alone(folder, *words)
    return run_on_ranks(ranks, folder, "-m", "mpi4py", "-m", "headstock.app.command_line", *words)


def call(
    capsys: pytest.CaptureFixture[str], words: Sequence[str], code: int = 0
) -> CaptureResult[str]:
    """What a command prints here; it has to end with this code."""
    assert main([*words]) == code
    return capsys.readouterr()


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
    content: bytes,
    result: BinaryIO,
    readable: Sequence[Path] = (),
) -> WorkerEnd:
    """A job of meshing in this process, as `call_apart` has it done in one of its own: loading gmsh
    there takes longer than what most tests mesh.
    """
    gmsh = sys.modules.get("gmsh")
    open_model = gmsh is not None and gmsh.isInitialized()  # the test has a model of its own there
    # gmsh and standard input are one for all threads
    if open_model or threading.current_thread() is not threading.main_thread():
        return worker.call_apart(
            functions, *words, limits=limits, readable=readable, content=content, result=result
        )
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(said):
        patch.setattr(worker, "accept_limits", lambda arguments: arguments[1:])
        patch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(content)))
        arguments = [json.dumps(functions), json.dumps(words), str(os.dup(result.fileno()))]
        code = worker._run_worker(["", *arguments])
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
