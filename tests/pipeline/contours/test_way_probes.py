"""Probes in an elastic leg while the tool of a mechanism goes along a line: what its screw pushes is in
the section, and a place beside its end goes with that end.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from headstock.geometry.frames import DOF_NAMES
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.path import PathResult, PathRun
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import keep_analyses
from headstock.validation.mechanisms.tripteor_machine import SCENE as TRIPTEOR

RADII = 0.08475, 0.09275  # of the tube of leg 3 [m]
SECTION, BESIDE_TIP = 1.75, 1.89  # along the tube, whose end is at 1.9 m
PATH = (
    'analyses.path={from={X="-4 mm",Y="48 mm",Z="208 mm"},to={X="4 mm",Y="52 mm",Z="212 mm"},feeds=["3 m/min"],'
    'time_constant="50 ms",ramp="s_curve",jerk_time="20 ms",residual_time="50 ms",sampling="2 kHz",pose_model="frozen",lowpass="200 Hz",'
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
    overrides = [PATH, 'components.beam_3.mesh.size="80 mm"', *rigid, *probe_settings(), *settings]
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
    assert np.abs(force).max() == pytest.approx(pushed, rel=2e-2)
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
