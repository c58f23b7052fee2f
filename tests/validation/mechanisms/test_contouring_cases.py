"""The start of the contour; ``headstock validate tripteor`` runs all of it."""

import numpy as np
import pytest

from common import approx
from headstock.pipeline.motion.contour_run import ContourRun
from headstock.pipeline.motion.lumped_contour import run_lumped_contour
from headstock.validation.mechanisms.contouring_cases import contour_request
from headstock.validation.mechanisms.tripteor_machine import load_tripteor

pytestmark = pytest.mark.slow


def run_start(material: str, until: float) -> ContourRun:
    tripteor = load_tripteor()
    return run_lumped_contour(
        tripteor.scene, tripteor.model, contour_request(material), until=until
    )


def test_the_tool_is_pushed_off_face_1_by_about_ten_micrometres_and_hardly_ripples() -> None:
    run = run_start("al7075-t6", 1.0)
    cutting = run.times > run.plan.enters + 0.4
    gap = 1e6 * run.gap[cutting, 0]
    assert 5.0 < -gap.mean() < 20.0
    assert np.ptp(gap) < 1.5
    assert np.abs(run.gravity_deflection[:, 0]).min() > 3e-5
    # mean forces push the tool away from the part, which lies on the right
    forces = run.force[cutting][: 40 * 96]
    assert forces[:, 0].mean() < -250.0 and forces[:, 1].mean() > 100.0
    assert run.times[1] - run.times[0] == approx(60.0 / 13000.0 / 96.0)


def test_before_the_cut_only_inertia_moves_the_tool_and_against_the_start() -> None:
    run = run_start("al6061-t6", 0.02)
    assert not run.force.any()
    assert np.abs(run.gap[0]).max() < 1e-12
    assert run.gap[-1, 1] < -1e-5 and np.abs(run.gap[-1, [0, 2]]).max() < 0.2 * np.abs(
        run.gap[-1, 1]
    )
