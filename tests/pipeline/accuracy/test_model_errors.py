"""What rigid and segmented bodies leave out, compared with the machine of fine finite elements."""

from pathlib import Path

import numpy as np
import pytest
from summary_shapes import list_strangers

from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.pipeline.answers.accuracy import ModelErrorsAnswer
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.numbers.estimates import MODEL
from headstock.pipeline.numbers.numbers import parse_key
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.scene.building.loader import load_scene
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]

# a column on a heavy block on springs, a head on bolts at its top
SCENE = stored_scene("model_errors")
FINE = ("40 mm", "20 mm", "20 mm")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("models")


def run(folder: Path, fidelity: str, *overrides: str) -> Results:
    return compute(folder, SCENE.replace("FIDELITY", fidelity), *overrides, name=fidelity)


@pytest.fixture(scope="module")
def fine(folder: Path) -> Results:
    bodies = zip(("block", "column", "head"), FINE, strict=True)
    return run(
        folder,
        "elastic",
        "model_errors=false",
        *(
            value
            for name, size in bodies
            for value in (
                f"components.{name}.fidelity=elastic",
                f'components.{name}.mesh={{ size = "{size}", cells = "hex" }}',
            )
        ),
    )


@pytest.mark.parametrize("fidelity", ["segmented", "elastic"])
def test_the_estimate_covers_the_machine_of_fine_finite_elements(
    folder: Path, fine: Results, fidelity: str
) -> None:
    found, truth = run(folder, fidelity), fine.modal[0].frequencies_hz
    (modes,) = found.modal
    off = np.abs(modes.frequencies_hz - truth)
    errors = np.array([error.total or np.nan for error in modes.list_errors()])
    assert (off <= errors).all() and (off[:2] > 0.02 * truth[:2]).all()
    assert (errors < 3.0 * off)[off > 0.01 * truth].all()
    point, exact = found.static["reference"]["nose"], fine.static["reference"]["nose"]
    for axis, direction in enumerate("xyz"):
        gap = abs(point.compliance[axis, axis] - exact.compliance[axis, axis])
        error = found.numbers[f"compliance(pose=reference,point=nose,direction={direction})"].error
        total = None if error is None else error.total
        assert total is not None and gap <= total <= 3.0 * gap
    assert not any(
        "rigid model" in words for error in modes.list_errors() for words in error.left_out
    )


def test_parts_of_bodies_add_up_and_are_told_by_name(folder: Path) -> None:
    results = run(folder, "segmented")
    (models,) = find_answers(results.answers, ModelErrorsAnswer)
    assert models.bodies.keys() == {"block", "column", "head"}
    for error in results.modal[0].list_errors():
        assert sum(error.parts[MODEL].values()) == approx(error.shares[MODEL])
    summary = summarise(results)
    assert list(list_strangers(summary)) == []
    assert summary["model_errors"]["bodies"]["head"]["fidelity"] == "rigid"
    # a rigid body alone becomes more compliant; segments may be too compliant already
    first = parse_key("frequency(pose=reference,mode=1)")
    alone = [models.alone[body][first] for body in ("block", "head")]
    assert max(share or 0.0 for share in alone) < 0.0
    (response,) = find_answers(results.answers, PoseResponse)
    assert response.curves.error is not None and MODEL in response.curves.error_share


def test_a_rigid_column_names_the_bending_modes_that_are_missing(folder: Path) -> None:
    stiff = {"x": "20 kN/um", "y": "20 kN/um", "z": "30 kN/um"}
    stiff |= dict.fromkeys(("rx", "ry", "rz"), "900 N m/urad")
    values = [f"joints.feet.stiffness.{axis}={value}" for axis, value in stiff.items()]
    results = run(folder, "rigid", *values)
    (models,) = find_answers(results.answers, ModelErrorsAnswer)
    (words,) = models.missing
    assert "bend" in words and any(words in warning for warning in results.warnings)
    lost = [
        error for error in results.modal[0].list_errors() if error.shares.get(MODEL, 0.0) is None
    ]
    assert lost and all(error.total is None for error in lost)


def test_it_is_planned_only_where_it_is_named(folder: Path) -> None:
    path = write_scene(folder, SCENE.replace("FIDELITY", "segmented"), name="segmented")
    kinds = [stage.kind for stage in plan_scene(load_scene(path)).stages]
    assert kinds.count("models") == 1
    plain = load_scene(path, overrides=["model_errors=false"])
    assert "models" not in [stage.kind for stage in plan_scene(plain).stages]
