"""A forecast counts the kernels that are not compiled yet, once, and no others."""

import dataclasses
from itertools import product
from pathlib import Path

import pytest

from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.geometry.parts.solids import StepFile
from headstock.pipeline.planning.budgets import KERNEL_SECONDS
from headstock.pipeline.planning.plan import Plan, Stage
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.reductions import KINDS, add_compiling
from headstock.scene.building.loader import load_scene
from headstock.solvers.elastic.kernels import KernelPart, kernel_link, kernel_name

PARTS: tuple[KernelPart, ...] = ("stiffness", "mass", "corners")
BLOCK = stored_scene("kernels_block")
BOX = 'box = ["100 mm", "100 mm", "200 mm"]'
TUBE = 'tube = { outer = "100 mm", inner = "60 mm", length = "200 mm" }'
STATIC, MODAL = 'static = { at = "tcp" }', "modal = { count = 3 }"


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = kernel_link("any").parent
    folder.mkdir(parents=True)
    return folder


def keep_compiled(name: str) -> None:
    link = kernel_link(name)
    library = link.with_name(f"{name}.so")
    library.touch()
    link.symlink_to(library.name)


def plan_twice(folder: Path, solid: str, analyses: str) -> tuple[Plan, Plan]:
    path = write_scene(
        folder,
        BLOCK.replace('"SOLID"', f"{{ {solid} }}").replace('"ANALYSES"', f"{{ {analyses} }}"),
    )
    scene = load_scene(path)
    plan = plan_scene(scene)
    return plan, add_compiling(plan, scene)


def reductions(plan: Plan) -> list[Stage]:
    return [stage for stage in plan.stages if stage.kind == "reduce"]


def added_seconds(plans: tuple[Plan, Plan]) -> list[float]:
    before, after = (
        [stage.estimated_seconds or 0.0 for stage in reductions(plan)] for plan in plans
    )
    return [late - early for early, late in zip(before, after, strict=True)]


def test_each_kernel_is_counted_once_in_the_first_stage_that_needs_it(tmp_path: Path) -> None:
    plans = plan_twice(tmp_path, BOX, MODAL)
    both = KERNEL_SECONDS["stiffness-tet10"] + KERNEL_SECONDS["mass-tet10"]
    assert added_seconds(plans) == [approx(both), 0.0]
    first, second = reductions(plans[1])
    assert first.kernels == 2
    assert first.reason.endswith("; compiles 2 kernels of finite elements first (1.2 s, once)")
    assert second in plans[0].stages


def test_a_static_analysis_compiles_no_mass_and_curved_cells_kernels_of_their_own(
    tmp_path: Path,
) -> None:
    plans = plan_twice(tmp_path, TUBE, STATIC)
    assert [stage.kernels for stage in reductions(plans[1])] == [1, 1]
    wanted = [KERNEL_SECONDS["stiffness-tet10"], KERNEL_SECONDS["stiffness-tet10-curved"]]
    assert added_seconds(plans) == approx(wanted)


def test_kernels_in_the_cache_leave_a_plan_as_it_is_and_deleted_ones_are_counted_again(
    tmp_path: Path, cache: Path
) -> None:
    keep_compiled("stiffness-tet10")
    keep_compiled("mass-tet10")
    before, after = plan_twice(tmp_path, BOX, MODAL)
    assert after.stages == before.stages
    (cache / "mass-tet10.so").unlink()
    assert [stage.kernels for stage in reductions(plan_twice(tmp_path, BOX, MODAL)[1])] == [1, 0]


@pytest.mark.parametrize("end", ["", "-curved"])
def test_a_step_part_is_ready_with_the_kernels_of_plane_or_of_curved_cells(
    tmp_path: Path, end: str
) -> None:
    plan, _ = plan_twice(tmp_path, BOX, MODAL)
    scene = load_scene(tmp_path / "scene.toml")
    part = dataclasses.replace(plan.components["first"], solid=StepFile(Path("part.step")))
    plan = dataclasses.replace(plan, components={"first": part, "second": part})
    first = add_compiling(plan, scene).stages[1]
    curved = KERNEL_SECONDS["stiffness-tet10-curved"] + KERNEL_SECONDS["mass-tet10-curved"]
    assert f"2 kernels of finite elements first ({curved:.2g} s, once)" in first.reason
    keep_compiled(f"stiffness-tet10{end}")
    keep_compiled(f"mass-tet10{end}")
    assert add_compiling(plan, scene).stages == plan.stages


def test_every_kernel_that_a_mesh_can_need_has_a_rate() -> None:
    meshed = {
        kernel_name(part, kind, straight=straight)
        for part, kind, straight in product(PARTS, KINDS.values(), (True, False))
        if straight or kind == "tet10"  # of our own meshes
    }
    assert meshed == set(KERNEL_SECONDS)
