"""One contender of the reduction benchmark in a process of its own: does the job and prints one
line of JSON.
"""

import dataclasses
import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from column_job import column, read_matrices, read_mesh, write_matrices
from mpi4py import MPI
from stage_clock import StageClock

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import DEFAULT_EIGENSOLVER, Eigensolver
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.store import Store
from headstock.reduction.components import elastic as elastic_reduction
from headstock.scene.building.loader import load_scene
from headstock.solvers.elastic.elasticity import assemble_elasticity
from headstock.solvers.elastic.factorization import Factorization
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import SecondOrderSystem

FLOOR_BLOCKS = (12, 40)
POSE_SIZES = (60, 200)
Result = dict[str, Any]
Factorizer = Callable[[scipy.sparse.csc_matrix], Callable[[FloatArray], FloatArray]]


def run_headstock(
    folder: Path, modes: int, eigensolver: Eigensolver = DEFAULT_EIGENSOLVER
) -> Result:
    """The reduction as a run does it, from the mesh to the superelement; assembly and error
    estimates counted.
    """
    component, mesh, clock = column("20k", modes), read_mesh(folder), StageClock()
    reduction = dataclasses.replace(component.reduction, eigensolver=eigensolver)
    component = dataclasses.replace(component, reduction=reduction)
    clock.watch(elastic_reduction, "assemble_elasticity", "assembly")
    clock.watch(Factorization, "__init__", "factorisation")
    clock.watch(elastic_reduction, "find_fixed_interface_modes", "fixed-interface modes")
    clock.watch(elastic_reduction, "_estimate_errors", "error estimates")
    clock.restart()
    with clock.stage("constraint modes, projection"):
        element = elastic_reduction.reduce_elastic(component, mesh, comm=MPI.COMM_SELF)
    total = clock.total()
    return _result(clock, total, element.modal_frequencies_hz, element.stiffness, element.mass)


def run_krylov_schur(folder: Path, modes: int) -> Result:
    """The same with the other eigensolver."""
    return run_headstock(folder, modes, "krylov_schur")


def run_stage(folder: Path, modes: int) -> Result:
    """The ``reduce`` stage of a run with an empty store: checks, skin and the file in the store
    counted.
    """
    del modes
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        found = run_scene(
            load_scene(folder / "column.toml"),
            Path(scratch) / "out",
            comm=MPI.COMM_SELF,
            store=Store(Path(scratch) / "store"),
        )
    record = next(record for record in found.stages if record.stage.kind == "reduce")
    total = {"seconds": record.seconds, "cpu": record.cpu_seconds, "peak_mb": record.peak_rss_mb}
    return {"stages": {}, "total": total}


def run_floor(folder: Path, modes: int) -> Result:
    """Analysis, factorisation and 52 right-hand sides on the same K_ii with the same solver;
    assembly not counted.
    """
    component, mesh = column("20k", modes), read_mesh(folder)
    operators = assemble_elasticity(mesh, component.material, comm=MPI.COMM_SELF, with_mass=False)
    fixed = np.zeros(len(mesh.points), dtype=bool)
    fixed[
        np.unique(np.concatenate([mesh.patches["foot"].ravel(), mesh.patches["tip"].ravel()]))
    ] = True
    loads = np.random.default_rng(1).standard_normal((operators.owned_dofs, max(FLOOR_BLOCKS)))
    clock = StageClock()
    with clock.stage("factorisation"):
        factorization = Factorization(operators, np.repeat(fixed[operators.nodes], 3))
    for width in FLOOR_BLOCKS:
        with clock.stage(f"{sum(FLOOR_BLOCKS)} right-hand sides"):
            factorization.solve(loads[:, :width])
    return {"stages": clock.stages, "total": clock.total()}


def run_superlu(folder: Path, modes: int) -> Result:
    """Scipy: eigsh in shift-invert mode and the constraint modes on one SuperLU factorisation with
    its default ordering.
    """

    def factorize(matrix: scipy.sparse.csc_matrix) -> Callable[[FloatArray], FloatArray]:
        return scipy.sparse.linalg.splu(matrix).solve

    return _run_eigsh(folder, modes, factorize)


def run_cholmod(folder: Path, modes: int) -> Result:
    """The same on one CHOLMOD factorisation (scikit-sparse)."""
    from sksparse.cholmod import cho_factor

    return _run_eigsh(folder, modes, lambda matrix: cho_factor(matrix).solve)


def run_exudyn(folder: Path, modes: int) -> Result:
    """Exudyn's Hurty-Craig-Bampton modes, scipy path, with the matrices given; the projection is
    done outside the clock.
    """
    import exudyn.FEM

    exudyn.FEM.exu.SetWriteToConsole(False)
    job, clock = read_matrices(folder), StageClock()
    fem = exudyn.FEM.FEMinterface()
    fem.nodes = {"Position": job.points}
    fem.stiffnessMatrix, fem.massMatrix = job.stiffness, job.mass
    with clock.stage("modes"):
        fem.ComputeHurtyCraigBamptonModes(
            [list(map(int, face)) for face in job.faces],
            modes,
            computationMode=exudyn.FEM.HCBstaticModeSelection.RBE2,
            excludeRigidBodyMotion=False,
        )
    total = clock.total()
    basis = np.asarray(fem.modeBasis["matrix"])
    frequencies = np.sqrt(np.sort(np.asarray(fem.eigenValues))) / (2.0 * np.pi)
    return _result(
        clock, total, frequencies, basis.T @ (job.stiffness @ basis), basis.T @ (job.mass @ basis)
    )


def run_matrices(folder: Path, modes: int) -> Result:
    """Write the matrices for the peers."""
    del modes
    write_matrices(folder)
    return {"stages": {}, "total": StageClock().total()}


def run_poses(folder: Path, modes: int) -> Result:
    """Poses per second: all frequencies and shapes of small dense systems."""
    del folder, modes
    clock, result = StageClock(), {}
    for size in POSE_SIZES:
        raw = np.random.default_rng(size).standard_normal((2, size, size))
        stiffness, mass = (block @ block.T + size * np.eye(size) for block in raw)
        system = SecondOrderSystem(mass, None, stiffness, {}, {}, tuple(map(str, range(size))))
        solve_modal(system)
        count = max(1, 40000 // size**2) * 20
        with clock.stage(str(size)):
            for _ in range(count):
                solve_modal(system)
        with clock.stage(f"{size} eigh"):
            for _ in range(count):
                scipy.linalg.eigh(stiffness, mass)
        result[str(size)] = count / clock.stages[str(size)]["seconds"]
        result[f"{size} by bare eigh"] = count / clock.stages[f"{size} eigh"]["seconds"]
    return {"stages": clock.stages, "total": clock.total(), "poses_per_second": result}


def _run_eigsh(
    folder: Path,
    modes: int,
    factorize: Callable[[scipy.sparse.csc_matrix], Callable[[FloatArray], FloatArray]],
) -> Result:
    job, clock = read_matrices(folder), StageClock()
    with clock.stage("partition"):
        free, motions = job.free, job.face_motions()
        stiffness = job.stiffness[free][:, free].tocsc()
        mass = job.mass[free][:, free]
        loads = -(job.stiffness @ motions)[free]
    with clock.stage("factorisation"):
        solve = factorize(stiffness)
    with clock.stage("constraint modes, projection"):
        basis = np.zeros((len(motions), 12 + modes))
        basis[:, :12] = motions
        basis[free, :12] = solve(loads)
    with clock.stage("fixed-interface modes"):
        inverse = scipy.sparse.linalg.LinearOperator(stiffness.shape, matvec=solve, dtype=float)
        values, shapes = scipy.sparse.linalg.eigsh(
            stiffness, k=modes, M=mass, sigma=0.0, OPinv=inverse
        )
    with clock.stage("constraint modes, projection"):
        basis[free, 12:] = shapes
        reduced = [basis.T @ (matrix @ basis) for matrix in (job.stiffness, job.mass)]
    return _result(clock, clock.total(), np.sqrt(np.sort(values)) / (2.0 * np.pi), *reduced)


def _result(
    clock: StageClock,
    total: dict[str, float],
    fixed_hz: FloatArray,
    stiffness: FloatArray,
    mass: FloatArray,
) -> Result:
    """What is compared: fixed-interface frequencies, and the elastic frequencies of the free
    reduced model.
    """
    eigenvalues = scipy.linalg.eigh(
        0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T), eigvals_only=True
    )
    free_hz = np.sqrt(np.abs(eigenvalues[6:])) / (2.0 * np.pi)
    return {
        "stages": clock.stages,
        "total": total,
        "fixed_hz": list(map(float, fixed_hz)),
        "free_hz": list(map(float, free_hz)),
    }


CONTENDERS: dict[str, Callable[[Path, int], Result]] = {
    "headstock": run_headstock,
    "headstock, Krylov-Schur": run_krylov_schur,
    "reduce stage": run_stage,
    "minimum": run_floor,
    "scipy + SuperLU": run_superlu,
    "scipy + CHOLMOD": run_cholmod,
    "Exudyn": run_exudyn,
    "matrices": run_matrices,
    "poses": run_poses,
}


def main(name: str, folder: str, modes: str) -> int:
    """Run a contender by name."""
    print(json.dumps(CONTENDERS[name](Path(folder), int(modes))), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
