"""How each component is reduced: which fixed-interface modes are kept, whether its equations are
factored or iterated, and which kernels of finite elements a first run compiles for it.

A static analysis needs constraint modes and no eigenpairs; fixed-interface modes are kept as far as
the scene says, else up to ``MODE_MARGIN`` times the highest wanted frequency (``FRF_MARGIN`` times
that of a frequency response), else ``_default_mode_count`` of them.
"""

import dataclasses
import math
from collections.abc import Sequence
from itertools import product

from headstock.geometry.parts.components import Component, ReductionSettings
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.component_mesh import CellKind
from headstock.meshing.components.mesh_request import has_plane_faces_only
from headstock.pipeline.planning.analyses import EXACT_MARGIN, is_dynamic, list_reaches
from headstock.pipeline.planning.budgets import kernel_seconds, reduction_memory_mb
from headstock.pipeline.planning.plan import Plan, Stage
from headstock.pipeline.planning.resources import node_memory_bytes
from headstock.reduction.components.solver_choice import (
    SolverChoice,
    choose_method,
    predict_factor_entries,
)
from headstock.reduction.requests import ReductionRequest, mode_target, needs_mass
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.scene import Analyses, Scene
from headstock.solvers.elastic.kernels import KernelPart, kernel_link, kernel_name

FEWEST_DEFAULT_MODES = 20
# limit of the default: what these modes leave out of a response is in its ±
MOST_DEFAULT_MODES = 200

KINDS: dict[tuple[str, int], CellKind] = {
    ("tet", 1): "tet4",
    ("tet", 2): "tet10",
    ("hex", 1): "hex8",
    ("hex", 2): "hex27",
}


def choose_reduction(component: Component, analyses: Analyses) -> tuple[ReductionSettings, str]:
    """Choose the fixed-interface modes of a component that are kept, and say why."""
    written, modal = component.reduction, analyses.get(ModalRequest)
    if not is_dynamic(analyses):
        return ReductionSettings(
            modes=0, solver=written.solver
        ), "static only: constraint modes, no eigenpairs"
    if written.modes is not None:
        return written, f"{written.modes} fixed-interface modes, as the scene says"
    if written.modes_to_hz is not None:
        return written, f"fixed-interface modes up to {written.modes_to_hz:g} Hz, as the scene says"
    reaches = list_reaches(analyses)
    if reaches:
        what = max(reaches, key=lambda name: math.prod(reaches[name]))
        reach, margin = reaches[what]
        # without interfaces modes are those of the component itself, and a margin only serves the
        # estimate of their errors
        limit = reach * (margin if component.interfaces else EXACT_MARGIN)
        settings = dataclasses.replace(written, modes_to_hz=limit, modes=MOST_DEFAULT_MODES)
        text = f"fixed-interface modes up to {limit:g} Hz, {MOST_DEFAULT_MODES} at most"
        return settings, f"{what} up to {reach:g} Hz: {text}"
    wanted = (modal.count if modal is not None else None) or 0
    count = max(FEWEST_DEFAULT_MODES, 2 * wanted + 8)
    return dataclasses.replace(
        written, modes=count
    ), f"modal analysis of {wanted} frequencies: {count} fixed-interface modes"


def choose_solver(
    component: Component, scene: Scene, dofs: int, extents: Sequence[float] | None
) -> SolverChoice:
    """By factors where they fit this machine, or what the scene allows of it.

    Args:
        extents: Sides of the box around it [m]; None where unknown.
    """
    limit = scene.limits.memory_bytes
    return choose_method(
        component.reduction,
        predict_factor_entries(dofs, extents),
        direct_mb=reduction_memory_mb(dofs, component),
        memory_mb=(node_memory_bytes() if limit is None else limit) / 1e6,
    )


def add_compiling(plan: Plan, scene: Scene) -> Plan:
    """The plan with the kernels that a run would compile in the first stage that needs each."""
    stages: list[Stage] = []
    counted: set[str] = set()
    for stage in plan.stages:
        missing = list_missing_kernels(stage, plan, scene)
        stages.append(add_kernels(stage, [name for name in missing if name not in counted]))
        counted.update(missing)
    return dataclasses.replace(plan, stages=tuple(stages))


def add_kernels(stage: Stage, missing: Sequence[str]) -> Stage:
    """A stage with kernels to compile first, in its reason and its time."""
    if not missing:
        return stage
    seconds = sum(kernel_seconds(name) for name in missing)
    what = "1 kernel" if len(missing) == 1 else f"{len(missing)} kernels"
    known = stage.estimated_seconds
    return dataclasses.replace(
        stage,
        reason=f"{stage.reason}; compiles {what} of finite elements first ({seconds:.2g} s, once)",
        estimated_seconds=None if known is None else known + seconds,
        kernels=len(missing),
    )


def _list_kernel_parts(component: Component, plan: Plan, scene: Scene) -> list[KernelPart]:
    loads = [load for load in scene.machine.loads.values() if load.component == component.name]
    request = ReductionRequest(
        modes=mode_target(component) if plan.with_modes else None,
        gravity=plan.gravity is not None or bool(scene.machine.base_motions),
    )
    parts: list[KernelPart] = ["stiffness"]
    if needs_mass(component, loads, request):
        parts.append("mass")
    if component.reduction.solver == "iterative":
        parts.append("corners")
    return parts


def list_missing_kernels(stage: Stage, plan: Plan, scene: Scene) -> list[str]:
    """Names of the kernels that a stage works with and that are not in the cache.

    Where only the mesh will tell which cells it has, those that are in the cache are taken to be
    the ones, and else those of curved cells.

    Args:
        stage: Any; others than ``reduce`` work with none.
    """
    if stage.kind != "reduce":
        return []
    component = plan.components[str(stage.component)]
    parts = _list_kernel_parts(component, plan, scene)
    solid, order = component.solid, component.mesh.order
    known = KINDS[component.mesh.cells, order]
    kinds = tuple(KINDS.values()) if isinstance(solid, MeshFile) else (known,)
    straight = order == 1 or has_plane_faces_only(component)
    unknown = order == 2 and isinstance(solid, StepFile | MeshFile)
    shapes = list(product(kinds, (False, True) if unknown else (straight,)))
    for kind, plane in shapes:
        names = [kernel_name(part, kind, straight=plane) for part in parts]
        if all(kernel_link(name).exists() for name in names):
            return []
    plane = straight and not unknown
    names = [kernel_name(part, known, straight=plane) for part in parts]
    return [name for name in names if not kernel_link(name).exists()]
