"""A lumped mechanism in a pose: what analyses ask of it, and the stage that places it."""

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray, Frame, rigid_map
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import Pose
from headstock.geometry.mechanisms.exechon import LEGS, LENGTHS, solve_pose
from headstock.geometry.parts.skins import Skin
from headstock.pipeline.answers.map import describe_state
from headstock.pipeline.answers.static import PointCompliance
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.results.views import PointView, PoseView, ShiftArray, view_sensors
from headstock.pipeline.stages.lumped_machine import (
    PlacedMechanism,
    build_compliant_mechanism,
    deviate,
    leg_offsets,
    place_leg_drives,
    place_mechanism,
    spring_shares,
)
from headstock.pipeline.stages.machine import DAMPING, add_view, couple_pose
from headstock.pipeline.stages.run_state import (
    MachineParts,
    Outcome,
    PoseModel,
    Released,
    RunState,
    Solved,
    pose_name,
)
from headstock.reduction.coupling.channels import GRAVITY
from headstock.reduction.coupling.drives import anchor_motors, find_weight_stiffness
from headstock.reduction.coupling.guide_errors import GUIDE_ERRORS
from headstock.reduction.coupling.joint_forces import JointForces
from headstock.reduction.motions.mode_naming import NamedModes
from headstock.reduction.motions.tool_deviation import ToolDeviation
from headstock.reduction.superelement import Superelement
from headstock.scene.scene import SceneMechanism
from headstock.scene.schema.effects import GRAVITY_STIFFENING
from headstock.solvers.control.drive_trains import DriveTrain, free_motors
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.linear.symmetric_matrices import require_standing
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.modes import pose_system
from headstock.solvers.motion.plant import PosedModes
from headstock.solvers.second_order import Channel, SecondOrderSystem

SWING_SHARE = 0.5  # kinetic energy of the legs from which a mode is called theirs
NAMED_SHARE = 0.2
LUMPED = Estimate(left_out=("the lumped model itself: rigid bodies on the springs of the scene",))
PLATFORM_MOTIONS = ("swings about the common axis", "tilts between legs 1 and 2", "plunges")


@dataclass(frozen=True, eq=False)
class LumpedPose:
    """A lumped mechanism in a pose; see :class:`PoseModel`. Each component has six superelement
    dofs, of its centre of mass.
    """

    parts: MachineParts
    pose: Pose
    placed: PlacedMechanism
    motors: tuple[DriveTrain, ...] = ()

    @property
    def coupled(self) -> None:
        """There are no superelements to couple."""

    @functools.cached_property
    def system(self) -> SecondOrderSystem:
        """Its equations of motion in the compliant coordinates, and those of motors let go."""
        return free_motors(self._bare_system, self.motors) if self.motors else self._bare_system

    @functools.cached_property
    def _bare_system(self) -> SecondOrderSystem:
        machine, placed = self.parts.scene.machine, self.placed
        ends = [
            JointEnd(name, interface)
            for name, body in placed.superelements.items()
            for interface in (*body.interface_maps, *body.rails)
        ]
        channels = {str(end): placed.motion_at(end) for end in ends}
        channels |= {
            name: placed.motion_at(point.tool, point.offset)
            for name, point in machine.points.items()
        }
        # of motors let go their drives hold what springs alone do not
        if placed.motions.geometric is not None and placed.motions.stiffness.all():
            require_standing(np.diag(placed.motions.stiffness), placed.motions.geometric)
        system = pose_system(placed.model, placed.motions, channels)
        measured = {
            (sensor.name, dof): row
            for sensor in machine.sensors.values()
            for dof, row in zip(sensor.directions, placed.measure(sensor), strict=True)
        }
        system = dataclasses.replace(
            system, inputs={**system.inputs, **measured}, outputs={**system.outputs, **measured}
        )
        rayleigh = machine.rayleigh
        if not rayleigh:
            return system
        springs = np.diag(placed.motions.stiffness)
        return dataclasses.replace(
            system, damping=rayleigh.alpha * system.mass + rayleigh.beta * springs
        )

    def release(self, drives: Collection[Drive]) -> Released:
        """The same machine with the motors of its legs let go, and their drives."""
        free = place_pose(
            self.parts,
            self.pose,
            self.placed.model,
            self.placed.superelements,
            released=[drive.axis for drive in drives],
        )
        trains = place_leg_drives(
            free.placed, free.system, drives, beta=self.parts.scene.machine.rayleigh.beta
        )
        model, geometric = self.placed.model, free.placed.motions.geometric
        if geometric is None:
            return Released(dataclasses.replace(free, motors=trains), trains)
        trains = anchor_motors(trains, [body.mass for body in model.bodies], model.gravity)
        released = dataclasses.replace(free, motors=trains)
        return Released(released, trains, find_weight_stiffness(released.system, trains, geometric))

    @functools.cached_property
    def all_modes(self) -> ModalResult:
        """All undamped modes of the system."""
        return solve_modal(self.system)

    @property
    def placements(self) -> Mapping[str, Frame]:
        """Frame of each component in the machine frame."""
        return self.placed.placements

    @property
    def offsets(self) -> dict[str, slice]:
        """Component to its rows among the superelement dofs."""
        return {
            name: slice(6 * number, 6 * number + 6)
            for number, name in enumerate(self.placed.body_motions)
        }

    def expand(self, motions: FloatArray) -> FloatArray:
        """Motions of superelement dofs ``(n_all, k)`` of motions of the system ``(n, k)``."""
        return np.concatenate([moving @ motions for moving in self.body_motions.values()])

    @property
    def loads(self) -> Mapping[str, FloatArray]:
        """Generalised load ``(n,)`` of every static load by name, gravity among them."""
        placed, loads = self.placed, self.parts.scene.machine.loads.values()
        by_name = {load.name: self._widen(placed.load_of(load)) for load in loads}
        for name, given in self.parts.scene.machine.base_motions.items():
            bodies = [self.body_loads(body)[:, :3] for body in placed.body_motions]
            by_name[name] = np.sum(bodies, axis=0) @ np.array(given)
        if self.parts.plan.gravity is not None:
            by_name[GRAVITY] = self._widen(placed.motions.gravity)
        return by_name

    @functools.cached_property
    def body_motions(self) -> dict[str, FloatArray]:
        """Component to ``(6, n)`` motion of its centre of mass and its turning per coordinate of the
        system, machine axes.
        """
        return {name: self._widen(motion) for name, motion in self.placed.body_motions.items()}

    def _widen(self, rows: FloatArray) -> FloatArray:
        """Rows ``(..., c)`` with zeros for the coordinates of motors let go, ``(..., n)``."""
        wider = np.zeros((*rows.shape[:-1], len(self.system.mass)))
        wider[..., : rows.shape[-1]] = rows
        return wider

    @property
    def joints(self) -> tuple[JointForces, ...]:
        """Forces of the springs across and along each leg."""
        stiffness = self.placed.motions.stiffness
        springs = np.zeros((len(stiffness), len(self.system.mass)))
        springs[:, : len(stiffness)] = np.diag(stiffness)
        damped = DAMPING in self.parts.scene.effects
        beta = self.parts.scene.machine.rayleigh.beta if damped else 0.0
        return tuple(
            JointForces(leg, ("across", "along"), springs[rows], beta * springs[rows])
            for number, leg in enumerate(LEGS)
            for rows in (slice(2 * number, 2 * number + 2),)
        )

    def momentum(self, velocities: Mapping[str, FloatArray]) -> FloatArray:
        """Generalised momentum ``(n,)`` of components that translate, or whose velocity ``(6,)`` is
        that of their centre of mass and about it.
        """
        total = np.zeros(len(self.system.mass))
        for name, velocity in velocities.items():
            carried = self.body_masses[name][:, : len(velocity)] @ velocity
            total += self.body_motions[name].T @ carried
        return total

    def body_loads(self, name: str) -> FloatArray:
        """Generalised loads ``(n, 6)`` per unit acceleration of a component as a rigid body."""
        return -self.body_motions[name].T @ self.body_masses[name]

    @functools.cached_property
    def body_masses(self) -> dict[str, FloatArray]:
        """Mass ``(6, 6)`` of each component about its centre of mass, machine axes."""
        masses = {}
        for name, body in self.placed.superelements.items():
            rotation, mass = self.placements[name].rotation, body.mass_kg * np.eye(6)
            mass[3:, 3:] = rotation @ body.inertia @ rotation.T
            masses[name] = mass
        return masses

    def stack_modes(self, system: SecondOrderSystem) -> PosedModes:
        """A system in these coordinates with its modes in the dofs of all bodies, which are the same
        in every pose of a path.
        """
        shapes, motions = self.all_modes.shapes, self.body_motions
        momenta = [self.body_masses[name] @ motions[name] @ shapes for name in motions]
        return PosedModes(system, self.all_modes, self.expand(shapes), np.concatenate(momenta))

    def push(self, channel: Channel) -> FloatArray:
        """Motion of the system ``(n,)`` under a unit force in a channel."""
        return solve_static(self.system, self.system.inputs[channel]).displacements

    def name_modes(self, modes: ModalResult) -> NamedModes:
        """Names, strain energy by leg and kinetic energy by component."""
        stretches = modes.shapes[: len(self.placed.motions.stiffness)]
        strain = tuple(self._leg_shares(stretch) for stretch in stretches.T)
        kinetic = tuple(self._kinetic_shares(shape) for shape in modes.shapes.T)
        names = tuple(
            self._name_mode(stretches[:, mode], strain[mode], kinetic[mode])
            for mode in range(len(strain))
        )
        return NamedModes(names, strain, kinetic)

    def estimate_mode_errors(self, modes: ModalResult) -> tuple[Estimate, ...]:
        """Nothing is known of how far a lumped model is off."""
        return (LUMPED,) * len(modes.frequencies_hz)

    def solve_point(self, name: str) -> Solved[PointCompliance]:
        """Static compliance at a point and its budget."""
        system, placed = self.system, self.placed
        loads = np.stack([system.inputs[name, dof] for dof in DOF_NAMES], axis=1)
        moved = solve_static(system, loads).displacements
        compliance = loads.T @ moved
        budget = {
            direction: spring_shares(placed, moved[:, column])
            for column, direction in enumerate(DIRECTIONS)
        }
        most_compliant = DIRECTIONS[int(np.argmax(np.diag(compliance)[:3]))]
        weakest, share = max(budget[most_compliant].items(), key=lambda item: item[1])
        # the legs are in series with the tool: halving a part's compliance takes half its share
        # away
        sentence = (
            f"{weakest} contributes {100 * share:.0f} % of the {most_compliant} compliance; doubling its stiffness changes it by"
            f" {-50 * share:+.0f} %"
        )
        displacements = {
            load: loads.T @ solve_static(system, acting).displacements
            for load, acting in self.loads.items()
        }
        mechanism = scene_mechanism(self.parts)
        if mechanism.leg_errors:
            # but for its weight nothing resists what a leg is too long by
            pushed = placed.motions.stiffness * leg_offsets(placed, mechanism.leg_errors)
            displacements[GUIDE_ERRORS] = loads.T @ solve_static(system, pushed).displacements
        total = np.sum(list(displacements.values()), axis=0) if displacements else None
        return Solved(
            PointCompliance(compliance, budget, sentence, total, displacements=displacements)
        )

    def deviate(self, name: str) -> ToolDeviation:
        """Deviation at a point by source and part."""
        loads = np.stack([self.system.inputs[name, dof] for dof in DOF_NAMES], axis=1)
        return deviate(
            self.placed,
            self.system,
            loads,
            acting=self.loads,
            errors=scene_mechanism(self.parts).leg_errors,
        )

    def view(self) -> PoseView:
        """Return what is drawn of the pose without motions."""
        points = {
            name: PointView(
                str(point.tool),
                str(point.work),
                self.placed.position_of(point.tool, point.offset),
            )
            for name, point in self.parts.scene.machine.points.items()
        }
        sensors = view_sensors(self.parts.scene.machine, self.placements)
        return PoseView(dict(self.placements), {}, points, sensors=sensors)

    def shift_skins(self, skins: dict[str, Skin], motions: FloatArray) -> dict[str, ShiftArray]:
        """Displacement ``(k, n, 3)`` of every skin point in machine axes."""
        shifts: dict[str, ShiftArray] = {}
        for name, skin in skins.items():
            rotation = self.placements[name].rotation
            center = self.placed.superelements[name].center_of_mass
            moved = (
                rigid_map(skin.points @ rotation.T, rotation @ center) @ motions[self.offsets[name]]
            )
            shifts[name] = moved.T.reshape(motions.shape[1], -1, 3).astype(np.float32)
        return shifts

    def _leg_shares(self, shape: FloatArray) -> dict[str, float]:
        parts = spring_shares(self.placed, shape)
        return {
            leg: sum(share for part, share in parts.items() if part.startswith(f"{leg}."))
            for leg in LEGS
        }

    def _kinetic_shares(self, shape: FloatArray) -> dict[str, float]:
        energies = {}
        for name, body in self.placed.superelements.items():
            motion = self.body_motions[name] @ shape
            rotation = self.placements[name].rotation
            spin = rotation.T @ motion[3:]
            energies[name] = body.mass_kg * float(motion[:3] @ motion[:3]) + float(
                spin @ body.inertia @ spin
            )
        total = sum(energies.values())
        return {name: value / total for name, value in energies.items()}

    def _name_mode(
        self, shape: FloatArray, strain: dict[str, float], kinetic: dict[str, float]
    ) -> str:
        carries = scene_mechanism(self.parts).carries
        by_leg = {
            leg: sum(
                share
                for name, share in kinetic.items()
                if carries.get(name) in (leg, f"tip_{number}")
            )
            for number, leg in enumerate(LEGS, 1)
        }
        on = " + ".join(leg for leg in LEGS if strain[leg] >= NAMED_SHARE)
        if sum(by_leg.values()) >= SWING_SHARE:
            swinging = " + ".join(leg for leg in LEGS if by_leg[leg] >= NAMED_SHARE)
            return f"{swinging} swings" if "+" not in swinging else f"{swinging} swing"
        mechanism, motions = self.placed.model.mechanism, self.placed.motions
        rates = motions.from_compliant @ shape
        speed = motions.kinematics.of_position[mechanism.markers.index("wrist_4")] @ rates
        local = (
            motions.kinematics.placement.rotations[mechanism.markers.index("platform")].T @ speed
        )
        return f"platform {PLATFORM_MOTIONS[int(np.argmax(np.abs(local)))]} on {on}"


def build_lumped_model(
    parts: MachineParts, superelements: Mapping[str, Superelement]
) -> CompliantMechanism:
    """Bodies and springs of the lumped mechanism of a scene, in every pose."""
    return build_compliant_mechanism(
        scene_mechanism(parts),
        superelements,
        {name: component.placement for name, component in parts.plan.components.items()},
        parts.plan.gravity,
        stiffening=GRAVITY_STIFFENING in parts.scene.effects,
    )


def place_pose(
    parts: MachineParts,
    pose: Pose,
    model: CompliantMechanism,
    superelements: Mapping[str, Superelement],
    released: Sequence[str] = (),
) -> LumpedPose:
    """Close the loops of a lumped mechanism in a pose and make small motions about it.

    Args:
        model: From :func:`build_lumped_model`.
        released: Lengths of legs that are free to grow.

    Raises:
        PoseError: The mechanism does not reach the pose.
    """
    mechanism = scene_mechanism(parts)
    on_marks = {name: component.placement for name, component in parts.plan.components.items()}
    closed = solve_pose(mechanism, pose.positions)
    placed = place_mechanism(
        mechanism, model, closed, superelements=superelements, own=on_marks, released=released
    )
    return LumpedPose(parts, pose, placed)


def pose_machine(parts: MachineParts, pose: Pose) -> PoseModel:
    """Return a machine in a pose, coupled of superelements or placed as a lumped mechanism.

    Raises:
        PoseError: A mechanism does not reach the pose.
    """
    if not parts.scene.is_lumped:
        return couple_pose(parts, pose)
    superelements = parts.superelements
    return place_pose(parts, pose, build_lumped_model(parts, superelements), superelements)


def run_place_stage(state: RunState, stage: Stage) -> Outcome:
    """Close the loops in a pose and make small motions about it."""
    if not state.is_root:
        return Outcome()
    parts, pose = state.parts, state.plan.poses[pose_name(stage)]
    superelements = parts.superelements
    model = place_pose(parts, pose, build_lumped_model(parts, superelements), superelements)
    stand = describe_state(scene_mechanism(parts), model.pose.name, model.placed.state)
    state.model = model
    add_view(state)
    legs = ", ".join(f"{1e3 * stand.coordinates[name]:.1f}" for name in LENGTHS)
    return Outcome(
        detail=f"legs {legs} mm, condition number {stand.condition_number:.2f}", answers=(stand,)
    )


def placed_mechanism(state: RunState) -> PlacedMechanism | None:
    """The lumped mechanism in the pose at hand; None of another machine."""
    return state.model.placed if isinstance(state.model, LumpedPose) else None


def scene_mechanism(parts: MachineParts) -> SceneMechanism:
    """The mechanism of a scene.

    Raises:
        ValueError: It has none.
    """
    if parts.scene.mechanism is None:
        raise ValueError("the scene has no mechanism")
    return parts.scene.mechanism
