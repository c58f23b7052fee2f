"""A contour as a scene runs it: computed and measured forces, and what the summary and the report
tell.
"""

import dataclasses
import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scene_runs
from common import approx
from headstock.app.drawings.lobes import draw_milled_faces
from headstock.app.drawings.markup import draw_rows
from headstock.app.drawings.path import draw_contour
from headstock.app.views.contouring import (
    _contour_words,
    _list_drive_columns,
    _list_faces,
    _list_gap_columns,
    _tabulate_contour,
    _tabulate_profiles,
)
from headstock.geometry.errors import PoseError
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.lobes import DirectionLobes, PoseLobes
from headstock.pipeline.motion.contour_run import SETTLING, ContourRun
from headstock.pipeline.motion.contouring import _explain_gaps, evaluate_contour
from headstock.pipeline.motion.lumped_contour import run_lumped_contour
from headstock.pipeline.motion.milled_faces import mill_faces
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.csv_files import CsvError, ForceRecord
from headstock.solvers.mechanisms.dynamics import CompliantMechanism, MechanismBody
from headstock.solvers.mechanisms.modes import PoseDamping, linearise_poses, tool_compliance
from headstock.solvers.milling.path_drives import follow_path
from headstock.solvers.milling.tool_dynamics import ToolMode
from headstock.solvers.milling.tool_path import SquareContour, plan_contour
from headstock.validation.mechanisms.contouring_cases import contour_request
from headstock.validation.mechanisms.tripteor_machine import SCENE, Tripteor, load_tripteor

pytestmark = pytest.mark.slow

SHORT = 1.2


@functools.cache
def machine() -> Tripteor:
    return load_tripteor()


def follow(
    request: ContouringRequest,
    until: float,
    *,
    bodies: CompliantMechanism | None = None,
    record: ForceRecord | None = None,
    **changes: Any,
) -> ContourRun:
    """The contour of a request with changes, on the machine or another model of it."""
    tried, model = dataclasses.replace(request, **changes), bodies or machine().model
    return run_lumped_contour(machine().scene, model, tried, record=record, until=until)


@pytest.fixture(scope="module")
def short_run() -> ContourRun:
    """The first face and the ramp before it."""
    return follow(contour_request("al7075-t6"), SHORT)


def changed_block(request: ContouringRequest, **changes: Any) -> SquareContour:
    assert isinstance(request.contour, SquareContour)
    return dataclasses.replace(request.contour, **changes)


def test_measured_forces_that_are_the_computed_ones_give_the_same_motion() -> None:
    request = contour_request("al7075-t6")
    computed = follow(request, 0.5)
    record = ForceRecord(computed.times, computed.force)
    measured = follow(request, 0.5, record=record)
    # the mean over a step instead of the value in its middle
    assert np.abs(measured.gap - computed.gap).max() < 0.02 * np.ptp(computed.gap, axis=0).max()
    with pytest.raises(CsvError, match="are needed"):
        follow(request, 0.6, record=record)


def test_the_summary_tells_faces_assumptions_and_drive_forces(short_run: ContourRun) -> None:
    request, run = contour_request("al7075-t6"), short_run
    answer = evaluate_contour(request, run)
    found = answer.summarise()
    assert [face["face"] for face in found["faces"]] == [1]
    assert -20.0 < found["faces"][0]["mean_um"][0] < -5.0
    assert found["face_3_over_face_1"] == {"x as assumed": None, "x reversed": None}
    assert any("which way x points" in text for text in found["assumptions"])
    table = _tabulate_contour(answer)
    assert len(table.rows) == len(found["series"]["time_s"]) == 2000 and len(table.headings) == 10
    # with a lead of 10 mm a motor turns 2 pi per 10 mm: power in is power out
    forces, torques = (
        np.array(found["series"]["drive_force_n"]),
        np.array(found["series"]["motor_torque_nm"]),
    )
    assert np.allclose(2.0 * np.pi * torques, 0.01 * forces, rtol=1e-12, atol=0.0)
    # the legs hold up 215 kg and themselves, and push against the cut
    assert 500.0 < np.abs(forces).max() < 6000.0
    assert np.allclose(
        found["faces"][0]["drive_force_mean_n"],
        forces[
            run.times[::1][np.unique(np.linspace(0, len(run.times) - 1, 2000).astype(int))] > 0.6
        ].mean(axis=0),
        rtol=0.1,
        atol=0.0,
    )
    gaps = draw_rows(_list_gap_columns(), _list_faces(answer), "gaps")
    means = [repr(value) for value in found["faces"][0]["mean_um"]]
    assert all(f'<data value="{mean}">' in gaps for mean in means)
    drives = draw_rows(_list_drive_columns(answer), _list_faces(answer), "drives")
    assert f'<data value="{found["faces"][0]["drive_force_mean_n"][2]!r}">' in drives
    for picture in ("gap", "drives"):
        assert str(draw_contour(answer, picture)).count("<polyline") == 3


def test_a_steady_force_leaves_a_face_where_the_static_compliance_says() -> None:
    request = contour_request("al7075-t6")
    request = dataclasses.replace(
        request,
        contour=changed_block(request, side=0.02),
        damping=PoseDamping((0.5,)),
        tool_modes=(ToolMode("spindle", 800.0, 0.2, 2e7, np.eye(3)[:, :2]),),
    )
    push = np.array([-200.0, 150.0, 50.0])
    record = ForceRecord(np.array([0.0, 1.0]), np.stack([push, push]))
    run = follow(request, 0.6, record=record)
    faces, reasons = mill_faces(request, run)
    assert [face.number for face in faces] == [1], reasons
    reached = run.plan.cuts[0].begins + float(np.mean(faces[0].evaluated)) / run.plan.cuts[0].feed
    middle = np.array([reached - 1e-3, reached])
    states = follow_path(
        machine().scene.mounted, middle, run.plan.path.at(middle), machine().scene.tool
    ).states
    compliance = tool_compliance(machine().model, linearise_poses(machine().model, states))
    turn = machine().scene.mounted.mounting.rotation
    moved = turn @ compliance[1, :3, :3] @ turn.T @ push + [*push[:2] / 2e7, 0.0]
    face, outward = faces[0], run.plan.cuts[0].outward
    assert face.parameters.location - face.cusp / 3.0 == approx(moved @ outward, rel=5e-4)
    answer = evaluate_contour(request, run, milled=faces)
    rows = _list_faces(answer)
    assert [row.face for row in rows] == [1] and rows[0].gap is None
    assert "cut-off of 0.8 mm" in str(_contour_words(answer))
    assert str(draw_milled_faces(answer.milled)).count("<polyline") == 2
    names = [table.name for table in _tabulate_profiles(answer.milled[0])]
    assert names == ["profile_face_1", "profile_detail_face_1"]


def test_a_block_out_of_reach_is_refused() -> None:
    request = contour_request("al7075-t6")
    far = dataclasses.replace(request, contour=changed_block(request, center=(1.2, 0.0)))
    with pytest.raises(PoseError, match="t ="):
        follow(far, 0.1)


def test_effects_that_are_not_named_are_left_out() -> None:
    request, until = contour_request("al7075-t6"), 0.5
    air = follow(request, until, cutting=False)
    assert not air.force.any()
    still = dataclasses.replace(machine().model, velocity_terms=False)
    plain = follow(request, until, bodies=still, cutting=False)
    change = np.abs(plain.gap - air.gap).max()
    # the tool speeds up to 5 m/min only: centrifugal forces are millinewtons to newtons
    assert 1e-12 < change < 1e-2 * np.abs(air.gap).max()
    waves, cut = follow(request, until, regeneration=True), follow(request, until)
    assert np.abs(waves.force).max() == approx(np.abs(cut.force).max(), rel=0.05)
    assert 1e-9 < np.abs(waves.gap - cut.gap).max() < 3e-6


def test_waves_add_to_the_full_equations_what_they_add_to_the_linear_ones() -> None:
    """To one part in thirty, as deflections move the tool by other parts in the full equations."""
    plain = contour_request("al7075-t6")
    plain = dataclasses.replace(
        plain,
        contour=changed_block(plain, side=5e-3),
        cut=dataclasses.replace(plain.cut, spindle=100.0 * np.pi),
        steps_per_turn=24,
    )
    until = plan_contour(plain.contour).enters + 0.075
    gaps = {
        (model, waves): follow(plain, until, model=model, regeneration=waves).gap
        for model in ("linear", "nonlinear")
        for waves in (False, True)
    }
    added, whole = (gaps[model, True] - gaps[model, False] for model in ("linear", "nonlinear"))
    size = np.abs(added).max()
    assert size > 1e-7
    assert np.abs(whole - added).max() < 0.033 * size


def test_a_mass_on_stiff_springs_at_the_tool_is_a_body_there_in_the_full_equations() -> None:
    """Which moves the mechanism by inertia; its weight is left out as that of all other bodies."""
    plain = contour_request("al7075-t6")
    block = changed_block(plain, side=5e-3, feed=0.2)
    plain = dataclasses.replace(
        plain, contour=block, steps_per_turn=96, damping=PoseDamping((0.0,))
    )
    mass, stiff = 60.0, 4000.0
    stiffness = mass * (2.0 * np.pi * stiff) ** 2
    carried = dataclasses.replace(
        plain, tool_modes=(ToolMode("spindle", stiff, 0.3, stiffness, np.eye(3)),)
    )
    heavier = dataclasses.replace(
        machine().model, bodies=(*machine().model.bodies, MechanismBody("spindle", "tcp", mass))
    )
    gaps = {
        (name, model): follow(tried, 0.1, bodies=bodies, model=model).gap
        for name, bodies, tried in (
            ("without", machine().model, plain),
            ("mode", machine().model, carried),
            ("body", heavier, plain),
        )
        for model in ("linear", "nonlinear")
        if (name, model) not in {("without", "linear"), ("mode", "linear")}
    }
    own, beside = gaps["mode", "nonlinear"], gaps["body", "nonlinear"]
    assert np.abs(beside - gaps["without", "nonlinear"]).max() > 5e-5
    lacking = np.abs(beside - gaps["body", "linear"]).max()
    assert lacking > 5e-7
    assert np.abs(own - beside).max() < 0.2 * lacking


def lobes_on_a_face(request: ContouringRequest, rpm: float, folder: Path) -> DirectionLobes:
    """In the middle of the first face; zeroth order is checked and mended at every speed."""
    face, cut = plan_contour(request.contour).cuts[0], request.cut
    contour = changed_block(request)
    place = face.start + 0.5 * face.length * face.travel + contour.offset * face.outward
    x, y, z = map(float, place)
    overrides = (
        f'poses.face={{ X = "{x} m", Y = "{y} m", Z = "{z} m" }}',
        f'analyses.lobes={{ speeds = ["{rpm} rpm", "{1.01 * rpm} rpm", 2], radial_depth = "{cut.radial_depth} m", '
        f'mill = {{ diameter = "{cut.mill.diameter} m", teeth = {cut.mill.teeth}, helix = "{cut.mill.helix} rad" }}, '
        f'material = "{request.material}", directions = [{face.travel.tolist()}], checked = 1.0, poses = ["face"] }}',
    )
    scene = load_scene(SCENE, variant="lumped", overrides=overrides)
    scene = dataclasses.replace(scene, analyses=scene.analyses.keep(["lobes"]))
    found = scene_runs.run(scene, folder)
    (lobes,) = find_answers(found.answers, PoseLobes)
    return lobes.directions[0]


@pytest.mark.parametrize(
    ("rpm", "off"),
    [
        (2000.0, 0.4),
        pytest.param(3000.0, 0.0, marks=pytest.mark.trials),
        pytest.param(4000.0, 0.0, marks=pytest.mark.trials),
    ],
)
def test_waves_decay_below_the_lobes_of_a_lumped_mechanism_and_grow_above_in_time(
    tmp_path: Path, rpm: float, off: float
) -> None:
    """Regeneration integrated along a straight cut; at 2000 rpm zeroth order alone is 40 % off."""
    request = contour_request("al7075-t6")
    block = changed_block(request, side=0.06, lead=0.012, feed=0.04)
    request = dataclasses.replace(request, contour=block, regeneration=True, steps_per_turn=48)
    lobes = lobes_on_a_face(request, rpm, tmp_path)
    limit = float(lobes.depths[0])
    assert lobes.zeroth[0] / limit - 1.0 == approx(off, abs=0.05)
    begins, growth = plan_contour(block).cuts[0].begins, {}
    for share in (0.9, 1.1):
        cut = dataclasses.replace(
            request.cut, axial_depth=share * limit, spindle=rpm * np.pi / 30.0
        )
        deeper = dataclasses.replace(request, cut=cut)
        run = follow(deeper, until=begins + 1.0)
        delay = request.steps_per_turn // cut.mill.teeth
        # what differs from one tooth to the next is no forced motion
        waves = np.abs(run.gap[delay:] - run.gap[:-delay]).max(axis=1)
        since = run.times[delay:] - begins
        early, late = (
            waves[(since > start) & (since < start + 0.15)].max() for start in (0.35, 0.85)
        )
        growth[share] = float(np.log(late / early))
    assert growth[0.9] < -0.2
    assert growth[1.1] > 0.2
    # the border lies where the logarithm passes zero
    border = 0.9 + 0.2 * growth[0.9] / (growth[0.9] - growth[1.1])
    assert border == approx(1.0, abs=0.04)


def test_a_face_that_is_passed_too_fast_has_no_gap_and_a_reason(short_run: ContourRun) -> None:
    request, run = contour_request("al7075-t6"), short_run
    assert _explain_gaps(run) == []
    cut = run.plan.cuts[0]
    hasty = dataclasses.replace(cut, ends=cut.begins + 1.5 * SETTLING)
    assert hasty.ends < run.times[-1]
    hurried = dataclasses.replace(run, plan=dataclasses.replace(run.plan, cuts=(hasty,)))
    (reason,) = _explain_gaps(hurried)
    assert reason.startswith("face 1 has no gap") and "write a lower feed" in reason
    assert _list_faces(evaluate_contour(request, hurried)) == []
