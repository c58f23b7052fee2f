"""The quick validation cases, as tests; ``headstock validate`` runs all of them."""

import json

import numpy as np
import pytest
from mpi4py import MPI

from headstock.geometry.parts.components import Material
from headstock.validation.case_registry import run_validation
from headstock.validation.parts import benchmarks
from headstock.validation.parts.beam_cases import clamped_modes
from headstock.validation.parts.benchmarks import check_block
from headstock.validation.parts.closed_form_cases import (
    BLOCK,
    ROD,
    _SprungBlock,
    column,
    mesh_settings,
)
from headstock.validation.parts.order_cases import _cube_error, _rod_frequencies
from headstock.validation.references.rows import rows_as_json

QUICK = (
    "block", "rod", "rod-orders", "static-exactness", "rigid-body-content",
    "beam-truncation", "rod-step", "two-mass-drive", "sampled-control", "drive-friction",
    "nafems-5h", "column-response", "kono-cantilever-static", "square-column", "straight-cantilever",
)  # fmt: skip
LONG = ("all-modes", "eigensolvers", "fv5")


@pytest.mark.parametrize(
    "name", [*QUICK, *(pytest.param(name, marks=pytest.mark.trials) for name in LONG)]
)
def test_every_row_of_the_case_passes(name: str) -> None:
    rows = run_validation([name], comm=MPI.COMM_SELF)
    assert len(rows) >= 3
    assert [row for row in rows if not row.passed] == []
    assert len(json.loads(rows_as_json(rows))) == len(rows)


def test_six_frequencies_of_the_seed_column_on_one_mesh_lie_within_a_fifth_of_a_percent() -> None:
    component = column(mesh_settings("hex27", 0.0125))
    modes = clamped_modes(component, ("z-",), 6, MPI.COMM_SELF)
    np.testing.assert_allclose(
        modes.frequencies_hz[:6], [127.54, 325.76, 778.41, 1025.01, 1758.43, 2098.74], rtol=2e-3
    )
    assert modes.kinds[:6] == ["x", "y", "x", "torsion", "y", "x"]


def test_first_order_elements_of_the_same_size_lock() -> None:
    modes = clamped_modes(column(mesh_settings("tet4", 0.02)), ("z-",), 1, MPI.COMM_SELF)
    assert modes.frequencies_hz[0] > 1.1 * 127.54


def test_a_wrong_stiffness_fails_the_case(monkeypatch: pytest.MonkeyPatch) -> None:
    softer = Material("softer", 0.99 * 210e9, 0.3, 7850.0)
    monkeypatch.setattr(benchmarks, "STEEL", softer)
    rows = run_validation(["square-column"], comm=MPI.COMM_SELF)
    assert any(not row.passed for row in rows)


def test_a_wrong_spring_fails_the_block(monkeypatch: pytest.MonkeyPatch) -> None:
    stiffer = _SprungBlock(BLOCK.size, BLOCK.mass, (1.2e4, 1.2e4, 1.8e4 * (1.0 + 1e-6)))
    monkeypatch.setattr(benchmarks, "BLOCK", stiffer)
    assert any(not row.passed for row in check_block(MPI.COMM_SELF))


def test_the_manufactured_error_falls_with_the_third_power_for_second_order_tetrahedra() -> None:
    errors = [_cube_error("tet10", count, MPI.COMM_SELF) for count in (3, 6)]
    assert 2.8 < np.log2(errors[0] / errors[1]) < 3.3
    assert errors[1] < 1e-2


def test_a_rod_that_is_free_sideways_has_the_axial_frequencies_of_one_that_is_fixed() -> None:
    free = _rod_frequencies("hex27", 16, MPI.COMM_SELF, sideways="free")
    fixed = _rod_frequencies("hex27", 16, MPI.COMM_SELF, sideways="fixed")
    np.testing.assert_allclose(free, fixed, rtol=1e-8)
    assert ROD.material.poisson_ratio == 0.0
