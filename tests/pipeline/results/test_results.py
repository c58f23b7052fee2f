"""Result files are whole, strict and carry the keys that others rely on."""

import dataclasses
import json
import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from headstock.geometry.frames import Frame
from headstock.geometry.machine.machine import Pose
from headstock.meshing.component_mesh import MeshQuality
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer
from headstock.pipeline.numbers.estimates import REDUCTION, Estimate
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.numbers.numbers import make_key
from headstock.pipeline.planning.plan import Stage, StageRecord
from headstock.pipeline.results.files import add_results, publish_summary
from headstock.pipeline.results.results import ComponentFacts, Results
from headstock.pipeline.results.summary import summarise
from headstock.pipeline.stages.warnings import _mesh_warnings
from headstock.pipeline.storage.outputs import (
    OutputError,
    PendingOutputs,
    claim_output,
    prepare_output,
)
from headstock.solvers.errors import AccuracyError

COMPLIANCE = np.diag([1e-9, 2e-9, 3e-9, 1e-6, 1e-6, 1e-6])
POINT = PointCompliance(
    COMPLIANCE,
    {direction: {"column": 0.75, "guide": 0.25} for direction in "xyz"},
    "The guide gives 25 %.",
)
MODES = PoseModes(
    pose=Pose("config_1", {"X": 0.01}),
    frequencies_hz=np.array([1e-6, 100.0]),
    rigid_count=1,
    errors={
        make_key("frequency", pose="config_1", mode=mode): error
        for mode, error in enumerate(
            (
                Estimate({REDUCTION: None}),
                Estimate({REDUCTION: 0.5, "discretisation": 0.25}, ("the model of bed (rigid)",)),
            ),
            1,
        )
    },
    damping_ratio=(None, None),
    mode_names=("whole machine moves X freely", "column bends x"),
    energy_share=({"column": 1.0}, {"column": 0.9, "guide": 0.1}),
    kinetic_share=({"column": 1.0}, {"column": 1.0}),
    shapes=np.eye(6)[:, :2],
    placements={"column": Frame()},
    pose_units={"X": "m"},
)


def make_results() -> Results:
    facts = ComponentFacts(
        "elastic", 6264, 32, 14.9, np.inf, 1e-12, MeshQuality(0.4, 0, 1e-3, float("nan"))
    )
    return Results(
        name="column",
        versions={"numpy": "2"},
        stages=(StageRecord(Stage("mesh", "column", "elastic"), 0.42, True, 80.0),),
        components={"column": facts},
        answers=(StaticAnswer("config_1", {"tcp": POINT}), MODES),
        joint_springs={"guide": np.eye(6)},
        labels=("column.tip.x",),
        warnings=("linear elements lock",),
    )


def write_all(folder: Path, results: Results) -> None:
    prepare_output(folder)
    with PendingOutputs() as pending:
        add_results(pending, folder, results)
        publish_summary(pending, folder, results)


def test_the_summary_has_the_keys_that_stay_stable() -> None:
    summary = summarise(make_results())
    assert {
        "name",
        "status",
        "versions",
        "stages",
        "components",
        "static",
        "modal",
        "warnings",
    } <= summary.keys()
    assert {"stage", "component", "reason", "seconds", "cached", "peak_rss_mb"} <= summary[
        "stages"
    ][0].keys()
    assert {"fidelity", "full_dofs", "reduced_dofs", "mass_kg"} <= summary["components"][
        "column"
    ].keys()
    assert summary["static"]["tcp"].keys() >= {"compliance_um_per_kN", "compliance_6x6", "budget"}
    assert summary["modal"][0].keys() >= {
        "pose_name", "pose", "frequencies_hz", "error_hz", "damping_ratio", "mode_names", "energy_share",
    }  # fmt: skip


def test_compliance_is_shown_in_micrometres_per_kilonewton() -> None:
    assert summarise(make_results())["static"]["tcp"]["compliance_um_per_kN"] == [
        [1.0, 0, 0],
        [0, 2.0, 0],
        [0, 0, 3.0],
    ]


def test_static_results_of_several_poses_are_all_kept_and_the_first_one_leads() -> None:
    other = dataclasses.replace(POINT, compliance=2 * COMPLIANCE)
    summary = summarise(
        dataclasses.replace(
            make_results(),
            answers=(
                StaticAnswer("config_1", {"tcp": POINT}),
                StaticAnswer("config_2", {"tcp": other}),
            ),
        )
    )
    assert summary["static"] == summary["static_poses"]["config_1"]
    assert summary["static_poses"]["config_2"]["tcp"]["compliance_6x6"][0][0] == 2e-9


def test_a_refused_analysis_shows_in_the_status() -> None:
    summary = summarise(
        dataclasses.replace(make_results(), failures=("static: 1 rigid motion is free",))
    )
    assert (summary["status"], summary["failures"]) == (
        "failed",
        ["static: 1 rigid motion is free"],
    )


def test_missing_values_are_null_and_the_file_is_strict_json(tmp_path: Path) -> None:
    write_all(tmp_path, make_results())

    def refuse(token: str) -> None:
        raise AssertionError(f"{token} in the summary")

    summary = json.loads((tmp_path / "summary.json").read_text(), parse_constant=refuse)
    assert summary["modal"][0]["error_hz"] == [None, 0.75]
    assert summary["modal"][0]["error_share"][0] == {"reduction": None}
    assert summary["modal"][0]["error_left_out"] == ["the model of bed (rigid)"]
    assert summary["components"]["column"]["cutoff_hz"] is None
    assert summary["components"]["column"]["mesh_quality"]["cad_volume"] is None
    assert read_summary(tmp_path) == summary


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_number_that_is_not_finite_is_an_error_and_leaves_earlier_files_alone(
    tmp_path: Path, value: float
) -> None:
    write_all(tmp_path, make_results())
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    broken = dataclasses.replace(MODES, frequencies_hz=np.array([1.0, value]))
    results = dataclasses.replace(make_results(), answers=(broken,))
    with PendingOutputs() as pending:
        with pytest.raises(AccuracyError, match="not finite"):
            add_results(pending, tmp_path, results)
        with pytest.raises(AccuracyError, match="not finite"):
            publish_summary(pending, tmp_path, results)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_every_array_of_the_results_says_its_unit(tmp_path: Path) -> None:
    write_all(tmp_path, make_results())
    with h5py.File(tmp_path / "results.h5") as file:
        units: dict[str, str | None] = {}
        file.visititems(
            lambda name, item: (
                units.update({name: item.attrs.get("unit")})
                if isinstance(item, h5py.Dataset)
                else None
            )
        )
        assert file["modal/config_1/pose_units"].attrs["X"] == "m"
    assert None not in units.values()
    assert (
        units["joints/guide/stiffness"] == "SI: N and N m per m and rad"
        and units["modal/config_1/frequencies_hz"] == "Hz"
    )


def test_results_hold_shapes_compliances_and_joint_springs(tmp_path: Path) -> None:
    write_all(tmp_path, make_results())
    with h5py.File(tmp_path / "results.h5") as file:
        np.testing.assert_array_equal(file["static/config_1/tcp/compliance"], COMPLIANCE)
        np.testing.assert_array_equal(file["modal/config_1/frequencies_hz"], MODES.frequencies_hz)
        np.testing.assert_array_equal(file["modal/config_1/shapes"], MODES.shapes)
        assert file["modal/config_1/pose"].attrs["X"] == 0.01
        np.testing.assert_array_equal(file["joints/guide/stiffness"], np.eye(6))
        assert file["versions"].attrs["numpy"] == "2"


@pytest.mark.parametrize("room", [0, 1], ids=["for nothing", "for results.h5 only"])
def test_a_full_disk_leaves_both_old_files_whole_and_no_temporary_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    write_all(tmp_path, make_results())
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    calls: list[int] = []

    def full_disk(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) > room:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OutputError, match="No space left"):
        write_all(tmp_path, dataclasses.replace(make_results(), name="other"))
    assert len(calls) == room + 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_an_output_folder_that_cannot_be_written_is_refused_beforehand(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(OutputError, match="cannot be written"):
        prepare_output(tmp_path / "file" / "results")


def test_a_folder_that_another_run_writes_into_is_refused(tmp_path: Path) -> None:
    with (
        claim_output(tmp_path),
        pytest.raises(OutputError, match="another run is writing"),
        claim_output(tmp_path),
    ):
        pass
    with claim_output(tmp_path):
        assert list(tmp_path.iterdir()) == []


def test_a_folder_without_a_summary_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="headstock run"):
        read_summary(tmp_path)
    (tmp_path / "summary.json").write_text("{")
    with pytest.raises(OutputError, match="not a summary"):
        read_summary(tmp_path)


def test_a_few_poor_elements_are_not_warned_of_and_many_are_with_share_and_place() -> None:
    few = MeshQuality(0.01, 24, 1e-3, float("nan"), poor_share=4e-5)
    assert _mesh_warnings(few, dofs=40_000) == []
    many = dataclasses.replace(
        few, poor_share=0.02, worst_place=np.array([0.1, 0.2, 0.3]), worst_face="face:12"
    )
    (warning,) = _mesh_warnings(many, dofs=40_000)
    assert "0.02 of the volume" in warning and "(0.1, 0.2, 0.3) m, face:12" in warning
    assert _mesh_warnings(dataclasses.replace(few, repaired=2000), dofs=40_000) == [
        "2000 curved elements were inverted as meshed and were repaired"
    ]
