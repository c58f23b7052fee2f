"""The plan holds what the scene calls for, with reasons, and nothing else."""

import dataclasses
import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from built_scenes import FACES, make_block, scene_of
from cases import cases
from common import approx
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import (
    Component,
    Interface,
    MeshSettings,
    Patch,
    ReductionSettings,
)
from headstock.geometry.parts.solids import Box, SuperelementFile, Tube
from headstock.meshing.components.meshing import mesh_component
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.planning.analyses import (
    FRF_MARGIN,
    MODE_MARGIN,
    RECORDS,
    AnalysisRecord,
    load_answer_types,
    load_named,
)
from headstock.pipeline.planning.budgets import BudgetError, check_elapsed, reduced_dofs
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.reductions import MOST_DEFAULT_MODES
from headstock.pipeline.planning.resources import RanksOnNodes
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Analyses, Limits, Scene
from lumped_machines import joint_between

MACHINES = Path(__file__).parents[3] / "machines"
INTERFACES = {**FACES, "tip": Interface("tip", (Patch("z+"),))}
STATIC = StaticRequest(at=("tcp",))
SIX = ModalRequest(count=6)


def make_component(name: str, **changes: object) -> Component:
    mesh = MeshSettings(size=0.025)
    component = make_block(name, (0.1, 0.1, 0.5), interfaces=INTERFACES, mesh=mesh)
    return dataclasses.replace(component, **changes)  # type: ignore[arg-type]


def make_scene(
    *components: Component,
    static: StaticRequest | None = None,
    modal: ModalRequest | None = None,
    frf: FrfRequest | None = None,
) -> Scene:
    clamp = joint_between("clamp", "ground", f"{components[0].name}.foot", fixed=range(6))
    return scene_of(components, (clamp,), Analyses(static, modal, frf))


def planned_kinds(scene: Scene) -> list[tuple[str, str | None]]:
    return [(stage.kind, stage.component or stage.pose) for stage in plan_scene(scene).stages]


def test_a_rigid_component_is_never_meshed() -> None:
    scene = make_scene(
        make_component("base", fidelity="rigid"), make_component("column"), static=STATIC, modal=SIX
    )
    assert planned_kinds(scene) == [
        ("rigid", "base"),
        ("mesh", "column"),
        ("reduce", "column"),
        ("couple", "reference"),
        ("static", "reference"),
        ("modal", "reference"),
        ("write", None),
    ]
    assert all(stage.reason for stage in plan_scene(scene).stages)


@pytest.mark.process
def test_equal_parts_are_surveyed_once_and_whoever_waits_is_told() -> None:
    tube = Tube(0.1, 0.06, 0.2)
    left, right, longer = (make_component(name, solid=tube) for name in ("left", "right", "longer"))
    longer = dataclasses.replace(longer, solid=dataclasses.replace(tube, length=0.3))
    reported: list[str] = []
    plan = plan_scene(
        make_scene(left, right, longer, modal=SIX), survey=True, before_survey=reported.append
    )
    assert reported == ["left", "longer"]
    dofs = {stage.component: stage.estimated_dofs for stage in plan.stages if stage.kind == "mesh"}
    assert dofs["left"] == dofs["right"]
    assert (dofs["longer"] or 0) > 1.2 * (dofs["left"] or 0)


def test_a_static_analysis_keeps_no_eigenpairs_whatever_the_scene_keeps_for_others() -> None:
    plan = plan_scene(
        make_scene(make_component("column", reduction=ReductionSettings(modes=12)), static=STATIC)
    )
    assert plan.components["column"].reduction == ReductionSettings(modes=0)
    assert not plan.with_modes
    assert plan.gravity is None
    assert "modal" not in [stage.kind for stage in plan.stages]
    assert "no eigenpairs" in next(stage.reason for stage in plan.stages if stage.kind == "reduce")


UP_TO = ModalRequest(up_to_hz=500.0)


def respond(to_hz: float) -> FrfRequest:
    return FrfRequest((("tcp", "x"),), (("tcp", "x"),), to_hz=to_hz)


def up_to(hz: float) -> ReductionSettings:
    return ReductionSettings(modes_to_hz=hz, modes=MOST_DEFAULT_MODES)


@pytest.mark.parametrize(
    ("asked", "changes", "kept"),
    [
        # the scene decides
        ({"modal": UP_TO}, {"reduction": ReductionSettings(modes=12)}, ReductionSettings(modes=12)),
        ({"modal": UP_TO}, {"reduction": up_to(900.0)}, up_to(900.0)),
        ({"modal": UP_TO}, {}, up_to(MODE_MARGIN * 500.0)),
        # responses need modes much further up
        ({"modal": UP_TO, "frf": respond(200.0)}, {}, up_to(FRF_MARGIN * 200.0)),
        # exact without interfaces: no margin but for their errors
        ({"modal": UP_TO}, {"interfaces": {}}, up_to(1.5 * 500.0)),
        ({"frf": respond(500.0)}, {"interfaces": {}}, up_to(1.5 * 500.0)),
        # a count grows with what is wanted
        ({"modal": ModalRequest(count=1)}, {}, ReductionSettings(modes=20)),
        ({"modal": ModalRequest(count=6)}, {}, ReductionSettings(modes=20)),
        ({"modal": ModalRequest(count=30)}, {}, ReductionSettings(modes=68)),
    ],
)
def test_modes_are_kept_by_what_is_asked_of_them(
    asked: dict[str, Any], changes: dict[str, object], kept: ReductionSettings
) -> None:
    plan = plan_scene(make_scene(make_component("column", **changes), **asked))
    assert plan.components["column"].reduction == kept and plan.with_modes


def test_a_frequency_response_needs_no_modal_analysis() -> None:
    alone = plan_scene(make_scene(make_component("column"), frf=respond(200.0)))
    assert alone.with_modes
    assert [stage.kind for stage in alone.stages][-3:] == ["couple", "frf", "write"]


def test_gravity_is_planned_only_when_named() -> None:
    scene = make_scene(make_component("column"), static=STATIC)
    named = plan_scene(dataclasses.replace(scene, effects=frozenset({"gravity"})))
    assert named.gravity is not None
    np.testing.assert_array_equal(named.gravity, [0.0, 0.0, -9.80665])


def test_an_imported_superelement_is_loaded_and_neither_meshed_nor_reduced(tmp_path: Path) -> None:
    scene = make_scene(
        make_component("bed", solid=SuperelementFile(tmp_path / "bed.h5")), modal=SIX
    )
    assert planned_kinds(scene)[:2] == [("load", "bed"), ("couple", "reference")]


def test_each_analysis_runs_in_the_poses_it_names() -> None:
    scene = make_scene(
        make_component("column", fidelity="rigid"),
        static=StaticRequest(("tcp",), poses=("left",)),
        modal=SIX,
    )
    scene = dataclasses.replace(scene, poses={name: Pose(name) for name in ("left", "right")})
    pairs = [(stage.kind, stage.pose) for stage in plan_scene(scene).stages if stage.pose]
    assert pairs == [
        ("couple", "left"),
        ("static", "left"),
        ("modal", "left"),
        ("couple", "right"),
        ("modal", "right"),
    ]


def test_a_pose_that_no_analysis_asks_for_is_not_coupled() -> None:
    scene = make_scene(
        make_component("column", fidelity="rigid"), modal=ModalRequest(count=6, poses=("left",))
    )
    scene = dataclasses.replace(scene, poses={name: Pose(name) for name in ("right", "left")})
    assert [stage.pose for stage in plan_scene(scene).stages if stage.kind == "couple"] == ["left"]


@pytest.mark.parametrize(
    ("cells", "size", "dofs"), [("tet", 0.019, 9921), ("tet", 0.0075, 103953), ("hex", 0.01, 57267)]
)
def test_estimated_dofs_are_those_of_the_mesh_within_a_quarter(
    cells: Literal["tet", "hex"], size: float, dofs: int
) -> None:
    """Counted on meshes of the seed's column, 38 x 100 x 500 mm."""
    column = make_component(
        "column", solid=Box((0.038, 0.1, 0.5)), mesh=MeshSettings(size=size, cells=cells)
    )
    stages = plan_scene(make_scene(column, modal=SIX)).stages
    assert stages[0].estimated_dofs == approx(dofs, rel=0.25)


@pytest.mark.parametrize(
    ("size", "limits", "said"),
    [
        (0.025, Limits(elements=10), r"'column'.*limits\.elements allows 10"),
        (0.025, Limits(memory_bytes=1e6), r"'column'.*limits\.memory allows 1 MB"),
        (0.0023, Limits(), "this machine has"),
        # even where the scene allows it
        (1e-4, Limits(elements=10_000_000), "3000000"),
        (0.006, Limits(time_s=1.0), r"reduce of component 'column' .* limits\.time allows 1 s"),
    ],
    ids=["elements", "memory", "machine", "mesher", "time"],
)
def test_what_is_beyond_a_limit_is_refused_with_numbers(
    size: float, limits: Limits, said: str
) -> None:
    many = ReductionSettings(modes=5000) if "machine" in said else ReductionSettings()
    part = make_component("column", mesh=MeshSettings(size=size), reduction=many)
    with pytest.raises(BudgetError, match=said):
        plan_scene(dataclasses.replace(make_scene(part, modal=SIX), limits=limits))


def test_a_part_whose_factors_do_not_fit_is_iterated_and_the_plan_says_so() -> None:
    part = make_component(
        "column", mesh=MeshSettings(size=0.008), reduction=ReductionSettings(modes=10)
    )
    scene = make_scene(part, modal=SIX)
    plan = plan_scene(scene)
    (reduce,) = (stage for stage in plan.stages if stage.kind == "reduce")
    assert "direct: " in reduce.reason and "factor entries" in reduce.reason
    assert plan.components["column"].reduction.solver == "auto"
    assert reduce.estimated_memory_mb is not None
    limit = 0.9 * reduce.estimated_memory_mb
    less = plan_scene(dataclasses.replace(scene, limits=Limits(memory_bytes=1e6 * limit)))
    (iterated,) = (stage for stage in less.stages if stage.kind == "reduce")
    assert less.components["column"].reduction.solver == "iterative"
    assert f"{limit:.3g} MB there are" in iterated.reason
    assert iterated.estimated_memory_mb is not None and iterated.estimated_memory_mb < limit


def test_factors_beyond_32_bit_integers_are_planned_for_iteration_however_much_memory_there_is() -> (
    None
):
    limits = Limits(elements=10**8, memory_bytes=1e12)
    reasons = []
    for size in (0.007, 0.003):
        cube = make_component("cube", solid=Box((0.2, 0.2, 0.2)), mesh=MeshSettings(size=size))
        plan = plan_scene(dataclasses.replace(make_scene(cube, modal=SIX), limits=limits))
        (reduce,) = (stage for stage in plan.stages if stage.kind == "reduce")
        reasons.append((plan.components["cube"].reduction.solver, reduce.reason))
    (small, _), (large, why) = reasons
    assert small == "auto" and large == "iterative"
    assert "more than CHOLMOD is sure to number (2.1e+09)" in why


def test_a_run_that_has_used_up_its_time_stops_before_the_next_stage() -> None:
    stage = Stage("reduce", "column", "because")
    check_elapsed(9.9, 10.0, stage)
    check_elapsed(1e9, None, stage)
    with pytest.raises(BudgetError, match=r"10\.1 s.*limits\.time.* 10 s.*reduce.*'column'"):
        check_elapsed(10.1, 10.0, stage)


def test_linear_elements_are_warned_of() -> None:
    plan = plan_scene(
        make_scene(make_component("column", mesh=MeshSettings(size=0.025, order=1)), static=STATIC)
    )
    assert len(plan.warnings) == 1
    assert "lock" in plan.warnings[0]


@cases
def test_what_is_followed_in_time_is_planned_for_the_seconds_and_megabytes_that_it_took(
    scene: str,
    variant: str,
    settings: tuple[str, ...],
    kind: str,
    seconds: float,
    within: tuple[float, float],
    megabytes: tuple[float, ...],
) -> None:
    loaded = load_scene(MACHINES.parent / scene, variant=variant or None, overrides=settings)
    planned = [stage for stage in plan_scene(loaded).stages if stage.kind == kind]
    assert len(planned) == (2 if kind == "respond" else 1)
    least, most = within
    assert least * seconds < (planned[0].estimated_seconds or 0.0) < most * seconds
    for size, rel in zip(megabytes[::2], megabytes[1::2], strict=True):
        assert planned[0].estimated_memory_mb == approx(size, rel=rel)


@pytest.mark.parametrize(
    ("kind", "section", "variant", "more"),
    [
        ("path", "path", None, True),
        ("path", "path", "segmented", False),
        ("contour", "contouring", "milling", True),
        ("contour", "contouring", "segmented+milling", False),
    ],
)
def test_ways_of_bodies_that_deform_are_planned_for_longer_with_their_error(
    kind: str, section: str, variant: str | None, more: bool
) -> None:
    scene = MACHINES / "three_axis.toml"
    seconds = []
    for estimate in ("true", "false"):
        settings = (
            f"analyses.{section}.on_request=false",
            f"analyses.{section}.estimate={estimate}",
        )
        stages = plan_scene(load_scene(scene, variant=variant, overrides=settings)).stages
        seconds += [stage.estimated_seconds or 0.0 for stage in stages if stage.kind == kind]
    with_error, once = seconds
    least = {"path": 1.9, "contour": 1.4}[kind]
    assert with_error > least * once if more else with_error == once


def test_a_path_that_is_too_long_for_the_memory_is_refused_with_its_remedy() -> None:
    scene = MACHINES / "three_axis.toml"
    settings = (
        "analyses.path.on_request=false",
        'analyses.path.feeds=["20 mm/min"]',
        'limits.memory="600 MB"',
    )
    loaded = load_scene(scene, variant="R", overrides=settings)
    with pytest.raises(BudgetError, match=r"path would need about 9.* MB.*lower sampling"):
        plan_scene(loaded)
    # the others wait while one rank has the path; components are judged when the store is looked at
    held = RanksOnNodes(ranks=4, together=2, memory_mb=8_000.0)
    with pytest.raises(BudgetError, match=r"2 of 4 ranks, of which one has the path; limits"):
        plan_scene(loaded, held=held)
    free = dataclasses.replace(loaded, limits=dataclasses.replace(loaded.limits, memory_bytes=None))
    plan_scene(free, held=held)
    with pytest.raises(BudgetError, match=r"this machine has 1e\+03 MB"):
        plan_scene(free, held=RanksOnNodes(ranks=4, together=2, memory_mb=1000.0))
    plan_scene(free, held=RanksOnNodes(ranks=4, together=1, memory_mb=1000.0))


def test_stages_in_a_pose_are_planned_for_longer_the_more_dofs_bodies_bring() -> None:
    scene = MACHINES / "three_axis.toml"
    planned = [
        sum(
            stage.estimated_seconds or 0.0
            for stage in plan_scene(load_scene(scene, variant=variant)).stages
            if stage.pose == "reference"
        )
        for variant in ("R", "segmented")
    ]
    # 0.018 and 0.110 s of coupling, statics and modes
    assert 0.009 < planned[0] < 0.036 and 0.055 < planned[1] < 0.22


def test_equal_components_take_the_time_of_one_as_long_as_they_are_equal() -> None:
    left, right = make_component("left"), make_component("right")
    shorter = make_component("shorter", solid=Box((0.1, 0.1, 0.4)))
    fewer = make_component("fewer", reduction=ReductionSettings(modes=3))
    plan = plan_scene(make_scene(left, right, shorter, fewer, modal=SIX))
    took = {
        stage.component: stage.estimated_seconds for stage in plan.stages if stage.kind == "reduce"
    }
    assert took["right"] == 0.0
    assert min(took[name] or 0.0 for name in ("left", "shorter", "fewer")) > 0.01
    reasons = {stage.component: stage.reason for stage in plan.stages if stage.kind == "mesh"}
    assert "once for left and this one" in reasons["right"] and "left" not in reasons["fewer"]


@pytest.mark.parametrize(
    ("scene", "name", "modes"), [("fixed_beam", "beam", 74), ("cantilever", "column", 35)]
)
def test_modes_of_plates_up_to_a_frequency_are_guessed_within_half_and_twice_their_number(
    scene: str, name: str, modes: int
) -> None:
    loaded = load_scene(MACHINES / f"{scene}.toml")
    component = loaded.machine.components[name]
    assert isinstance(component.solid, Box)
    guessed = reduced_dofs(component, math.prod(component.solid.size)) - 6 * len(
        component.interfaces
    )
    assert 0.5 * modes < guessed < 2.0 * modes


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: str(record.kind))
def test_a_record_names_a_function_and_an_answer(record: AnalysisRecord) -> None:
    assert callable(load_named(record.solve))
    answer = load_named(record.answer)
    assert issubclass(answer, Answer) and answer.entry


def test_every_answer_has_an_entry_of_its_own() -> None:
    entries = [kind.entry for kind in load_answer_types()]
    assert len(set(entries)) == len(entries) > len(RECORDS)


def test_a_survey_counts_meshes_of_parts_with_narrow_rails_and_names_what_makes_them_large() -> (
    None
):
    rails = tuple(
        Patch("z+", "rect", center=(0.0, side, 0.15), size=(0.65, 0.03)) for side in (-0.15, 0.15)
    )
    interfaces = {"foot": Interface("foot", (Patch("z-"),)), "pads": Interface("pads", rails)}
    bed = make_block("bed", (0.7, 0.4, 0.15), interfaces=interfaces, mesh=MeshSettings(size=0.06))
    planned = plan_scene(make_scene(bed, modal=SIX), survey=True).stages[0]
    real = 3 * len(mesh_component(bed).points)
    assert planned.estimated_dofs == approx(real, rel=0.15)
    assert "4 elements across pads, 30 mm wide: about 14 000 dofs with" in planned.reason
