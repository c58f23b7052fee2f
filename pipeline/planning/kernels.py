"""Kernels of finite elements that a first run compiles: which of a plan's are not in the cache of the
user, and the time that they add to it.
"""

import dataclasses
from collections.abc import Sequence
from itertools import product

from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.component_mesh import CellKind
from headstock.meshing.components.meshing import has_plane_faces_only
from headstock.pipeline.planning.budgets import kernel_seconds
from headstock.pipeline.planning.plan import Plan, Stage
from headstock.reduction.requests import ReductionRequest, mode_target, needs_mass
from headstock.scene.scene import Scene
from headstock.solvers.elastic.kernels import KernelPart, kernel_link, kernel_name

KINDS: dict[tuple[str, int], CellKind] = {
    ("tet", 1): "tet4",
    ("tet", 2): "tet10",
    ("hex", 1): "hex8",
    ("hex", 2): "hex27",
}


def add_compiling(plan: Plan, scene: Scene) -> Plan:
    """The plan with the kernels that a run would compile in the first stage that needs each."""
    stages: list[Stage] = []
    counted: set[str] = set()
    for stage in plan.stages:
        missing = list_missing(stage, plan, scene)
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


def list_missing(stage: Stage, plan: Plan, scene: Scene) -> list[str]:
    """Names of the kernels that a stage works with and that are not in the cache.

    Where only the mesh will tell which cells it has, those that are in the cache are taken to be
    the ones, and else those of curved cells.

    Args:
        stage: Any; others than ``reduce`` work with none.
    """
    if stage.kind != "reduce":
        return []
    component = plan.components[str(stage.component)]
    loads = [load for load in scene.machine.loads.values() if load.component == component.name]
    request = ReductionRequest(
        modes=mode_target(component) if plan.with_modes else None,
        gravity=plan.gravity is not None,
    )
    parts: list[KernelPart] = ["stiffness"]
    if needs_mass(component, loads, request):
        parts.append("mass")
    if component.reduction.solver == "iterative":
        parts.append("corners")
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
