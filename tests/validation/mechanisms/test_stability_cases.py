"""Regenerative stability by second methods; ``headstock validate milling-stability`` takes finer
steps.
"""

import pytest
from mpi4py import MPI

from headstock.validation.mechanisms.contouring_cases import check_contour_stability
from headstock.validation.mechanisms.stability_cases import check_stability_methods

pytestmark = pytest.mark.slow


def test_multipliers_and_limits_meet_closed_forms_and_independent_methods() -> None:
    rows = list(check_stability_methods(MPI.COMM_SELF, 400))
    assert len(rows) == 42
    assert [row for row in rows if not row.passed] == []


def test_faces_across_x_chatter_first_and_face_3_hardly_before_face_1() -> None:
    rows = list(check_contour_stability(MPI.COMM_SELF))
    assert [row for row in rows if not row.passed] == []
    limits = {row.quantity: row.value for row in rows if "limit depth on face" in row.quantity}
    one, two, three, four = (
        limits[f"al7075-t6: limit depth on face {face}"] for face in (1, 2, 3, 4)
    )
    assert 10.0 < three < one < 0.6 * min(two, four)
