"""Probes in an elastic leg while the tool of a mechanism goes along a line: what its screw pushes is in
the section, and a place beside its end goes with that end.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from summary_shapes import list_strangers

import scene_runs
from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.app.report.report import render_report
from headstock.app.views.registry import list_tables
from headstock.geometry.frames import DOF_NAMES
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.contouring import ContourAnswer
from headstock.pipeline.answers.path import PathResult, PathRun
from headstock.pipeline.results.files import open_results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.store import Store
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import keep_analyses
from headstock.solvers.milling.tool_path import plan_contour
from headstock.validation.mechanisms.tripteor_machine import SCENE as TRIPTEOR

# of the tube of leg 3 [m]; of a thick wall, for which a coarse mesh is fine
RADII = 0.05975, 0.09275
SECTION, BESIDE_TIP = 1.75, 1.89  # along the tube, whose end is at 1.9 m
PATH = (
    'analyses.path={from={X="-4 mm",Y="48 mm",Z="208 mm"},to={X="4 mm",Y="52 mm",Z="212 mm"},feeds=["3 m/min"],'
    'time_constant="50 ms",ramp="s_curve",jerk_time="20 ms",residual_time="50 ms",sampling="2 kHz",pose_model="frozen",lowpass="200 Hz",estimate=false,'
    f"outputs=[{','.join(f'''["beam_3.tip","{dof}"]''' for dof in DOF_NAMES)}]}}"
)


def probe_settings() -> list[str]:
    """Four places around the middle of the wall, and two on opposite sides beside the end."""
    middle = 0.5 * sum(RADII)
    places = {
        f"around_{number}": (middle * math.cos(angle), middle * math.sin(angle), SECTION)
        for number, angle in enumerate(0.5 * math.pi * np.arange(4))
    }
    places |= {"beside_0": (middle, 0.0, BESIDE_TIP), "beside_1": (-middle, 0.0, BESIDE_TIP)}
    return [
        f"probes.{name}={{component='beam_3',at=[{','.join(f'"{1e3 * x:.4f} mm"' for x in place)}]}}"
        for name, place in places.items()
    ]


def run(folder: Path, variant: str, *settings: str) -> PathRun:
    """The move."""
    rigid = [f'components.beam_{leg}.fidelity="rigid"' for leg in (1, 2)]
    leg = [f'components.beam_3.solid.tube.inner="{2e3 * RADII[0]} mm"']
    leg += ['components.beam_3.mesh.size="120 mm"']
    overrides = [PATH, *leg, *rigid, *probe_settings(), *settings]
    scene = keep_analyses(
        load_scene(TRIPTEOR, variant=f"elastic_legs{variant}", overrides=overrides), ["path"]
    )
    results = run_scene(
        scene, folder / "out", comm=MPI.COMM_SELF, store=Store(folder.parent / "store")
    )
    assert results.failures == ()
    (found,) = find_answers(results.answers, PathResult)
    (own,) = found.runs
    return own


@pytest.mark.slow
@pytest.mark.parametrize("control", ["", "+controlled"])
def test_a_leg_carries_at_its_probes_what_its_screw_pushes(control: str, tmp_path: Path) -> None:
    """Beyond the section are 5 kg of the tube, whose inertia the screw does not feel there. Under
    control the leg goes with its motor, too.
    """
    own = run(tmp_path, control)
    stress = np.mean([own.probes[f"around_{n}"].trace.stress for n in range(4)], axis=0)
    area = math.pi * (RADII[1] ** 2 - RADII[0] ** 2)
    force = area * stress[:, :3].sum(axis=1)  # stress along the leg is all there is
    pushed = max(abs(each.value) for each in own.joints["screw_3"].values())
    assert pushed > 100.0
    assert np.abs(force).max() == approx(pushed, rel=2e-2)
    ends = [own.probes[f"beside_{n}"].trace.displacement for n in range(2)]
    tip = own.curves.deviation.total[:, :3]
    size = np.abs(tip).max()
    # the deviation is filtered, and the places are 10 mm before the end
    assert np.abs(np.mean(ends, axis=0) - tip).max() < 5e-2 * size


@pytest.mark.slow
@pytest.mark.parametrize("control", ["", "+controlled"])
def test_a_probe_goes_with_its_leg_where_an_uneven_rigid_screw_leads_it(
    control: str, tmp_path: Path
) -> None:
    screw = (
        "joints.screw_3={between=['beam_3.tip','platform.joint_3'],kind='ball_screw',axis='z',at=['0 mm','0 mm','0 mm'],"
        "stiffness={axial='rigid'},errors={axial={waves=[{period='2 mm',amplitude='50 um'}]}}}"
    )
    own = run(tmp_path, control, screw, "effects.guide_errors=true")
    ends = [own.probes[f"beside_{n}"].trace.displacement for n in range(2)]
    tip = own.curves.deviation.total[:, :3]
    size = np.abs(tip).max()
    assert size > 5e-5
    assert np.abs(np.mean(ends, axis=0) - tip).max() < 2e-2 * size


BAR = stored_scene("trajectory_probes_bar")
PULL, PUSH = 100.0, 20.0  # on the end of the bar, along and across it [N]
LENGTH, SIDE, DENSITY, MODULUS = 0.2, 0.02, 7850.0, 210e9
PLACE, OFF_AXIS = 0.063, 0.003  # of the probe, from the foot and off the axis [m]


@pytest.mark.slow
@pytest.mark.parametrize("control", ["", "drive_control = true\n"])
def test_a_bar_along_a_contour_carries_its_inertia_and_the_cut(
    control: str, tmp_path: Path
) -> None:
    """As a rod and as a beam: accelerated along itself and across in a corner, under a steady force."""
    (tmp_path / "steady.csv").write_text(f"time,fx,fy,fz\n-1,{PULL},{PUSH},0\n9,{PULL},{PUSH},0\n")
    path = write_scene(tmp_path, BAR.replace("cutting_force", f"{control}cutting_force"))
    results = scene_runs.run(load_scene(path), tmp_path)
    (found,) = find_answers(results.answers, ContourAnswer)
    request = load_scene(path).analyses[ContouringRequest]
    now = plan_contour(request.contour).path.at(found.times)
    along, across = now.acceleration[:, 0], now.acceleration[:, 1]
    beyond, area = LENGTH - PLACE, SIDE**2
    rod = PULL / area - DENSITY * along * beyond
    moment = PUSH * beyond - DENSITY * area * across * beyond**2 / 2.0
    expected = rod - moment * OFF_AXIS / (SIDE**4 / 12.0)
    trace = found.probes["inside"].trace
    off = trace.stress[:, 0] - expected
    assert abs(off[0]) < 1e-3 * abs(expected[0])
    assert np.abs(off - off[0]).max() < 6e-3 * np.ptp(expected)
    assert np.ptp(expected) > 2e4
    # beside what screws and controllers leave, the bar is longer between the probe and its end
    longer = (PULL / area * beyond - DENSITY * along * beyond**2 / 2.0) / MODULUS
    # the section of the probe turns, and it stands off the axis
    bent = PUSH * (LENGTH**2 - beyond**2) / 2.0
    turned = bent - DENSITY * area * across * (LENGTH**3 - beyond**3) / 6.0
    tilted = turned / (MODULUS * SIDE**4 / 12.0) * OFF_AXIS
    off = found.gap[:, 0] - trace.displacement[:, 0] - longer - tilted
    assert np.abs(off).max() < 2e-3 * np.abs(longer + tilted).max()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert list(list_strangers(summary)) == []
    peak = summary["contouring"]["probes"]["inside"]
    assert peak["peak_displacement_um"] >= 1e6 * np.abs(trace.displacement[:, 0]).max()
    results = open_results(tmp_path / "out")
    tables = {table.name: table for table in list_tables(results)}
    assert "stress xx inside [MPa]" in tables["contour"].headings
    assert tables["probes_contour"].rows[0][0] == "inside"
    page = render_report(results)
    assert "Equivalent stress at probes, beside that under gravity [MPa]" in page
