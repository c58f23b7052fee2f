"""What runs is what was planned, and nothing is computed twice."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from built_scenes import STEEL, make_block, scene_of
from common import approx
from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import Frame, rigid_map
from headstock.geometry.parts.components import (
    Component,
    Load,
    MeshSettings,
    ReductionSettings,
    SegmentSettings,
)
from headstock.geometry.parts.solids import Box, SuperelementFile
from headstock.meshing.components.meshing import mesh_component
from headstock.pipeline.planning.plan import Stage, StageRecord
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages import components as component_stages
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.storage import content_keys
from headstock.pipeline.storage.store import Store
from headstock.pipeline.storage.superelements import write_superelement
from headstock.reduction.components import elastic as elastic_reduction
from headstock.reduction.superelement import Superelement
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.scene import Analyses, Scene
from lumped_machines import joint_between
from scene_runs import run

SPRING = np.diag([1e8, 1e8, 2e8, 1e6, 1e6, 1e6])


def make_scene(*, static: bool = True, modal: bool = True) -> Scene:
    """A rigid base on springs and an elastic column on it."""
    settings = {"mesh": MeshSettings(size=0.05), "reduction": ReductionSettings(modes=4)}
    base = make_block("base", (0.05, 0.05, 0.1), fidelity="rigid", **settings)
    above = Frame(np.array([0.0, 0.0, 0.1]))
    column = make_block("column", (0.05, 0.05, 0.2), placement=above, **settings)
    joints = (
        joint_between("mount", "ground", "base.foot", stiffness=SPRING),
        joint_between("guide", "base.tip", "column.foot", stiffness=SPRING),
    )
    analyses = Analyses(
        StaticRequest(("tcp",)) if static else None, ModalRequest(count=8) if modal else None
    )
    return scene_of((base, column), joints, analyses)


def change_machine(scene: Scene, **changes: Any) -> Scene:
    return dataclasses.replace(scene, machine=dataclasses.replace(scene.machine, **changes))


def change_column(scene: Scene, **changes: Any) -> Scene:
    column = dataclasses.replace(scene.machine.components["column"], **changes)
    return change_machine(scene, components={**scene.machine.components, "column": column})


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names the components that were really meshed and really reduced."""
    made: list[str] = []

    def record(what: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def recorded(component: Component, *arguments: Any, **options: Any) -> Any:
            made.append(f"{what} {component.name}")
            return function(component, *arguments, **options)

        return recorded

    monkeypatch.setattr(component_stages, "mesh_component", record("mesh", mesh_component))
    monkeypatch.setattr(
        elastic_reduction, "reduce_elastic", record("reduce", elastic_reduction.reduce_elastic)
    )
    return made


def frequencies(results: Results) -> Any:
    return results.modal[0].frequencies_hz


@pytest.mark.parametrize(("static", "modal"), [(True, True), (True, False), (False, True)])
def test_what_ran_equals_what_was_planned(
    tmp_path: Path, calls: list[str], static: bool, modal: bool
) -> None:
    scene = make_scene(static=static, modal=modal)
    results = run(scene, tmp_path)
    assert tuple(record.stage for record in results.stages) == plan_scene(scene).stages
    assert calls == ["mesh column", "reduce column"]


def test_a_rigid_machine_calls_no_mesher_and_loads_no_elastic_module(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} was loaded")

    monkeypatch.setattr(component_stages, "importlib", SimpleNamespace(import_module=refuse))
    run(change_column(make_scene(), fidelity="rigid"), tmp_path)
    assert calls == []


def test_a_segmented_component_is_not_meshed_moves_as_the_elastic_one_and_its_picture_bends(
    tmp_path: Path, calls: list[str]
) -> None:
    scene = make_scene()
    segmented = run(
        change_column(scene, fidelity="segmented", segments=SegmentSettings(6)), tmp_path
    )
    assert calls == []
    assert [
        record.stage.kind for record in segmented.stages if record.stage.component == "column"
    ] == ["segment"]
    elastic = run(scene, tmp_path)
    np.testing.assert_allclose(frequencies(segmented)[:6], frequencies(elastic)[:6], rtol=0.02)
    skin, shifts = (
        segmented.view.skins["column"],
        segmented.view.poses["reference"].shifts["column"],
    )
    bending = next(
        i
        for i, share in enumerate(segmented.modal[0].energy_share)
        if share.get("column", 0.0) > 0.2
    )
    rigid = rigid_map(skin.points, np.zeros(3))
    shape = shifts[bending].ravel()
    left = shape - rigid @ np.linalg.lstsq(rigid, shape)[0]
    # no rigid motion explains it, and no section turns or moves by a step
    assert np.linalg.norm(left) > 0.05 * np.linalg.norm(shape)
    edge = np.argsort(skin.points[:, 2])[:: len(skin.points) // len(np.unique(skin.points[:, 2]))]
    steps = np.linalg.norm(np.diff(shifts[bending][edge], axis=0), axis=1)
    assert steps.max() < 4.0 * steps.mean()


def test_a_static_run_computes_no_modes_and_no_mass_and_still_reports_the_mass(
    tmp_path: Path,
) -> None:
    results = run(make_scene(modal=False), tmp_path)
    assert results.components["column"].reduced_dofs == 12
    assert results.components["column"].mass_kg == approx(7850 * 0.05 * 0.05 * 0.2, rel=1e-9)


def test_budgets_and_energies_of_modes_sum_to_one_and_name_all_parts(tmp_path: Path) -> None:
    results = run(make_scene(), tmp_path)
    point = results.static["reference"]["tcp"]
    assert set(point.budget) == {"x", "y", "z"}
    for shares in point.budget.values():
        assert {"column", "guide", "mount"} <= set(shares)
        assert sum(shares.values()) == approx(1.0, abs=1e-9)
    assert "%" in point.text
    modes = results.modal[0]
    assert len(modes.frequencies_hz) == 8
    assert all(modes.mode_names)
    for shares in (*modes.energy_share, *modes.kinetic_share):
        assert sum(shares.values()) == approx(1.0, abs=1e-9)


def test_an_unchanged_scene_is_not_meshed_or_reduced_again_and_comes_out_the_same(
    tmp_path: Path, calls: list[str]
) -> None:
    first = run(make_scene(), tmp_path)
    calls.clear()
    second = run(make_scene(), tmp_path)
    assert calls == []
    assert [
        record.cached for record in second.stages if record.stage.kind in {"mesh", "reduce"}
    ] == [True, True]
    np.testing.assert_array_equal(frequencies(second), frequencies(first))
    np.testing.assert_array_equal(second.modal[0].shapes, first.modal[0].shapes)


def test_another_joint_stiffness_or_place_needs_no_reduction(
    tmp_path: Path, calls: list[str]
) -> None:
    scene = make_scene()
    first = run(scene, tmp_path)
    calls.clear()
    softer = dataclasses.replace(scene.machine.joints["guide"], stiffness=SPRING / 2)
    second = run(change_machine(scene, joints={**scene.machine.joints, "guide": softer}), tmp_path)
    assert calls == []
    assert frequencies(second)[0] < frequencies(first)[0]


def test_changing_one_component_reduces_only_that_one(tmp_path: Path, calls: list[str]) -> None:
    scene = make_scene()
    base = dataclasses.replace(scene.machine.components["base"], fidelity="elastic")
    scene = change_machine(scene, components={**scene.machine.components, "base": base})
    run(scene, tmp_path)
    assert calls == ["mesh base", "reduce base", "mesh column", "reduce column"]
    calls.clear()
    # another modulus would scale what is stored
    softer = dataclasses.replace(STEEL, poisson_ratio=0.25)
    run(change_column(scene, material=softer), tmp_path)
    # its mesh is the old one: the material plays no part in it
    assert calls == ["reduce column"]


def test_equal_components_are_reduced_once(tmp_path: Path, calls: list[str]) -> None:
    scene = make_scene()
    twin = dataclasses.replace(
        scene.machine.components["column"], name="twin", placement=Frame(np.array([1.0, 0.0, 0.1]))
    )
    joint = joint_between("twin_foot", "base.tip", "twin.foot", stiffness=SPRING)
    machine = {
        "components": {**scene.machine.components, "twin": twin},
        "joints": {**scene.machine.joints, "twin_foot": joint},
    }
    results = run(change_machine(scene, **machine), tmp_path)
    assert calls == ["mesh column", "reduce column"]
    assert set(results.components) == {"base", "column", "twin"}


def test_a_damaged_store_entry_is_computed_anew_with_a_warning(
    tmp_path: Path, calls: list[str]
) -> None:
    first = run(make_scene(), tmp_path)
    calls.clear()
    (entry,) = (tmp_path / "store" / "reducedcomponent").rglob("*.h5")
    content = bytearray(entry.read_bytes())
    content[len(content) // 2] ^= 1
    entry.write_bytes(bytes(content))
    second = run(make_scene(), tmp_path)
    assert calls == ["reduce column"]
    assert any("damaged" in warning for warning in second.warnings)
    np.testing.assert_allclose(frequencies(second), frequencies(first), rtol=1e-12)
    assert not run(make_scene(), tmp_path).warnings


def test_an_imported_superelement_gives_what_the_component_itself_gives(
    tmp_path: Path, calls: list[str]
) -> None:
    scene = make_scene()
    direct = run(scene, tmp_path)
    calls.clear()
    column = scene.machine.components["column"]
    reduced = elastic_reduction.reduce_elastic(column, mesh_component(column), comm=MPI.COMM_SELF)
    write_superelement(tmp_path / "column.h5", reduced)
    calls.clear()
    imported = SuperelementFile(tmp_path / "column.h5")
    results = run(change_column(scene, solid=imported), tmp_path)
    assert calls == []
    np.testing.assert_allclose(frequencies(results), frequencies(direct), rtol=1e-9)
    assert results.components["column"].fidelity == "superelement"


def test_the_displacement_under_a_load_that_does_work_on_a_free_motion_fails_and_the_compliance_across_it_stays(
    tmp_path: Path,
) -> None:
    scene = make_scene(modal=False)
    free = np.diag([0.0, 1e8, 2e8, 1e6, 1e6, 1e6])
    slide = dataclasses.replace(scene.machine.joints["mount"], stiffness=free)
    scene = change_machine(scene, joints={**scene.machine.joints, "mount": slide})
    results = {}
    for axis, vector in (("x", (100.0, *[0.0] * 5)), ("y", (0.0, 100.0, *[0.0] * 4))):
        force = Load("push", "column", "force", interface="tip", vector=vector)
        results[axis] = run(change_machine(scene, loads={"push": force}), tmp_path / axis)
    along, across = (results[axis].static["reference"]["tcp"] for axis in "xy")
    assert "X translation of" in results["x"].failures[0] and along.displacement is None
    assert (
        not results["y"].failures
        and across.displacement is not None
        and np.isnan(across.displacement[0])
    )
    np.testing.assert_allclose(
        across.displacement[1:], 100.0 * across.compliance[1:, 1], rtol=1e-9, atol=1e-15
    )
    assert (
        along.compliance[1, 1] == across.compliance[1, 1] > 0.0
        and np.isnan(along.compliance[0]).all()
    )


def test_a_failing_stage_leaves_earlier_results_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(make_scene(), tmp_path)
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}

    def fail(*arguments: Any, **options: Any) -> None:
        raise HeadstockError("no mesh today")

    monkeypatch.setattr(component_stages, "mesh_component", fail)
    with pytest.raises(HeadstockError, match="no mesh today"):
        run(change_column(make_scene(), mesh=MeshSettings(size=0.04)), tmp_path)
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


def test_frequencies_beyond_the_reach_of_the_kept_modes_are_warned_of(tmp_path: Path) -> None:
    few = change_column(make_scene(), reduction=ReductionSettings(modes=1))
    scene = dataclasses.replace(few, analyses=Analyses(ModalRequest(count=13)))
    assert any("complete up to" in warning for warning in run(scene, tmp_path).warnings)
    assert not any("complete up to" in warning for warning in run(make_scene(), tmp_path).warnings)


def test_a_reduction_is_expected_to_take_what_its_mesh_asks_for(tmp_path: Path) -> None:
    scene, expected = make_scene(), dict[str, Stage]()
    state = start_run(scene, MPI.COMM_SELF, Store(tmp_path / "store"))
    planned = {stage.kind: stage for stage in state.plan.stages if stage.component == "column"}

    def note(stage: Stage) -> None:
        expected[stage.kind] = stage

    made = make_superelements(state, announce=note)
    assert expected["reduce"].estimated_dofs == made["column"].full_dofs
    assert expected["reduce"].estimated_dofs != planned["reduce"].estimated_dofs
    assert expected["reduce"].estimated_seconds != planned["reduce"].estimated_seconds


def test_stages_are_reported_as_they_end_with_their_cost(tmp_path: Path) -> None:
    seen: list[str] = []
    results = run_scene(
        make_scene(),
        tmp_path / "out",
        comm=MPI.COMM_SELF,
        store=Store(tmp_path / "store"),
        observer=lambda record: seen.append(record.stage.kind),
    )
    assert seen == [record.stage.kind for record in results.stages]
    assert all(record.seconds >= 0.0 and record.peak_rss_mb > 10.0 for record in results.stages)


# mode shapes are searched to 1e-7 (frequencies to its square), the first mode left out, which is
# the cut-off, to 1e-3 (1e-6), and error estimates are summed in single precision
SHAPES, NEXT_MODE = 1e-6, 1e-5


def ask(scene: Scene, **changes: Any) -> Scene:
    """The scene with other reduction settings of its column, ``gravity`` or ``static_only``."""
    effects = frozenset({"gravity"}) if changes.pop("gravity", False) else frozenset[str]()
    analyses = (
        scene.analyses.keep(["static"]) if changes.pop("static_only", False) else scene.analyses
    )
    # not square: the shapes of repeated modes are any combination of each other
    column = {"solid": Box((0.05, 0.04, 0.2)), "reduction": ReductionSettings(**changes)}
    scene = change_machine(change_column(scene, **column), gravity=(0.0, 0.0, -9.81))
    return dataclasses.replace(scene, effects=effects, analyses=analyses)


def column_of(scene: Scene, store: Path) -> tuple[Superelement, bool]:
    """The column's superelement, and whether it was taken from the store."""
    plan = plan_scene(scene)
    state = start_run(scene, MPI.COMM_SELF, Store(store), plan=plan)
    records: list[StageRecord] = []
    made = make_superelements(state, only=["column"], observer=records.append)
    return made["column"], all(record.cached for record in records)


def assert_same_numbers(one: Any, other: Any, path: str = "superelement") -> None:
    """Equal to ``SHAPES`` of the largest entry, whatever fields a record has."""
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            if field.name != "residual":  # of the solves behind it
                assert_same_numbers(
                    getattr(one, field.name), getattr(other, field.name), f"{path}.{field.name}"
                )
    elif isinstance(one, dict):
        assert sorted(one) == sorted(other), path
        for key in one:
            assert_same_numbers(one[key], other[key], f"{path}.{key}")
    elif isinstance(one, tuple):
        assert len(one) == len(other), path
        for index, (first, second) in enumerate(zip(one, other, strict=True)):
            assert_same_numbers(first, second, f"{path}[{index}]")
    elif isinstance(one, np.ndarray):
        assert one.shape == other.shape, path
        scale = float(np.abs(one).max(initial=0.0))
        # a particular response is what is left of a static one without the share of its modes
        tolerance = 10 * SHAPES if path.endswith("particular") else SHAPES
        np.testing.assert_allclose(other, one, rtol=0.0, atol=tolerance * scale, err_msg=path)
    elif isinstance(one, float):
        assert other == approx(one, rel=NEXT_MODE), path
    else:
        assert one == other, path


RICH = {"modes": 14, "gravity": True, "verify": True}


@pytest.mark.parametrize(
    "poorer",
    [
        {"modes": 6, "gravity": True},
        {"modes_to_hz": 9000.0},
        *(
            pytest.param(poorer, marks=pytest.mark.trials)
            for poorer in (
                {"modes": 6},
                {"modes": 1, "verify": True},
                {"modes": 0},
                {"static_only": True},
                {"static_only": True, "gravity": True},
            )
        ),
    ],
    ids=lambda wanted: " ".join(f"{key}={value}" for key, value in wanted.items()),
)
def test_a_richer_stored_superelement_serves_as_if_reduced_for_the_poorer_request(
    tmp_path: Path, poorer: dict[str, Any]
) -> None:
    scene = make_scene()
    column_of(ask(scene, **RICH), tmp_path / "one")
    served, cached = column_of(ask(scene, **poorer), tmp_path / "one")
    cold, fresh = column_of(ask(scene, **poorer), tmp_path / "other")
    assert cached and not fresh
    assert_same_numbers(cold, served)
    np.testing.assert_allclose(served.modal_frequencies_hz, cold.modal_frequencies_hz, rtol=1e-10)
    boundary = slice(0, cold.boundary_size)
    for one, other in ((cold.stiffness, served.stiffness), (cold.mass, served.mass)):
        np.testing.assert_allclose(
            other[boundary, boundary], one[boundary, boundary], rtol=0.0, atol=1e-12 * one.max()
        )


@pytest.mark.parametrize(
    "richer",
    [
        {"modes": 8},
        {"modes_to_hz": 1.5e4},
        {"modes": 5, "gravity": True},
        {"modes": 5, "verify": True},
    ],
    ids=lambda wanted: " ".join(f"{key}={value}" for key, value in wanted.items()),
)
def test_a_poorer_stored_superelement_does_not_serve(
    tmp_path: Path, richer: dict[str, Any]
) -> None:
    scene = make_scene()
    column_of(ask(scene, modes=5), tmp_path)
    assert not column_of(ask(scene, **richer), tmp_path)[1]


def test_a_stored_superelement_serves_no_other_body_and_no_other_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = make_scene()
    column_of(ask(scene, **RICH), tmp_path)
    assert not column_of(ask(change_column(scene, mass=9.0), modes=3), tmp_path)[1]
    monkeypatch.setattr(content_keys, "code_fingerprint", lambda package: "changed")
    assert not column_of(ask(scene, modes=3), tmp_path)[1]


def test_a_run_without_its_frequency_response_reduces_nothing_anew(
    tmp_path: Path, calls: list[str]
) -> None:
    """As in ``compare --set analyses.frf=false``; the modes are those that a cold run finds."""
    scene = make_scene()
    rich = ask(scene, modes_to_hz=2.3e4)
    run(rich, tmp_path)
    calls.clear()
    after = run(ask(scene, modes=5), tmp_path)
    assert calls == []
    assert [record.cached for record in after.stages if record.stage.component == "column"] == [
        True,
        True,
    ]
    cold = run(ask(scene, modes=5), tmp_path / "cold")
    np.testing.assert_allclose(frequencies(after)[6:], frequencies(cold)[6:], rtol=1e-10)
    compliance = after.static["reference"]["tcp"].compliance
    np.testing.assert_allclose(
        compliance,
        cold.static["reference"]["tcp"].compliance,
        rtol=0.0,
        atol=1e-10 * compliance.max(),
    )
