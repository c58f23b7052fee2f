"""From a scene to the stages it calls for, each with its reason; no other stage is ever run.

A rigid component is never meshed; mass is assembled only when a dynamic analysis or gravity asks for
it.
"""

import dataclasses
import functools
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import assert_never

import numpy as np

from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import MeshFile, PointMass, SuperelementFile
from headstock.meshing.components.meshing import MeshEstimate, estimate_mesh
from headstock.pipeline.planning.analyses import (
    GRAVITY,
    RECORDS,
    PlannedMachine,
    is_dynamic,
)
from headstock.pipeline.planning.budgets import (
    STAGE_SECONDS,
    check_cells,
    check_time,
    iterative_memory_mb,
    iterative_seconds,
    mesh_memory_mb,
    mesh_seconds,
    pose_seconds,
    reduced_dofs,
    reduction_memory_mb,
    reduction_seconds,
    write_seconds,
)
from headstock.pipeline.planning.interfaces import find_glued_joints, has_choice
from headstock.pipeline.planning.patch_costs import (
    count_dofs,
    describe_patch_costs,
    describe_shape_costs,
)
from headstock.pipeline.planning.plan import Plan, Stage
from headstock.pipeline.planning.rail_meshes import find_coarse_rails
from headstock.pipeline.planning.reductions import (
    choose_reduction,
    choose_solver,
)
from headstock.pipeline.planning.resources import (
    RanksOnNodes,
    check_memory,
)
from headstock.pipeline.storage.content_keys import superelement_key
from headstock.reduction.components.solver_choice import (
    SolverChoice,
)
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.building.components import bounding_box
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, choose_poses


def plan_scene(
    scene: Scene,
    *,
    survey: bool = False,
    before_survey: Callable[[str], None] | None = None,
    held: RanksOnNodes | None = None,
) -> Plan:
    """The stages a scene calls for, in the order in which they run.

    Args:
        survey: Mesh the surfaces of imprinted and curved parts to count their dofs, which takes a
            second or a few each; otherwise they are counted by rules of thumb.
        before_survey: Called with the name of each component whose surface is meshed; equal
            components are surveyed once.
        held: Where the ranks are that share the components; None for one rank on this machine. Of
            several, what a node holds of components is checked when it is known which of them are not
            in the store.

    Raises:
        BudgetError: A mesh or a stage would be larger than allowed.
        SceneError: A mesh does not tell the control points of a rail apart.
    """
    coarse, perhaps = find_coarse_rails(scene)
    if coarse:
        raise SceneError(coarse)
    gravity = np.array(scene.machine.gravity) if GRAVITY in scene.effects else None
    machine, stages = _plan_components(scene, survey=survey, before_survey=before_survey)
    components, poses = dict(machine.components), choose_poses(scene)
    for pose in poses.values():
        stages.append(_place_machine(machine, pose))
        stages += filter(None, (record.plan_pose(machine, pose) for record in RECORDS))
    comparisons, nothing_to_compare = _plan_comparisons(components, scene)
    stages += comparisons
    stages += filter(None, (record.plan_run(machine) for record in RECORDS))
    stages.append(
        Stage(
            "write",
            None,
            "results.h5 and summary.json",
            estimated_seconds=write_seconds(len(components), len(poses)),
        )
    )
    several = held is not None and held.ranks > 1
    known = [stage for stage in stages if stage.component is None] if several else stages
    check_memory(known, scene.limits.memory_bytes, held=held)
    check_time(stages, scene.limits.time_s)
    return Plan(
        stages=tuple(stages),
        components=components,
        poses=poses,
        with_modes=is_dynamic(scene.analyses),
        gravity=gravity,
        warnings=(*perhaps, *_plan_warnings(components), *nothing_to_compare),
    )


def _plan_components(
    scene: Scene, *, survey: bool, before_survey: Callable[[str], None] | None
) -> tuple[PlannedMachine, list[Stage]]:
    """Return the components as they are reduced, and the stages that make them."""
    components: dict[str, Component] = {}
    stages: list[Stage] = []
    surveys: dict[str, MeshEstimate] = {}
    equals: dict[Hashable, str] = {}  # what is reduced to the first component that needs it
    dofs = 0  # of the coupled machine
    supports, loads = tuple(scene.machine.supports.values()), tuple(scene.machine.loads.values())
    for name, component in scene.machine.components.items():
        settings, reason = choose_reduction(component, scene.analyses)
        fidelity = "rigid" if scene.is_lumped else component.fidelity
        part = dataclasses.replace(component, reduction=settings, fidelity=fidelity)
        estimate, choice, patch_costs = None, None, ""
        if part.fidelity == "elastic" and not isinstance(part.solid, MeshFile | SuperelementFile):
            before = None if before_survey is None else functools.partial(before_survey, name)
            count = functools.partial(
                estimate_mesh,
                supports=supports,
                loads=loads,
                survey=survey,
                known=surveys,
                before_survey=before,
            )
            estimate = count(part)
            if survey and scene.accuracy is None:
                patch_costs = describe_patch_costs(part, scene, estimate, count)
            choice = _choose_solver(part, scene, estimate)
            if choice.method == "iterative":
                settings = dataclasses.replace(part.reduction, solver="iterative")
                part = dataclasses.replace(part, reduction=settings)
        components[name] = part
        made = _component_stages(part, reason, scene, estimate, choice, patch_costs)
        first = equals.setdefault(_reduction_key(part, scene), name)
        stages += made if first == name else [_share_stage(stage, first) for stage in made]
        dofs += reduced_dofs(part, None if estimate is None else estimate.volume)
    return PlannedMachine(scene, components, dofs), stages


def is_simple(component: Component) -> bool:
    """Tell whether a body is rigid or segmented, so that finite elements would show more of it."""
    return component.fidelity in ("rigid", "segmented") and not isinstance(
        component.solid, SuperelementFile | PointMass
    )


def _plan_comparisons(
    components: Mapping[str, Component], scene: Scene
) -> tuple[list[Stage], list[str]]:
    """Stages that try other interfaces, bodies and joints, and warnings where there is none to try."""
    modal, lumped = scene.analyses.get(ModalRequest), scene.is_lumped
    chosen = [name for name, part in components.items() if has_choice(part)]
    simple = [name for name, part in components.items() if is_simple(part)]
    glued = [joint.name for joint in find_glued_joints(scene.machine, components)]
    why = "no component is rigid or segmented"
    if lumped:
        simple, glued = [], []
        why = "the springs of a lumped mechanism are not compared with finite elements"
    stages: list[Stage] = []
    warnings: list[str] = []
    tried: tuple[tuple[bool, str, list[str], str, str], ...] = (
        (
            modal is not None and modal.spread,
            "spread",
            chosen,
            "frequencies with rigid and with averaging interfaces on",
            "modal.spread has nothing to vary: no elastic component has an interface other than a rail",
        ),
        (
            scene.model_errors,
            "models",
            simple,
            "what rigid and segmented bodies leave out: coarse finite elements for",
            f"model_errors has nothing to compare: {why}",
        ),
        (
            scene.interface_errors,
            "joints",
            glued,
            "what rigid joints leave out: deformation shapes at",
            "interface_errors has nothing to compare: no rigid joint holds two elastic components by one flat patch each",
        ),
        (
            scene.fit is not None,
            "fit",
            [] if lumped or scene.fit is None else [f"{len(scene.fit.moves)} directions"],
            "what a fit leaves open of its parameters, along",
            "a lumped mechanism has no fitted parameters",
        ),
    )
    for asked, kind, names, reason, nothing in tried:
        if asked and names:
            reason = f"{reason} {', '.join(names)}"
            stages.append(Stage(kind, None, reason, estimated_seconds=STAGE_SECONDS.get(kind)))
        elif asked:
            warnings.append(nothing)
    return stages, warnings


def _reduction_key(component: Component, scene: Scene) -> Hashable:
    """The same of components that are reduced once for all of them; those that are not elastic take
    no time and share nothing.
    """
    machine, name = scene.machine, component.name
    if component.fidelity != "elastic" or isinstance(
        component.solid, SuperelementFile | PointMass | MeshFile
    ):
        return name
    key = superelement_key(
        component,
        [support for support in machine.supports.values() if support.component == name],
        [load for load in machine.loads.values() if load.component == name],
        [probe for probe in machine.probes.values() if probe.component == name],
        [sensor for sensor in machine.sensors.values() if sensor.component == name],
    )
    return key, component.reduction


def _share_stage(stage: Stage, first: str) -> Stage:
    """A stage of a component that is equal to one before it, and takes what that one leaves in the
    store.
    """
    return dataclasses.replace(
        stage, reason=f"{stage.reason}; once for {first} and this one", estimated_seconds=0.0
    )


def _component_stages(
    component: Component,
    reason: str,
    scene: Scene,
    estimate: MeshEstimate | None,
    choice: SolverChoice | None,
    patch_costs: str = "",
) -> Sequence[Stage]:
    limits = scene.limits
    name, solid = component.name, component.solid
    if isinstance(solid, SuperelementFile):
        return (Stage("load", name, f"its matrices are imported from {solid.path.name}"),)
    if isinstance(solid, PointMass):
        return (Stage("rigid", name, "a point mass", estimated_dofs=6),)
    if component.fidelity == "rigid":
        return (Stage("rigid", name, "rigid: mass properties, no mesh", estimated_dofs=6),)
    if component.fidelity == "elastic":
        if isinstance(solid, MeshFile):
            return (
                Stage("mesh", name, f"elastic: its mesh is read from {solid.path.name}"),
                Stage("reduce", name, reason),
            )
        if estimate is None or choice is None:
            raise ValueError(f"component {name!r} is meshed, but nobody estimated its mesh")
        check_cells(component, estimate.cells, limits.elements)
        dofs = count_dofs(component, estimate)
        meshing = Stage(
            "mesh",
            name,
            f"elastic{patch_costs}",
            None,
            dofs,
            mesh_memory_mb(dofs),
            mesh_seconds(dofs, component.mesh),
        )
        iterates = choice.method == "iterative"
        memory = (iterative_memory_mb if iterates else reduction_memory_mb)(dofs, component)
        count_seconds = functools.partial(
            iterative_seconds if iterates else reduction_seconds, dofs, volume=estimate.volume
        )
        why = f"{reason}; {choice.reason}{describe_shape_costs(component, count_seconds)}"
        seconds = count_seconds(component)
        return (meshing, Stage("reduce", name, why, None, dofs, memory, seconds))
    if component.fidelity == "segmented":
        count = component.segments.count
        what = f"segmented: {count} rigid bodies on beam springs, no mesh"
        return (
            Stage(
                "segment",
                name,
                what,
                estimated_dofs=6 * count,
                estimated_seconds=STAGE_SECONDS["segment"],
            ),
        )
    if component.fidelity == "polynomial":
        return (
            Stage(
                "expand",
                name,
                f"displacements as polynomials, no mesh; {reason}",
                estimated_seconds=STAGE_SECONDS["expand"],
            ),
        )
    assert_never(component.fidelity)


def _choose_solver(component: Component, scene: Scene, estimate: MeshEstimate) -> SolverChoice:
    box = bounding_box(component.solid)
    extents = None if box is None else [high - low for low, high in box]
    return choose_solver(component, scene, count_dofs(component, estimate), extents)


def _place_machine(machine: PlannedMachine, pose: Pose) -> Stage:
    """Return the stage that builds the machine in a pose."""
    scene = machine.scene
    if scene.is_lumped:
        return Stage(
            "place",
            None,
            "loop-closure constraints solved in the pose; bodies and springs of its legs",
            pose=pose.name,
            estimated_seconds=pose_seconds("place", machine.dofs),
        )
    counts = {"component": len(scene.machine.components), "joint": len(scene.machine.joints)}
    parts = " at ".join(
        f"{count} {what}{'' if count == 1 else 's'}" for what, count in counts.items()
    )
    if scene.machine.gravity_stiffening:
        parts += ", with the geometric stiffness of its weight"
    seconds = pose_seconds("couple", machine.dofs)
    return Stage("couple", None, parts, pose=pose.name, estimated_seconds=seconds)


def _plan_warnings(components: dict[str, Component]) -> tuple[str, ...]:
    return tuple(
        f"component {name!r} is meshed with linear elements, which lock: they are too stiff in bending (frequencies of a solid cantilever were"
        " 10 to 50 % too high); write mesh = { order = 2 }"
        for name, component in components.items()
        if component.fidelity == "elastic"
        and component.mesh.order == 1
        and not isinstance(component.solid, SuperelementFile | MeshFile)
    )
