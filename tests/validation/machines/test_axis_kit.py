"""One set of parameters gives the paper's table 3, with segments and with finite elements."""

import numpy as np
import pytest
from mpi4py import MPI

from common import approx
from headstock.geometry.parts.solids import Box
from headstock.scene.building.loader import load_scene
from headstock.solvers.pairing.mode_pairing import match_frequencies
from headstock.studies.identification.target_files import load_targets
from headstock.validation.machines.axis_kit_cases import (
    FEM_TOLERANCE,
    FIDELITY_TOLERANCE,
    MEASURED_MODES,
    SCENE,
    TABLE_3,
    TABLE_3_FEM,
    _evaluate_table_3,
    _find_missing_motions,
    _KitModel,
    _KitWorkshop,
    _pair_fidelities,
    _show_shapes,
)


@pytest.fixture(scope="module")
def workshop() -> _KitWorkshop:
    return _KitWorkshop(MPI.COMM_SELF, mesh_size="35 mm")


@pytest.fixture(scope="module")
def segmented(workshop: _KitWorkshop) -> dict[str, _KitModel]:
    return {variant: workshop.solve(variant, "segmented") for variant in TABLE_3}


def test_the_scene_has_the_travels_leads_and_driven_masses_of_table_1() -> None:
    scene = load_scene(SCENE, variant="calibrated+R+controlled")
    machine = scene.machine
    driven = {"X": ("x_slider",), "Y": ("y_slider", "z_slider"), "Z": ("z_slider",)}
    leads = {name: drive.lead for name, drive in scene.drives.items()}
    assert leads == approx({"X": 0.010, "Y": 0.010, "Z": 0.005})
    travels = {name: axis.limits[1] - axis.limits[0] for name, axis in machine.axes.items()}
    assert travels == approx(dict.fromkeys("XYZ", 0.2))
    weights = {name: part.mass or 0.0 for name, part in machine.components.items()}
    masses = {name: sum(weights[body] for body in bodies) for name, bodies in driven.items()}
    assert masses == approx({"X": 35.0, "Y": 47.0, "Z": 4.0})


def test_the_22_frequencies_of_table_3_come_out_within_3_percent(
    segmented: dict[str, _KitModel],
) -> None:
    rows = list(_evaluate_table_3(segmented))
    assert len(rows) == 22 + 4
    assert [row.quantity for row in rows if not row.passed] == []


def test_the_measured_compliance_in_z_comes_out_within_5_percent(
    segmented: dict[str, _KitModel],
) -> None:
    assert segmented["YCE"].compliance[2] == approx(151e-9, rel=0.05)


def test_every_paired_mode_moves_as_the_paper_describes_it(segmented: dict[str, _KitModel]) -> None:
    rows = list(_show_shapes(segmented["YCE"]))
    assert len(rows) > 3 and all("as described" in row.note for row in rows)


def test_finite_elements_agree_with_segments_and_with_the_paper_s_own(
    workshop: _KitWorkshop, segmented: dict[str, _KitModel]
) -> None:
    fine = workshop.solve("YCE", "elastic")
    coarse = segmented["YCE"]
    pairs = [
        pair for pair in _pair_fidelities(coarse, fine) if coarse.frequencies_hz[pair.first] < 280.0
    ]
    assert len(pairs) == len(TABLE_3["YCE"])
    coarse_hz = coarse.frequencies_hz[[pair.first for pair in pairs]]
    fine_hz = fine.frequencies_hz[[pair.second for pair in pairs]]
    assert fine_hz == approx(coarse_hz, rel=FIDELITY_TOLERANCE)
    met = list(match_frequencies(np.log(fine.frequencies_hz), np.log(TABLE_3_FEM)))
    assert fine.frequencies_hz[met] == approx(TABLE_3_FEM, rel=FEM_TOLERANCE)


def test_a_motion_in_the_wrong_sense_is_named() -> None:
    counter = next(mode for mode in MEASURED_MODES if mode.number == 2)
    turning = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    motions = dict.fromkeys(("y_base", "y_slider", "z_slider", "x_slider"), turning)
    assert _find_missing_motions(counter, motions) == ["C of x_slider"]
    motions["x_slider"] = -turning
    assert _find_missing_motions(counter, motions) == []
    assert _find_missing_motions(counter, motions | {"y_base": -turning}) != []


def test_calibrated_values_are_sensible_and_guides_fit_their_sliders() -> None:
    machine = load_scene(SCENE, variant="calibrated+segmented+YCE").machine
    size = {
        name: np.array(part.solid.size)
        for name, part in machine.components.items()
        if isinstance(part.solid, Box)
    }
    assert all(0.02 <= size[name][0] <= 0.06 for name in ("column_left", "column_right", "y_base"))
    for name, joint in machine.joints.items():
        springs = joint.stiffness.diagonal()[:3]
        limit = (1e6, 5e9) if "foot" in name else (10e6, 800e6)
        assert name.startswith("air") or all(
            limit[0] <= value <= limit[1] for value in springs[springs > 0.0]
        )
    rows = (("y", "y_carriage", (1, 2)), ("z", "z_carriage", (1, 2)), ("x", "x_pad", (0, 1)))
    for slider, prefix, axes in rows:
        joints = [joint for name, joint in machine.joints.items() if name.startswith(prefix)]
        points = np.array([joint.point for joint in joints])
        assert all(np.ptp(points[:, axis]) < size[f"{slider}_slider"][axis] for axis in axes)
    masses = {name[0]: part.mass for name, part in machine.components.items() if "slider" in name}
    assert masses == {"x": 35.0, "y": 43.0, "z": 4.0}


def test_the_targets_of_the_fit_are_table_3() -> None:
    task = load_targets(SCENE.with_name("three_axis_targets.toml"), SCENE).task
    cases = [case for case in task.cases if case.modes]
    listed = {case.name: tuple(mode.frequency_hz for mode in case.modes) for case in cases}
    assert listed == TABLE_3
