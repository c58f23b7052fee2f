"""Estimates of what a mesh does to frequencies and compliances, against finer meshes."""

import dataclasses

import numpy as np
from mpi4py import MPI
from scipy.stats import spearmanr

from common import approx, make_box, present
from elastic_columns import COLUMN, SIZE, couple_column
from headstock.geometry.frames import FloatArray, rigid_transfer
from headstock.geometry.machine.machine import Machine, Pose
from headstock.meshing.component_mesh import CellKind
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.mesh_errors import (
    compliance_mesh_errors,
    frequency_mesh_errors,
    meshed_parts,
)
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import ErrorEstimates
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, two_node_body
from reduced_parts import reduce_mesh

COUNT = 5
Mesh = tuple[CellKind, tuple[int, int, int]]
FINE: Mesh = ("hex27", (3, 8, 26))
COARSE: list[Mesh] = [
    ("hex27", (1, 2, 3)),
    ("hex27", (1, 3, 8)),
    ("tet10", (1, 2, 6)),
    ("tet10", (2, 4, 12)),
    ("hex8", (2, 4, 12)),
]


def numbers(coupled: CoupledMachine) -> tuple[FloatArray, FloatArray]:
    """Frequencies and compliances in x, y, z with their estimated errors, all relative."""
    modes = solve_modal(coupled.system, count=COUNT)
    budget = point_budget(coupled, "tcp")
    soft = np.diag(budget.compliance)[:3]
    errors = frequency_mesh_errors(coupled, modes)["body"] / modes.frequencies_hz
    softer = np.diag(compliance_mesh_errors(coupled, budget.displacements)["body"])[:3] / soft
    # as estimated, without the factor that covers 95 %
    return np.r_[modes.frequencies_hz, soft], np.r_[errors, softer] / coupled.layout.superelements[
        "body"
    ].errors.mesh_safety


def test_estimates_are_within_a_factor_of_three_and_rank_meshes_and_modes_as_the_true_errors_do() -> (
    None
):
    exact, _ = numbers(couple_column(*FINE))
    true, found = [], []
    for kind, counts in COARSE:
        values, errors = numbers(couple_column(kind, counts))
        # frequencies come out too high, compliances too small
        true.append(
            np.r_[values[:COUNT] / exact[:COUNT] - 1.0, exact[COUNT:] / values[COUNT:] - 1.0]
        )
        found.append(errors)
    ratios = np.concatenate(found) / np.concatenate(true)
    assert 1.0 / 3.0 < np.median(ratios) < 3.0
    assert ((ratios > 1.0 / 3.0) & (ratios < 3.0)).mean() > 0.8
    assert spearmanr(np.concatenate(found), np.concatenate(true)).statistic > 0.9


def test_modes_near_the_cut_off_have_an_estimate_like_all_others() -> None:
    coupled, exact = couple_column("tet10", (1, 2, 6)), couple_column(*FINE)
    element, count = coupled.layout.superelements["body"], 18
    assert (np.diag(present(element.errors.missing_energy))[element.boundary_size :] > 0.0).all()
    modes, right = (
        solve_modal(each.system, count=count).frequencies_hz for each in (coupled, exact)
    )
    errors = frequency_mesh_errors(coupled, solve_modal(coupled.system, count=count))["body"]
    assert modes[-1] > 0.9 * element.cutoff_hz
    assert (errors > 0.2 * (modes - right)).all()


def test_what_a_file_does_not_estimate_is_unknown_not_zero() -> None:
    coupled = couple_column("tet10", (1, 2, 6))
    element = coupled.layout.superelements["body"]
    missing = present(element.errors.missing_energy).copy()
    missing[-6:] = missing[:, -6:] = 0.0
    poorer = dataclasses.replace(
        element, errors=dataclasses.replace(element.errors, missing_energy=missing)
    )
    coupled = dataclasses.replace(
        coupled, layout=dataclasses.replace(coupled.layout, superelements={"body": poorer})
    )
    modes = solve_modal(coupled.system)
    errors = frequency_mesh_errors(coupled, modes)["body"]
    assert np.isfinite(errors[:COUNT]).all()
    assert np.isnan(errors[modes.frequencies_hz > element.modal_frequencies_hz[-6]]).all()
    assert meshed_parts(coupled)["body"].reach_hz == element.modal_frequencies_hz[-6]


def test_rigid_motions_of_a_free_component_miss_no_energy() -> None:
    mesh = make_box((1, 2, 6), SIZE, {"foot": "z-", "tip": "z+"}, kind="tet10")
    element = reduce_mesh(COLUMN, mesh, modes=4)
    motions = np.zeros((len(element.labels), 6))
    for node, frame in enumerate(element.frames):
        motions[6 * node : 6 * node + 6] = rigid_transfer(np.array([3.0, -2.0, 1.0]), frame.origin)
    energies = np.diag(motions.T @ present(element.errors.missing_energy) @ motions)
    assert np.abs(energies).max() < 1e-12 * np.trace(present(element.errors.missing_energy))
    assert np.linalg.eigvalsh(present(element.errors.missing_energy))[0] > -1e-9 * np.trace(
        present(element.errors.missing_energy)
    )


def test_what_is_not_asked_for_is_not_estimated() -> None:
    mesh = make_box((1, 1, 2), SIZE, {"foot": "z-", "tip": "z+"})
    request = ReductionRequest(ModeTarget(count=2), errors=False)
    assert (
        reduce_elastic(COLUMN, mesh, comm=MPI.COMM_SELF, request=request).errors.missing_energy
        is None
    )


def test_the_frequency_of_one_linear_element_falls_to_that_of_the_rod() -> None:
    """A rod of one element fixed at its foot has ``omega_h^2 = 3 k / m``, the true one ``pi^2 / 4 k / m``.

    Under the inertia of its mode the true rod strains by ``w' = 3 (1 - x^2) / 2`` where the element has
    one: it misses a fifth of the energy.
    """
    mass, stiffness, missed = 6.0, 4e6, 0.2
    component, body = two_node_body("rod", mass, 1.0, [1e12, 1e12, stiffness, 1e12, 1e12, 1e12])
    rod = dataclasses.replace(
        body,
        mass=np.asarray(np.kron([[2.0, 1.0], [1.0, 2.0]], mass / 6.0 * np.eye(6)), dtype=float),
        errors=ErrorEstimates(missing_energy=missed * body.stiffness, mesh_safety=1.0),
    )
    clamp = joint_between("clamp", "ground", "rod.foot", fixed=range(6))
    machine = Machine("rod", {"rod": component}, {"clamp": clamp}, {})
    coupled = couple({"rod": rod}, machine, Pose("reference"))
    modes = solve_modal(coupled.system, count=1)
    (too_high,) = frequency_mesh_errors(coupled, modes)["rod"]
    true_hz = 0.25 * np.sqrt(stiffness / mass)
    assert modes.frequencies_hz[0] == approx(np.sqrt(12.0) / np.pi * true_hz, rel=1e-9)
    assert modes.frequencies_hz[0] - too_high == approx(true_hz, rel=0.01)
