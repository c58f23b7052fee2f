"""Superelements corrected by the estimates of their meshes, against finer meshes and closed forms."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from common import approx
from elastic_columns import COLUMN, reduce_column
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind
from headstock.pipeline.storage.superelements import read_superelement, write_superelement
from headstock.reduction.estimates.corrected_elements import correct_mesh
from headstock.reduction.estimates.mesh_errors import (
    compliance_mesh_errors,
    frequency_mesh_errors,
    meshed_parts,
)
from headstock.reduction.estimates.response_errors import (
    ErrorSources,
    bound_response_errors,
    project_response,
)
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.reduction.superelement import ErrorEstimates, Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import Channel, input_columns, output_rows
from lumped_machines import couple_clamped

COUNT = 5
Counts = tuple[int, int, int]


def numbers(element: Superelement) -> tuple[FloatArray, FloatArray]:
    """Frequencies and compliances of the clamped column, and their ±."""
    coupled = couple_clamped(COLUMN, element)
    modes, budget = solve_modal(coupled.system, count=COUNT), point_budget(coupled, "tcp")
    energies = compliance_mesh_errors(coupled, budget.displacements)["body"]
    return np.r_[modes.frequencies_hz, np.diag(budget.compliance)[:3]], np.r_[
        frequency_mesh_errors(coupled, modes)["body"], np.diag(energies)[:3]
    ]


@pytest.fixture(scope="module")
def fine() -> FloatArray:
    """From two meshes, whose errors at the held rim fall with about the power 1.1 of their size."""
    coarse, finer = (numbers(reduce_column("hex27", n))[0] for n in ((2, 5, 16), (3, 8, 26)))
    return np.asarray(finer + (finer - coarse) / (1.6**1.1 - 1.0))


@pytest.mark.fem
@pytest.mark.parametrize(("kind", "counts"), [("tet10", (1, 2, 6)), ("tet10", (2, 4, 12))])
def test_a_corrected_mesh_is_several_times_closer_and_says_so(
    fine: FloatArray, kind: CellKind, counts: Counts
) -> None:
    plain = reduce_column(kind, counts)
    before, wide = numbers(plain)
    after, narrow = numbers(correct_mesh(plain))
    far, near = np.abs(before - fine), np.abs(after - fine)
    assert np.median(near / far) < 0.4
    assert (narrow < 0.45 * wide).all()
    assert (near < narrow).all()


@pytest.mark.fem
def test_the_compliance_grows_by_the_energy_that_is_missed() -> None:
    plain = reduce_column("tet10", (1, 2, 6))
    coupled = couple_clamped(COLUMN, plain)
    budget = point_budget(coupled, "tcp")
    missed = (
        compliance_mesh_errors(coupled, budget.displacements)["body"] / plain.errors.mesh_safety
    )
    again = point_budget(couple_clamped(COLUMN, correct_mesh(plain)), "tcp")
    # clamped, the compliance of the machine is a block of that of its body
    assert again.compliance == approx(
        budget.compliance + missed, rel=1e-6, abs=1e-9 * np.abs(budget.compliance).max()
    )


@pytest.mark.fem
def test_rigid_motions_stay_free_and_no_direction_turns_negative_however_much_is_missed() -> None:
    plain = reduce_column("tet10", (1, 2, 6))
    errors = plain.errors
    assert errors.missing_energy is not None
    blown = dataclasses.replace(errors, missing_energy=300.0 * errors.missing_energy)
    for element in (plain, dataclasses.replace(plain, errors=blown)):
        corrected = correct_mesh(element)
        values = np.linalg.eigvalsh(_scaled(corrected))
        assert values[0] > -1e-10 * values[-1]
        assert (np.abs(values) < 1e-10 * values[-1]).sum() == 6
        # and stiffer it is in none
        assert np.linalg.eigvalsh(_scaled(plain) - _scaled(corrected))[0] > -1e-10 * values[-1]


def _scaled(element: Superelement) -> FloatArray:
    """Stiffness with moments over 0.1 m, modal dofs by the mass."""
    scale = np.ones(len(element.stiffness))
    scale[: element.boundary_size].reshape(-1, 6)[:, 3:] = 10.0
    return np.asarray(element.stiffness * scale * scale[:, None])


@pytest.mark.fem
def test_where_nothing_is_known_nothing_is_corrected() -> None:
    plain = reduce_column("tet10", (1, 2, 6))
    unknown = dataclasses.replace(plain, errors=ErrorEstimates())
    nothing = ErrorEstimates(missing_energy=np.zeros_like(plain.stiffness))
    exact = dataclasses.replace(plain, errors=nothing)
    assert correct_mesh(unknown) is unknown and correct_mesh(exact) is exact


@pytest.mark.fem
def test_a_corrected_superelement_is_written_and_read(tmp_path: Path) -> None:
    plain = reduce_column("tet10", (1, 2, 6))
    corrected, left = correct_mesh(plain), plain.errors.mesh_truth[1]
    assert corrected.errors.corrected and corrected.errors.mesh_safety == left < 1.0
    write_superelement(tmp_path / "body.h5", corrected)
    read = read_superelement(tmp_path / "body.h5")
    assert read.errors.corrected and read.errors.mesh_safety == left
    assert np.array_equal(read.stiffness, corrected.stiffness)


@pytest.mark.fem
def test_lines_beside_a_peak_count_with_the_peak_on_either_side() -> None:
    corrected = correct_mesh(reduce_column("tet10", (1, 2, 6)))
    coupled = couple_clamped(COLUMN, corrected)
    modes = solve_modal(coupled.system)
    channels: list[Channel] = [("tcp", direction) for direction in "xyz"]
    lossy = dataclasses.replace(coupled.system, hysteretic=0.02 * coupled.system.stiffness)
    ports = input_columns(lossy, channels), output_rows(lossy, channels)
    meshed = meshed_parts(coupled)
    hz, half = modes.frequencies_hz[0], 0.004
    lines = hz * np.array([1.0 - half, 1.0 + half])

    def sizes(*, either: bool) -> FloatArray:
        parts = {name: dataclasses.replace(each, corrected=either) for name, each in meshed.items()}
        sources = ErrorSources({}, parts, {"body": 0.02})
        found = bound_response_errors(
            project_response(lossy, sources, modes, ports, 2.0 * hz), lines
        )
        assert found.mesh_sizes is not None
        return np.asarray(found.mesh_sizes[:, 0, 0])

    below, above = sizes(either=True)
    # finer meshes alone bring the peak to the line below it and away from the one above
    one_way = sizes(either=False)
    assert below == approx(one_way[0], rel=1e-9)
    assert above > 1.2 * one_way[1]
