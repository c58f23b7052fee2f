"""The stages of a lumped mechanism: place it in a pose, static compliance, natural modes. Only rank 0 has anything to do."""

import dataclasses

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray, rigid_map
from headstock.geometry.machine.machine import position_units
from headstock.geometry.mechanisms.exechon import LEGS, LENGTHS
from headstock.geometry.mechanisms.tool_mechanism import solve_pose
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.results.estimates import Estimate
from headstock.pipeline.results.results import PointCompliance, PoseModes, describe_state
from headstock.pipeline.results.views import PointView, PoseView, ShiftArray, component_skin
from headstock.pipeline.stages.frf import respond
from headstock.pipeline.stages.lumped_machine import (
    PlacedMechanism,
    build_compliant_mechanism,
    place_mechanism,
    spring_shares,
)
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.scene.scene import SceneMechanism
from headstock.scene.schema.effects import GRAVITY_STIFFENING
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.mechanisms.modes import pose_system
from headstock.solvers.second_order import SecondOrderSystem

SWING_SHARE = 0.5  # kinetic energy of the legs from which a mode is called theirs
NAMED_SHARE = 0.2
LUMPED = Estimate(left_out=("the lumped model itself: rigid bodies on the springs of the scene",))
PLATFORM_MOTIONS = ("swings about the common axis", "tilts between legs 1 and 2", "plunges")


def run_place_stage(state: RunState, stage: Stage) -> Outcome:
    """Close the loops in a pose and make small motions about it."""
    if not state.is_root:
        return Outcome()
    mechanism = _mechanism(state)
    pose = state.plan.poses[_pose_name(stage)]
    superelements = {name: reduced.superelement for name, reduced in state.reduced.items()}
    own = {name: component.placement for name, component in state.plan.components.items()}
    stiffening = GRAVITY_STIFFENING in state.scene.effects
    model = build_compliant_mechanism(mechanism, superelements, own, state.plan.gravity, stiffening=stiffening)
    coordinates = solve_pose(mechanism, pose.positions)
    placed = place_mechanism(mechanism, model, coordinates, (superelements, own))
    stand = describe_state(mechanism, coordinates)
    state.placed, state.mechanism[pose.name] = placed, stand
    state.skins = {
        name: component_skin(state.plan.components[name], part.superelement, part.skin) for name, part in state.reduced.items()
    }
    points = {
        name: PointView(str(point.tool), str(point.work), placed.position_of(point.tool))
        for name, point in state.scene.machine.points.items()
    }
    state.views[pose.name] = PoseView(dict(placed.placements), {}, points)
    legs = ", ".join(f"{1e3 * stand.coordinates[name]:.1f}" for name in LENGTHS)
    return Outcome(detail=f"legs {legs} mm, condition number {stand.condition_number:.2f}")


def run_lumped_static_stage(state: RunState, stage: Stage) -> Outcome:
    """Compliance and its budget at every point asked for."""
    if not state.is_root:
        return Outcome()
    placed, request = _placed(state), state.scene.analyses.static
    names = () if request is None else request.at
    system = _system(state, placed)
    state.static[_pose_name(stage)] = {name: _point_compliance(state, placed, system, name) for name in names}
    pushes = {
        f"{name} {direction}": _shift_skins(state, placed, solve_static(system, system.inputs[name, direction]).displacements)
        for name in names
        for direction in DIRECTIONS
    }
    single = {push: {name: shift[0] for name, shift in shifts.items()} for push, shifts in pushes.items()}
    state.views[_pose_name(stage)] = dataclasses.replace(state.views[_pose_name(stage)], pushes=single)
    return Outcome(detail=", ".join(names))


def run_lumped_modal_stage(state: RunState, stage: Stage) -> Outcome:
    """Natural modes with names, strain energy by leg and kinetic energy by component."""
    if not state.is_root:
        return Outcome()
    placed, request = _placed(state), state.scene.analyses.modal
    if request is None:
        raise ValueError("a modal stage needs a modal analysis in the scene")
    result = solve_modal(_system(state, placed), count=request.count, up_to_hz=request.up_to_hz)
    count = len(result.frequencies_hz)
    strain = tuple(_leg_shares(placed, result.shapes[:, mode]) for mode in range(count))
    kinetic = tuple(_kinetic_shares(placed, result.shapes[:, mode]) for mode in range(count))
    names = tuple(_name_mode(state, placed, result.shapes[:, mode], strain[mode], kinetic[mode]) for mode in range(count))
    state.modal.append(
        PoseModes(
            pose=state.plan.poses[_pose_name(stage)],
            pose_units=position_units(state.scene.machine),
            frequencies_hz=result.frequencies_hz,
            rigid_count=result.rigid_count,
            errors=(LUMPED,) * count,
            damping_ratio=(None,) * count,
            damped_hz=(None,) * count,
            mode_names=names,
            energy_share=strain,
            kinetic_share=kinetic,
            shapes=np.vstack([placed.body_motions[name] @ result.shapes for name in state.reduced]),
            placements=dict(placed.placements),
        )
    )
    shifts = _shift_skins(state, placed, result.shapes)
    state.views[_pose_name(stage)] = dataclasses.replace(state.views[_pose_name(stage)], shifts=shifts)
    return Outcome(detail=f"{count} modes, {result.frequencies_hz[0]:.4g} .. {result.frequencies_hz[-1]:.4g} Hz")


def run_lumped_frf_stage(state: RunState, stage: Stage) -> Outcome:
    """Frequency response at points."""
    if not state.is_root:
        return Outcome()
    placed = _placed(state)

    def name_shapes(modes: ModalResult) -> tuple[str, ...]:
        shares = [(shape, _leg_shares(placed, shape), _kinetic_shares(placed, shape)) for shape in modes.shapes.T]
        return tuple(_name_mode(state, placed, *each) for each in shares)

    return respond(state, stage, _system(state, placed), name_shapes)


def _system(state: RunState, placed: PlacedMechanism) -> SecondOrderSystem:
    points = state.scene.machine.points
    return pose_system(placed.model, placed.motions, {name: placed.motion_at(point.tool) for name, point in points.items()})


def _point_compliance(state: RunState, placed: PlacedMechanism, system: SecondOrderSystem, name: str) -> PointCompliance:
    loads = np.stack([system.inputs[name, dof] for dof in DOF_NAMES], axis=1)
    moved = solve_static(system, loads).displacements
    compliance = loads.T @ moved
    budget = {direction: spring_shares(placed, moved[:, column]) for column, direction in enumerate(DIRECTIONS)}
    softest = DIRECTIONS[int(np.argmax(np.diag(compliance)[:3]))]
    weakest, share = max(budget[softest].items(), key=lambda item: item[1])
    # the legs are in series with the tool: halving a part's compliance takes half its share away
    sentence = f"{weakest} gives {100 * share:.0f} % of the {softest} compliance; doubling its stiffness changes it by {-50 * share:+.0f} %"
    sag = None if state.plan.gravity is None else loads.T @ solve_static(system, placed.motions.gravity).displacements
    return PointCompliance(compliance, budget, sentence, sag)


def _leg_shares(placed: PlacedMechanism, shape: FloatArray) -> dict[str, float]:
    parts = spring_shares(placed, shape)
    return {leg: sum(share for part, share in parts.items() if part.startswith(f"{leg}.")) for leg in LEGS}


def _kinetic_shares(placed: PlacedMechanism, shape: FloatArray) -> dict[str, float]:
    found = {}
    for name, body in placed.superelements.items():
        motion, rotation = placed.body_motions[name] @ shape, placed.placements[name].rotation
        spin = rotation.T @ motion[3:]
        found[name] = body.mass_kg * float(motion[:3] @ motion[:3]) + float(spin @ body.inertia @ spin)
    total = sum(found.values())
    return {name: value / total for name, value in found.items()}


def _name_mode(
    state: RunState, placed: PlacedMechanism, shape: FloatArray, strain: dict[str, float], kinetic: dict[str, float]
) -> str:
    carries = _mechanism(state).carries
    by_leg = {
        leg: sum(share for name, share in kinetic.items() if carries.get(name) in (leg, f"tip_{number}"))
        for number, leg in enumerate(LEGS, 1)
    }
    on = " + ".join(leg for leg in LEGS if strain[leg] >= NAMED_SHARE)
    if sum(by_leg.values()) >= SWING_SHARE:
        swinging = " + ".join(leg for leg in LEGS if by_leg[leg] >= NAMED_SHARE)
        return f"{swinging} swings" if "+" not in swinging else f"{swinging} swing"
    mechanism, motions = placed.model.mechanism, placed.motions
    rates = motions.from_compliant @ shape
    speed = motions.kinematics.of_position[mechanism.marks.index("wrist_4")] @ rates
    own = motions.kinematics.placement.rotations[mechanism.marks.index("platform")].T @ speed
    return f"platform {PLATFORM_MOTIONS[int(np.argmax(np.abs(own)))]} on {on}"


def _shift_skins(state: RunState, placed: PlacedMechanism, shapes: FloatArray) -> dict[str, ShiftArray]:
    """Displacement ``(modes, n, 3)`` of every skin point in machine axes."""
    columns = shapes.reshape(len(shapes), -1)
    found: dict[str, ShiftArray] = {}
    for name, skin in state.skins.items():
        rotation, center = placed.placements[name].rotation, placed.superelements[name].center_of_mass
        moved = rigid_map(skin.points @ rotation.T, rotation @ center) @ placed.body_motions[name] @ columns
        found[name] = moved.T.reshape(columns.shape[1], -1, 3).astype(np.float32)
    return found


def _mechanism(state: RunState) -> SceneMechanism:
    if state.scene.mechanism is None:
        raise ValueError("the scene has no mechanism")
    return state.scene.mechanism


def _placed(state: RunState) -> PlacedMechanism:
    if state.placed is None:
        raise ValueError("an analysis needs a placed mechanism before it")
    return state.placed


def _pose_name(stage: Stage) -> str:
    if stage.pose is None:
        raise ValueError(f"a {stage.kind} stage needs a pose")
    return stage.pose
