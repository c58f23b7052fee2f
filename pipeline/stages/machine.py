"""A machine coupled of superelements in a pose: what analyses ask of it, and the stage that couples
it.
"""

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray, Frame
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.machine import Pose
from headstock.geometry.mechanisms.exechon import solve_pose
from headstock.geometry.parts.skins import Skin
from headstock.meshing.components.skins import PIXEL, skin_size, thin_skin
from headstock.pipeline.answers.map import describe_state
from headstock.pipeline.answers.static import PointCompliance, compliance_key
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.results.views import (
    PoseView,
    ShiftArray,
    component_skin,
    shift_skins,
    view_pose,
)
from headstock.pipeline.stages.estimates import estimate_compliance_errors, estimate_mode_errors
from headstock.pipeline.stages.run_state import (
    MachineParts,
    Outcome,
    Released,
    RunState,
    Solved,
    pose_name,
)
from headstock.pipeline.storage.content_keys import thinned_skin_key
from headstock.pipeline.storage.store import read_entry, write_entry
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.coupling.drives import (
    anchor_motors,
    find_weight_stiffness,
    free_driven,
    place_drives,
    release_motors,
)
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.reduction.coupling.joint_forces import JointForces, find_joint_forces
from headstock.reduction.motions.body_motions import (
    FreeMotion,
    find_free_motions,
    free_motion_error,
    rigid_dofs,
    solve_machine_static,
    warn_of_free_motions,
)
from headstock.reduction.motions.compliance_budget import (
    find_weakest_link,
    motions_at,
    point_budget,
    turns_at,
)
from headstock.reduction.motions.mode_naming import NamedModes, name_modes
from headstock.reduction.motions.part_names import name_families
from headstock.reduction.motions.tool_deviation import fixed_offsets
from headstock.scene.scene import Scene
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.linear.static_response import solve_balanced
from headstock.solvers.linear.symmetric_modes import RESOLVED
from headstock.solvers.second_order import Channel, SecondOrderSystem

DAMPING = "damping"
ALL_LOADS = "all loads"
# of all surfaces together, so that the report can be mailed; what has more is drawn more coarsely
MOST_TRIANGLES = 48_000
FEWEST_TRIANGLES = 12  # of one surface: a box


@dataclass(frozen=True, eq=False)
class CoupledPose:
    """A machine of superelements in a pose; see :class:`PoseModel`.

    Attributes:
        resolved: Relative error that the highest eigenvalue of all modes may have.
    """

    parts: MachineParts
    pose: Pose
    coupled: CoupledMachine
    resolved: float = RESOLVED

    @property
    def system(self) -> SecondOrderSystem:
        """Its equations of motion."""
        return self.coupled.system

    @functools.cached_property
    def all_modes(self) -> ModalResult:
        """All undamped modes of the system."""
        return solve_modal(self.system, resolved=self.resolved)

    @property
    def placements(self) -> Mapping[str, Frame]:
        """Frame of each component in the machine frame."""
        return self.coupled.placements

    @property
    def offsets(self) -> dict[str, slice]:
        """Component to its rows among the superelement dofs."""
        return self.coupled.offsets

    def expand(self, motions: FloatArray) -> FloatArray:
        """Motions of superelement dofs ``(n_all, k)`` of motions of the system ``(n, k)``."""
        return self.coupled.basis @ motions

    @property
    def loads(self) -> Mapping[str, FloatArray]:
        """Generalised load ``(n,)`` of every static load by name, gravity among them."""
        return self.coupled.loads

    @property
    def joints(self) -> tuple[JointForces, ...]:
        """Forces of its joints; dampers act with the effect damping."""
        damped = DAMPING in self.parts.scene.effects
        return find_joint_forces(self.coupled.joint_springs, damped=damped)

    def momentum(self, velocities: Mapping[str, FloatArray]) -> FloatArray:
        """Generalised momentum ``(n,)`` of components that translate."""
        stacked = np.zeros(len(self.coupled.basis))
        for name, velocity in velocities.items():
            motions = rigid_dofs(self.coupled, name, self.placements[name].origin)[:, :3]
            stacked[self.offsets[name]] = self.coupled.matrices.masses[name] @ (motions @ velocity)
        return self.coupled.basis.T @ stacked

    def push(self, channel: Channel) -> FloatArray:
        """Motion of the system ``(n,)`` under a unit force in a channel, as far as free motions leave
        it determined.
        """
        return solve_machine_static(self.coupled, self.system.inputs[channel]).displacements

    def name_modes(self, modes: ModalResult) -> NamedModes:
        """Names by what moves and where it is fixed, and energy shares."""
        return name_modes(self.coupled, modes)

    def estimate_mode_errors(self, modes: ModalResult) -> tuple[Estimate, ...]:
        """An estimate [Hz] per natural frequency, from meshes and reductions."""
        return estimate_mode_errors(self.parts, self.coupled, modes)

    def solve_point(self, name: str) -> Solved[PointCompliance]:
        """Static compliance at a point, its budget and its errors.

        Raises:
            ModelError: A free motion leaves nothing determined there.
        """
        coupled = self.coupled
        budget = point_budget(coupled, name)
        along = np.diag(budget.compliance)[:3]
        most_compliant = DIRECTIONS[int(np.nanargmax(along))]
        link = find_weakest_link(coupled, name, most_compliant, budget)
        errors = estimate_compliance_errors(self.parts, coupled, budget.displacements)
        errors |= {
            direction: Estimate()
            for direction, value in zip(DIRECTIONS, along, strict=True)
            if np.isnan(value)
        }
        free = find_free_motions(coupled) if budget.free else ()
        displacements, failures = self._displace(name)
        return Solved(
            PointCompliance(
                budget.compliance,
                budget.shares,
                "" if link is None else str(link),
                displacements.pop(ALL_LOADS, None),
                tuple(map(str, free)),
                displacements,
                turns=turns_at(coupled, name),
            ),
            (warn_of_free_motions(self.undeclared(free) or free),) if free else (),
            failures,
            {
                compliance_key(self.pose.name, name, direction): error
                for direction, error in errors.items()
            },
        )

    def _displace(self, name: str) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
        """Motion ``(6,)`` of a point under all static loads together, as ``ALL_LOADS``, and under
        each, NaN where a free motion leaves it open; why there is none.
        """
        coupled = self.coupled
        if not coupled.loads:
            return {}, ()
        loads = np.column_stack([*coupled.loads.values()])
        try:
            solution = solve_balanced(coupled.system, np.column_stack([loads.sum(axis=1), loads]))
            if not solution.balanced[0]:
                raise free_motion_error(coupled)
        except ModelError as error:
            return {}, (f"displacements under the loads {', '.join(coupled.loads)}: {error}",)
        rows = motions_at(coupled.system.outputs, name)
        determined = solution.determines(rows)[:, None] & solution.balanced
        if not turns_at(coupled, name):
            determined[len(DIRECTIONS) :] = False
        moved = np.where(determined, rows @ solution.displacements, np.nan)
        offsets = fixed_offsets(coupled, self.parts.scene.machine, name)
        offsets[ALL_LOADS] = np.sum([np.zeros(6), *offsets.values()], axis=0)
        return {
            load: moved[:, number] + offsets.get(load, 0.0)
            for number, load in enumerate((ALL_LOADS, *coupled.loads))
        }, ()

    def undeclared(self, motions: Sequence[FreeMotion]) -> tuple[FreeMotion, ...]:
        """Those of the free motions in which not every body is declared free."""
        components = self.parts.plan.components
        return tuple(
            motion
            for motion in motions
            if not motion.bodies or not all(components[name].free for name in motion.bodies)
        )

    def release(self, drives: Collection[Drive]) -> Released:
        """The same machine with its motors let go, and their drives; legs that a motor moves without
        compliance slide freely.
        """
        machine, coupled = self.parts.scene.machine, self.coupled
        freed = free_driven(coupled, machine, drives)
        if freed.joints != machine.joints:
            machine = freed
            coupled = couple(
                self.parts.superelements,
                machine,
                self.pose,
                gravity=self.parts.plan.gravity,
                geometric=coupled.geometric,
            )
        trains = place_drives(coupled, machine, drives)
        if coupled.geometric is not None:
            masses = [part.mass_kg for part in self.parts.superelements.values()]
            trains = anchor_motors(trains, masses, machine.gravity)
        released = dataclasses.replace(self, coupled=release_motors(coupled, trains))
        weight = None
        if coupled.geometric is not None:
            geometric = coupled.basis.T @ coupled.geometric @ coupled.basis
            weight = find_weight_stiffness(released.system, trains, geometric)
        return Released(released, trains, weight)

    def view(self) -> PoseView:
        """Return what is drawn of the pose without motions."""
        return view_pose(self.coupled, self.parts.scene.machine)

    def shift_skins(self, skins: dict[str, Skin], motions: FloatArray) -> dict[str, ShiftArray]:
        """Displacement ``(k, n, 3)`` of every skin point in machine axes."""
        return shift_skins(self.coupled, skins, motions)


def couple_pose(
    parts: MachineParts, pose: Pose, *, memo: CouplingMemo | None = None
) -> CoupledPose:
    """Couple the superelements of a machine in a pose.

    Args:
        memo: What other poses and machines of the same superelements share; the result is the same
            without.
    """
    gravity, machine = parts.plan.gravity, parts.scene.machine
    return CoupledPose(
        parts, pose, couple(parts.superelements, machine, pose, gravity=gravity, memo=memo)
    )


def run_couple_stage(state: RunState, stage: Stage) -> Outcome:
    """Couple the superelements in a pose."""
    if not state.is_root:
        return Outcome()
    model = couple_pose(state.parts, state.plan.poses[pose_name(stage)])
    state.model, mechanism = model, state.scene.mechanism
    add_view(state)
    pose = model.pose
    stand = (
        ()
        if mechanism is None
        else (describe_state(mechanism, pose.name, solve_pose(mechanism, pose.positions)),)
    )
    return Outcome(
        detail=f"{len(model.system.labels)} dofs",
        answers=stand,
        warnings=tuple(model.coupled.warnings),
    )


def add_view(state: RunState) -> None:
    """Keep what is drawn of the machine in the pose at hand."""
    if state.model is not None:
        state.skins = state.skins or _thin_together(
            state,
            {
                name: component_skin(state.plan.components[name], part.superelement, part.skin)
                for name, part in state.reduced.items()
            },
        )
        state.views[state.model.pose.name] = state.model.view()


def _thin_together(state: RunState, skins: dict[str, Skin]) -> dict[str, Skin]:
    """Surfaces of a machine of many parts, coarser where that is not visible in a picture of all of
    them; the coarser ones are kept in the store.
    """
    share = MOST_TRIANGLES / max(1, sum(len(skin.triangles) for skin in skins.values()))
    if share >= 1.0:
        return skins
    # the machine is at least as large as its largest part
    pixel = PIXEL * max(skin_size(skin) for skin in skins.values())
    thinned: dict[str, Skin] = {}  # equal parts are thinned out once
    drawn = {}
    for name, skin in skins.items():
        largest = max(FEWEST_TRIANGLES, int(share * len(skin.triangles)))
        if len(skin.triangles) <= largest:
            drawn[name] = skin
            continue
        key = thinned_skin_key(skin, largest=largest, pixel=pixel)
        if key not in thinned:
            read = read_entry(state.store, key, Skin)
            state.warn(read.warning)
            thinned[key] = read.value or thin_skin(skin, largest=largest, pixel=pixel)
            if read.value is None:
                state.warn(write_entry(state.store, key, thinned[key]))
        drawn[name] = dataclasses.replace(thinned[key], kept_whole=skin.kept_whole)
    return drawn


def damp_system(
    scene: Scene, system: SecondOrderSystem, modes: ModalResult | None = None
) -> SecondOrderSystem:
    """The system with the damping of the scene: none unless the effect is named; modal ratios on
    top of joints, components and materials.

    Args:
        system: As coupled, with what joints and materials bring.
        modes: All undamped modes, where they are already known.
    """
    if DAMPING not in scene.effects:
        return dataclasses.replace(system, damping=None, hysteretic=None)
    return add_modal_damping(system, scene.modal_damping, modes) if scene.modal_damping else system


def list_dampings(scene: Scene) -> tuple[str, ...]:
    """List what the damping ratios of a scene's modes add up from."""
    machine, ratios = scene.machine, scene.modal_damping
    joints, parts = machine.joints.values(), machine.components.values()
    owners = {
        "loss factors of": [owner.name for owner in joints if owner.loss_factor]
        + sorted({owner.material.name for owner in parts if owner.material.loss_factor}),
        "dampers of": [owner.name for owner in joints if owner.damping.any()],
        "Rayleigh damping of": ["the machine"] * bool(machine.rayleigh)
        + [owner.name for owner in parts if owner.rayleigh],
    }
    given = ", ".join(f"{100.0 * ratio:g} %" for ratio in ratios)
    of_modes = "every mode" if len(ratios) == 1 else "the first modes, the last of all others"
    return (
        *((f"{given} of {of_modes}",) if ratios else ()),
        *(f"{kind} {', '.join(name_families(names))}" for kind, names in owners.items() if names),
    )


def warn_of_no_damping(scene: Scene, system: SecondOrderSystem) -> tuple[str, ...]:
    """A warning where the effect damping is on and there is none in the system as coupled."""
    if (
        DAMPING not in scene.effects
        or scene.modal_damping
        or system.damping is not None
        or system.hysteretic is not None
    ):
        return ()
    return (
        "the effect damping is on, but no joint, component and material has any: every damping ratio is zero",
    )
