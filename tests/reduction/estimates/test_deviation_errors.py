"""Errors of how far a tool is off by the meshes of components, against compliances and finer meshes."""

import numpy as np
import pytest
from mpi4py import MPI

from common import approx, make_box, make_component
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Load
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.channels import GRAVITY
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.corrected_elements import (
    _with_finer_mesh,
    _with_modes_left_out,
    _with_true_faces,
)
from headstock.reduction.estimates.mesh_errors import compliance_mesh_errors
from headstock.reduction.estimates.static_errors import estimate_deviation
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.reduction.motions.tool_deviation import FORCES, solve_deviation
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import clamped_machine

SIZE = (0.1, 0.4, 0.06)  # a plate that hangs over
BEAM = make_component({"foot": "average", "tip": "average"}, size=SIZE)
PUSH = Load("push", "body", "force", interface="tip", vector=(30.0, 0.0, 200.0, 0.0, 0.0, 0.0))
MACHINE = clamped_machine(BEAM, loads={"push": PUSH})
DOWN = np.array([0.0, 0.0, -9.81])


def reduce_beam(counts: tuple[int, int, int], modes: int = 4) -> Superelement:
    mesh = make_box(counts, SIZE, {"foot": "y-", "tip": "y+"}, kind="hex27")
    request = ReductionRequest(ModeTarget(count=modes), gravity=True)
    return reduce_elastic(BEAM, mesh, comm=MPI.COMM_SELF, request=request)


def couple_beam(element: Superelement) -> CoupledMachine:
    return couple({"body": element}, MACHINE, Pose("reference"), gravity=DOWN)


@pytest.fixture(scope="module")
def coarse() -> Superelement:
    return reduce_beam((2, 4, 2))


@pytest.fixture(scope="module")
def fine() -> Superelement:
    return reduce_beam((4, 12, 3))


def test_under_a_force_it_is_the_error_of_the_compliance(coarse: Superelement) -> None:
    coupled = couple_beam(coarse)
    found = estimate_deviation(coupled, MACHINE, DOWN, solve_deviation(coupled, MACHINE, "tcp"))
    budget = point_budget(coupled, "tcp")
    energies = compliance_mesh_errors(coupled, budget.displacements)["body"]
    assert found[FORCES].meshes["body"] == approx(energies @ np.array(PUSH.vector), rel=1e-9)


@pytest.mark.parametrize("source", [GRAVITY, FORCES])
def test_it_covers_what_a_finer_mesh_changes(
    coarse: Superelement, fine: Superelement, source: str
) -> None:
    coupled = couple_beam(coarse)
    own = solve_deviation(coupled, MACHINE, "tcp")
    true = solve_deviation(couple_beam(fine), MACHINE, "tcp")
    change = estimate_deviation(coupled, MACHINE, DOWN, own)[source].meshes["body"]
    missed = true.sources[source] - own.sources[source]
    down = 2
    assert abs(missed[down]) > 1e-4 * abs(own.sources[source][down])
    assert 1.0 < change[down] / missed[down] < 6.0


def test_a_finer_mesh_is_as_soft_as_the_estimate(coarse: Superelement) -> None:
    coupled, softer = couple_beam(coarse), couple_beam(_with_finer_mesh(coarse))
    own, better = (solve_deviation(each, MACHINE, "tcp").sources for each in (coupled, softer))
    found = estimate_deviation(coupled, MACHINE, DOWN, solve_deviation(coupled, MACHINE, "tcp"))
    size = {source: np.abs(found[source].meshes["body"]).max() for source in (FORCES, GRAVITY)}
    assert min(size.values()) > 0.0
    for source, largest in size.items():
        # of loads inside the body products of two errors are left out
        left = 1e-9 if source == FORCES else 0.01
        change = better[source] - own[source]
        assert change == approx(found[source].meshes["body"], abs=left * largest)


def test_modes_left_out_move_frequencies_by_no_less_than_all_modes_do(fine: Superelement) -> None:
    few = fine  # four modes
    many = reduce_beam((4, 12, 3), modes=40)
    hz = [
        solve_modal(couple_beam(each).system, count=5).frequencies_hz
        for each in (few, many, _with_modes_left_out(few))
    ]
    assert (hz[0] - hz[1] > 1e-5 * hz[1]).any()
    assert (hz[2] <= hz[1] * (1.0 + 1e-6)).all()
    # and nothing at rest
    own, better = (
        point_budget(couple_beam(each), "tcp").compliance
        for each in (few, _with_modes_left_out(few))
    )
    assert better == approx(own, rel=1e-9, abs=1e-12 * np.abs(own).max())


def test_flat_parts_have_no_better_faces(coarse: Superelement) -> None:
    assert _with_true_faces(coarse) is coarse
