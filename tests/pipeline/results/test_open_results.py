"""Results of a run come back from ``results.h5`` as they were, of every kind of analysis."""

import dataclasses
import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from cases import cases
from common import find_difference
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.results.files import open_results
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.outputs import OutputError
from headstock.pipeline.storage.records import RecordError
from headstock.pipeline.storage.typed_json import (
    AnyArray,
    decode_value,
    encode_value,
    reachable_classes,
)
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import keep_analyses, list_analyses

MACHINES = Path(__file__).resolve().parents[3] / "machines"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Results, Path]:
    folder = tmp_path_factory.mktemp("run")
    few = (
        'analyses.path.feeds=["3000 mm/min"]',
        'analyses.lobes.speeds=["3000 rpm", "9000 rpm", 20]',
    )
    scene = load_scene(MACHINES / "three_axis.toml", variant="R+frf+controlled", overrides=few)
    wanted = keep_analyses(scene, list(list_analyses(scene)))
    return run_scene(wanted, folder, comm=MPI.COMM_SELF), folder


def test_every_answer_comes_back_to_the_last_bit(run: tuple[Results, Path]) -> None:
    results, folder = run
    opened = open_results(folder)
    kinds = {type(answer).__name__ for answer in results.answers}
    assert kinds >= {"StaticAnswer", "PoseModes", "PoseResponse", "ControlAnswer", "PathResult"}
    for name in ("answers", "components", "joint_springs", "versions", "warnings", "labels"):
        assert find_difference(getattr(results, name), getattr(opened, name), name) == ""
    assert opened.files == results.files
    assert [record.stage.kind for record in opened.stages] == [
        record.stage.kind for record in results.stages
    ]


def test_the_comparison_of_this_file_sees_a_difference(run: tuple[Results, Path]) -> None:
    results, _ = run
    first, *rest = results.modal
    changed = dataclasses.replace(first, frequencies_hz=first.frequencies_hz * (1.0 + 1e-15))
    assert find_difference((first, *rest), (changed, *rest)) == "[0].frequencies_hz"


def test_arrays_that_are_in_the_file_are_not_there_twice(run: tuple[Results, Path]) -> None:
    _, folder = run
    with h5py.File(folder / "results.h5", "r") as file:
        shapes = [item for item in file["modal"].values() if "shapes" in item]
        copies = file.get("record/arrays", {}).values()
        assert shapes
        assert all(copy.shape != item["shapes"].shape for item in shapes for copy in copies)


def test_values_of_every_kind_survive() -> None:
    kept: dict[str, AnyArray] = {}

    def keep(array: AnyArray) -> str:
        name = str(len(kept))
        kept[name] = array
        return name

    values = (
        None,
        True,
        3,
        float("nan"),
        float("inf"),
        1 - 2j,
        "ä",
        {("a", "b"): (1.0,)},
        np.zeros((0, 3)),
        np.array([1 + 2j, 3.0]),
        np.arange(1000.0).reshape(10, 100),
        np.array([True, False]),
    )
    coded = json.loads(json.dumps(encode_value(values, keep)))
    assert find_difference(decode_value(coded, {}, kept.__getitem__), values) == ""
    assert len(kept) == 1


@cases
def test_what_no_record_holds_is_refused(coded: dict[str, object]) -> None:
    classes = reachable_classes([Results, *Answer.__subclasses__()])
    with pytest.raises(RecordError):
        decode_value(json.loads(json.dumps(coded)), classes, lambda name: np.zeros(1))


def test_results_of_an_earlier_version_are_refused_with_a_remedy(
    run: tuple[Results, Path], tmp_path: Path
) -> None:
    _, folder = run
    with pytest.raises(OutputError, match=r"headstock run SCENE"):
        open_results(tmp_path)
    for name in ("results.h5", "summary.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    with h5py.File(tmp_path / "results.h5", "a") as file:
        del file["record"]
    with pytest.raises(OutputError, match="damaged"):
        open_results(tmp_path)
