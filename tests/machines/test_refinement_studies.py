"""Short refinement studies of the two beams that ship: the models that decide what the series must
show.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import pytest
from mpi4py import MPI

from common import present
from fixture_machines import write_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.studies import Study
from headstock.studies.parameters.runs import StudyJob, hash_scene, run_study
from headstock.validation.refinement.points import (
    ModelKind,
    RefinementPoint,
    _RefinementError,
    collect_points,
    deviations,
    measure_beam,
    pick_series,
    worst_of,
)
from headstock.validation.refinement.references import ReferenceBeam, reference_beam
from headstock.validation.refinement.statements import evaluate_own, evaluate_statements

pytestmark = [pytest.mark.fem, pytest.mark.process]

MACHINES = Path(__file__).resolve().parents[2] / "machines"
RefinementSeries = Mapping[str, Sequence[int | str]]
Refinement = tuple[ReferenceBeam, list[RefinementPoint]]
CANTILEVER: RefinementSeries = {
    "static_segmented": [2, 5, 15, 70],
    "static_hex8": ["100 mm", "50 mm"],
    "static_tet4": ["30 mm"],
    "static_hex27": ["25 mm"],
    "modal_segmented": [2, 10, 35],
    "modal_hex8": ["50 mm"],
    "modal_hex27": ["25 mm", "19 mm"],
}
FIXED: RefinementSeries = {
    "static_segmented": [3, 15, 51],
    "static_tet4": ["200 mm"],
    "static_hex8": ["200 mm"],
    "modal_segmented": [10, 70],
    "modal_hex8": ["60 mm", "32 mm"],
    "modal_hex27": ["60 mm"],
}


def short_study(study: Study, series: RefinementSeries) -> Study:
    """The families of a study with few of their own segments or sizes."""
    families = []
    for family in (family for family in study.families if family.name in series):
        (key,) = {*family.vary} - {"variant"}
        models = series[family.name]
        assert set(models) <= set(family.vary[key]), "the shipped study has these models"
        vary = {**family.vary, key: tuple(models)}
        families.append(dataclasses.replace(family, vary=vary))
    return dataclasses.replace(study, families=tuple(families), cold=False, repeats=1)


def climb(
    name: str, series: RefinementSeries, folder: Path, scene_file: Path | None = None
) -> Refinement:
    path = scene_file or MACHINES / f"{name}.toml"
    scene = load_scene(path)
    study = short_study(scene.studies["refinement"], series)
    job = StudyJob(
        path,
        study,
        scene.raw,
        hash_scene(path),
        measure=partial(measure_beam, present(study.reference)),
        measure_name="short",
    )
    records = run_study(job, folder, comm=MPI.COMM_WORLD)
    assert [record.error for record in records if record.status == "failed"] == []
    beam = reference_beam(present(study.reference))
    return beam, collect_points(beam, records)


@pytest.fixture(scope="module")
def cantilever(tmp_path_factory: pytest.TempPathFactory) -> Refinement:
    return climb("cantilever", CANTILEVER, tmp_path_factory.mktemp("cantilever"))


@pytest.fixture(scope="module")
def fixed_beam(tmp_path_factory: pytest.TempPathFactory) -> Refinement:
    return climb("fixed_beam", FIXED, tmp_path_factory.mktemp("fixed"))


def verdicts(refinement: Refinement, figure: int, models: str) -> dict[str, bool]:
    return {
        claim.text: claim.confirmed
        for claim in evaluate_statements(*refinement)
        if claim.figure == figure and claim.models == models
    }


def test_the_segmented_cantilever_meets_the_paper_s_static_limits_and_does_not_get_worse(
    cantilever: Refinement,
) -> None:
    assert verdicts(cantilever, 6, "segmented") == {
        "every deviation < 10 % from nDOF 30": True,
        "every deviation < 4 % from nDOF 90": True,
        "deviations shrink as nDOF grows": True,
        "deviations almost constant above nDOF 60 (within 1 point)": True,
    }


def test_what_is_left_of_the_segmented_cantilever_s_deviation_is_shear(
    cantilever: Refinement,
) -> None:
    series = pick_series(*cantilever, "static", "segmented")
    names = list(series.points[0].values)
    assert worst_of(deviations(series, names)).quantity == "dy(Fy)"
    assert abs(worst_of(deviations(series, names, against="beam")).value) < 1e-7


def test_the_segmented_cantilever_s_modes_are_within_20_per_cent_and_miss_16_only_by_the_reference(
    cantilever: Refinement,
) -> None:
    found = verdicts(cantilever, 8, "segmented")
    assert found["every deviation < 20 % from nDOF 60"]
    assert not found["every deviation < 16 % above nDOF 200"]
    beam, points = cantilever
    (claim,) = [c for c in evaluate_statements(beam, points) if c.figure == 8 and "16 %" in c.text]
    assert "Y2" in claim.decides
    assert "converged 3D elasticity itself lies at -16.04 %" in claim.note


def test_second_order_elements_come_within_3_per_mille_of_converged_3d_elasticity(
    cantilever: Refinement,
) -> None:
    own = [claim for claim in evaluate_own(*cantilever) if claim.models == "hex27"]
    assert [claim.confirmed for claim in own] == [True, True], [claim.decides for claim in own]


def test_linear_elements_fail_in_bending_and_in_torsion(
    cantilever: Refinement,
) -> None:
    for kind in ("tet4", "hex8"):
        series = pick_series(*cantilever, "static", kind)
        found = deviations(series, ["dx(Fx)", "dx(Mb)", "dx(Mc)"])
        assert len(found) == 3 * len(CANTILEVER[f"static_{kind}"])
        assert max(each.value for each in found) < -0.10, kind
    (torsion,) = deviations(pick_series(*cantilever, "modal", "hex8"), ["T1"])
    assert torsion.value > 0.10


@pytest.mark.parametrize("kind", ["segmented", "hex27"])
def test_every_mode_of_the_paper_is_found_by_its_shape(
    cantilever: Refinement, kind: ModelKind
) -> None:
    finest = pick_series(*cantilever, "modal", kind).points[-1]
    assert list(finest.values) == ["X1", "Y1", "X2", "T1", "Y2", "X3"]
    assert min(finest.macs.values()) > 0.98


def test_the_segmented_fixed_beam_meets_the_paper_s_limits(
    fixed_beam: Refinement,
) -> None:
    found = verdicts(fixed_beam, 11, "segmented")
    assert found["dx within 10 % from nDOF 90"]
    assert found["dx and dz within 3 % above nDOF 300"]
    assert verdicts(fixed_beam, 13, "segmented") == {
        "every deviation < 20 % from nDOF 60": True,
        "every deviation < 3 % above nDOF 400": True,
    }


@pytest.mark.parametrize("kind", ["tet4", "hex8"])
def test_linear_elements_fail_for_the_fixed_beam_by_more_than_70_per_cent(
    fixed_beam: Refinement, kind: ModelKind
) -> None:
    shifts = ["dx(Fx), h_F = 0", "dx(Fx), h_F = 100 mm"]
    found = deviations(pick_series(*fixed_beam, "static", kind), shifts)
    assert len(found) == 2
    assert worst_of(found).value < -0.70


def test_the_fixed_beam_s_torsion_is_20_per_cent_off_its_analytic_value_with_any_element(
    fixed_beam: Refinement,
) -> None:
    for kind in ("hex8", "hex27"):
        torsions = deviations(pick_series(*fixed_beam, "modal", kind), ["T1"])
        assert len(torsions) == len(FIXED[f"modal_{kind}"])
        assert min(each.value for each in torsions) > 0.20
    series = pick_series(*fixed_beam, "modal", "hex27")
    finest = deviations(series, ["X1", "T1", "X2"], against="solid")
    assert abs(worst_of(finest).value) < 0.03


def test_a_scene_that_is_not_the_beam_is_refused_with_what_it_should_be(tmp_path: Path) -> None:
    text = (MACHINES / "cantilever.toml").read_text()
    path = write_scene(tmp_path, text, ('"38 mm", "100 mm"', '"40 mm", "100 mm"'))
    with pytest.raises(_RefinementError, match="38 x 100 x 500 mm"):
        climb("cantilever", {"static_segmented": [2]}, tmp_path, path)
