"""The stage that says what rigid joints between elastic bodies leave out: their interfaces get
deformation shapes in both forms, and the small coupled machines are compared.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import CouplingKind
from headstock.pipeline.accuracy.response_changes import follow_numbers
from headstock.pipeline.answers.estimates import INTERFACE, Estimate, combine_estimates, show_share
from headstock.pipeline.answers.frf import DrivePointFigures, PoseResponse
from headstock.pipeline.answers.interfaces import InterfaceErrorsAnswer, JointShapes
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer
from headstock.pipeline.planning.interfaces import GluedJoint, find_glued_joints, give_shapes
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.frf import frequency_grid, prepare_response
from headstock.pipeline.stages.machine import CoupledPose, couple_pose
from headstock.pipeline.stages.run_state import (
    MachineParts,
    Outcome,
    ReducedComponent,
    RunState,
)
from headstock.pipeline.stages.shared_components import make_superelements
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.estimates.interface_errors import (
    FormResponse,
    bound_response_changes,
    shape_energies,
)
from headstock.reduction.estimates.model_errors import (
    WatchedModes,
    compare_modes,
    split_change,
    watch_modes,
)
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, place_motion
from headstock.reduction.superelement import Superelement
from headstock.scene.requests import FrfRequest
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.frequency_response import (
    FrfModel,
    StabilityFigures,
    evaluate_frf,
    find_peaks,
    find_stability_figures,
)
from headstock.solvers.ranks import SharedFailure, make_on_root
from headstock.solvers.second_order import Channel

STRONG: CouplingKind = "rigid"
WEAK: CouplingKind = "average"
# Shapes beside which those of a joint are compared, the first number that the meshes can tell apart:
# 40 hold every product of degree four, with which bars twist; a joint that has many, twice as many
COMPARED_SHAPES = (40, 24, 12)
MOST_SHAPES = 300
ADVISED_SHAPES = 24
WRONG = 0.01  # share of a number that is worth a warning


@dataclass(frozen=True, eq=False)
class ShapedMachines:
    """A machine whose rigid joints have deformation shapes, in both forms.

    Attributes:
        forms: Form to the machine's parts, complete on rank 0.
        joints: That have shapes.
        failures: Joint to the reason why nothing is known of it.
    """

    forms: Mapping[CouplingKind, MachineParts]
    joints: tuple[GluedJoint, ...]
    failures: Mapping[str, str]


def run_interfaces_stage(state: RunState, stage: Stage) -> Outcome:
    """Compare frequencies, compliances and responses with those of the machine whose rigid joints
    have deformation shapes; collective.

    The strong form is too stiff, the weak one too soft: what is further from a number is how far it
    may be off.
    """
    shaped = make_shaped_machines(state)
    return judge_interfaces(state, shaped) if state.is_root else Outcome()


def make_shaped_machines(state: RunState) -> ShapedMachines:
    """Superelements with deformation shapes at rigid joints, in both forms; collective.

    Args:
        state: Of the run, after its analyses.
    """
    joints = find_glued_joints(state.scene.machine, state.plan.components)
    counts = {joint.name: _choose_counts(state, joint) for joint in joints}
    failures: dict[str, str] = {}
    forms: dict[CouplingKind, MachineParts] = {}
    while joints:
        failed: dict[str, str] = {}
        for kind in (STRONG, WEAK):
            shapes = {joint: counts[joint.name][0] for joint in joints}
            forms[kind], failed = _reduce_with_shapes(state, shapes, kind)
            if not failed:
                check = functools.partial(_find_mismatches, forms[kind], joints)
                failed = make_on_root(state.comm, check)
            if failed:
                break
        if not failed:
            break
        # a mesh may tell fewer shapes apart
        failures |= {name: why for name, why in failed.items() if len(counts[name]) == 1}
        joints = [joint for joint in joints if joint.name not in failures]
        counts = {name: own[1:] if name in failed else own for name, own in counts.items()}
    return ShapedMachines(forms, tuple(joints), failures)


def _choose_counts(state: RunState, joint: GluedJoint) -> list[int]:
    """Numbers of shapes to compare a joint with, the best first."""
    own = max(
        state.plan.components[component].interfaces[interface].flexible
        for component, interface in joint.ends
    )
    counts = [min(MOST_SHAPES, max(count, 2 * own)) for count in COMPARED_SHAPES]
    return list(dict.fromkeys(counts))


def _reduce_with_shapes(
    state: RunState, shapes: Mapping[GluedJoint, int], kind: CouplingKind
) -> tuple[MachineParts, dict[str, str]]:
    """The machine with shapes at some joints, and joints with a component that cannot have them;
    collective.
    """
    interfaces: dict[str, dict[str, int]] = {}
    for joint, count in shapes.items():
        for component, interface in joint.ends:
            interfaces.setdefault(component, {})[interface] = count
    components = dict(state.plan.components)
    for name, own in interfaces.items():
        components[name] = give_shapes(components[name], own, kind)
    plan = dataclasses.replace(state.plan, components=components)
    reduced: dict[str, ReducedComponent] = dict(state.reduced)
    failed: dict[str, str] = {}
    for name in interfaces:
        other = dataclasses.replace(state, plan=plan, meshes={}, reduced=dict(state.reduced))
        try:
            make_superelements(other, only=[name])
        except (HeadstockError, SharedFailure) as error:
            # only rank 0 reports the reason
            bodies = {joint.name: [body for body, _ in joint.ends] for joint in shapes}
            failed |= {joint: str(error) for joint, own in bodies.items() if name in own}
            continue
        if state.is_root:
            reduced[name] = other.reduced[name]
    return MachineParts(state.scene, plan, reduced), failed


def _find_mismatches(parts: MachineParts, joints: list[GluedJoint]) -> dict[str, str]:
    """Joints between interfaces that cannot share shapes, with the reason."""
    found: dict[str, str] = {}
    (pose, *_) = parts.plan.poses.values()
    machine = parts.scene.machine
    for joint in joints:
        maps = [
            parts.superelements[component].interface_maps[name] for component, name in joint.ends
        ]
        if any(entry.shapes is None for entry in maps):
            found[joint.name] = "an interface shares points with another one"
            continue
        alone = dataclasses.replace(machine, joints={joint.name: machine.joints[joint.name]})
        try:
            couple(parts.superelements, alone, pose)
        except ModelError as error:
            found[joint.name] = str(error)
    return found


@dataclass(eq=False)
class _Machines:
    """The machine itself and with shapes, in every pose, coupled once each."""

    parts: MachineParts
    shaped: ShapedMachines
    posed: dict[tuple[CouplingKind | None, str], CoupledPose] = field(default_factory=dict)

    def at(self, kind: CouplingKind | None, pose: Pose) -> CoupledPose:
        """With shapes in a form, or without any for None, in a pose."""
        if (kind, pose.name) not in self.posed:
            parts = self.parts if kind is None else self.shaped.forms[kind]
            self.posed[kind, pose.name] = couple_pose(parts, pose)
        return self.posed[kind, pose.name]

    @cached_property
    def places(self) -> dict[str, BodyPlaces]:
        """Points that stand for the mass of each body."""
        return {name: choose_places(part) for name, part in self.parts.superelements.items()}

    @cached_property
    def _plain_motions(self) -> dict[str, FloatArray]:
        return self._move(self.parts.superelements)

    def _move(self, elements: Mapping[str, Superelement]) -> dict[str, FloatArray]:
        return {
            name: place_motion(elements[name], chosen.points)
            for name, chosen in self.places.items()
        }

    def watch(self, kind: CouplingKind | None, pose: Pose, count: int) -> WatchedModes:
        """Modes of one of the machines."""
        motions = (
            self._plain_motions
            if kind is None
            else self._move(self.shaped.forms[kind].superelements)
        )
        return watch_modes(self.at(kind, pose).coupled, self.places, motions, count=count)

    def split(self, pose: Pose, motions: FloatArray, size: float) -> dict[str, float]:
        """Parts of a bound by joint, as their shapes hold energy in motions ``(n, m)`` of the
        machine in the strong form, all together.
        """
        machine = self.parts.scene.machine
        joints = {joint.name: machine.joints[joint.name] for joint in self.shaped.joints}
        energies = shape_energies(self.at(STRONG, pose).coupled, joints, motions)
        return split_change(size, {name: float(energy.sum()) for name, energy in energies.items()})


def judge_interfaces(state: RunState, shaped: ShapedMachines) -> Outcome:
    """Put what shapes change into the ± of the frequencies, compliances and responses of a run; on
    rank 0.
    """
    machines = _Machines(state.parts, shaped)
    shares: dict[str, dict[str, float]] = {}
    lines: dict[str, dict[str, float]] = {}
    lost: list[str] = []
    several = len(state.plan.poses) > 1
    for place, answer in enumerate(state.answers if shaped.joints else ()):
        if isinstance(answer, PoseModes):
            words = f" in pose {answer.pose.name}" if several else ""
            state.answers[place] = _judge_modes(machines, answer, shares, lost, words)
        elif isinstance(answer, StaticAnswer):
            words = f" in pose {answer.pose}" if several else ""
            state.answers[place] = _judge_compliances(machines, answer, shares, words)
        elif isinstance(answer, PoseResponse):
            words = f" in pose {answer.curves.pose}" if several else ""
            judged = _judge_response(machines, answer, lines, words)
            state.answers[place] = _judge_numbers(machines, judged, shares, words)
    found = InterfaceErrorsAnswer(
        {joint.name: _describe(machines, joint) for joint in shaped.joints},
        shares,
        lines,
        dict(shaped.failures),
    )
    largest = max((sum(parts.values()) for parts in (shares or lines).values()), default=0.0)
    return Outcome(
        detail=f"shapes at {', '.join(joint.name for joint in shaped.joints) or 'no joint'} change "
        f"{'numbers' if shares else 'lines'} by up to {show_share(largest)}",
        answers=(found,),
        warnings=(
            *_warn_of_joints(machines, found),
            *_warn_of_lost(lost),
            *_warn_of_failures(shaped),
        ),
    )


def _judge_modes(
    machines: _Machines,
    answer: PoseModes,
    shares: dict[str, dict[str, float]],
    lost: list[str],
    words: str,
) -> PoseModes:
    count = answer.below + len(answer.frequencies_hz)
    plain = machines.watch(None, answer.pose, count)
    better = {kind: machines.watch(kind, answer.pose, count) for kind in (STRONG, WEAK)}
    found = {kind: compare_modes(plain, modes, count=count) for kind, modes in better.items()}
    errors = list(answer.errors)
    damped, ratios = list(answer.damped_error_hz), list(answer.damping_error)
    for mode in range(answer.rigid_count, len(answer.frequencies_hz)):
        number = answer.below + mode
        hz = float(answer.frequencies_hz[mode])
        changes = {kind: float(each.changes_hz[number]) for kind, each in found.items()}
        if np.isnan(list(changes.values())).any():
            own, size = Estimate({INTERFACE: None}), None
            lost.append(f"{number + 1} ({hz:.4g} Hz){words}")
        else:
            size = float(np.abs(list(changes.values())).max())
            partner = found[STRONG].partners[number]
            shape = better[STRONG].modes.shapes[:, [partner]]
            parts = machines.split(answer.pose, shape, size)
            own = Estimate({INTERFACE: size}, (), {INTERFACE: parts})
            shares[f"frequency {number + 1} ({hz:.4g} Hz){words}"] = {
                name: part / hz for name, part in parts.items()
            }
        errors[mode] = combine_estimates([errors[mode], own])
        if mode < len(damped):
            known = damped[mode]
            damped[mode] = None if known is None or size is None else known + size
        if mode < len(ratios) and ratios[mode]:
            # nothing is known of a damping ratio with other interfaces
            ratios[mode] = None
    return dataclasses.replace(
        answer,
        errors=tuple(errors),
        damped_error_hz=tuple(damped),
        damping_error=tuple(ratios),
    )


def _judge_compliances(
    machines: _Machines,
    answer: StaticAnswer,
    shares: dict[str, dict[str, float]],
    words: str,
) -> StaticAnswer:
    pose = machines.parts.plan.poses[answer.pose]
    points: dict[str, PointCompliance] = {}
    for name, point in answer.points.items():
        better = {
            kind: machines.at(kind, pose).solve_point(name).answer.compliance
            for kind in (STRONG, WEAK)
        }
        errors = dict(point.errors)
        for axis, direction in enumerate(DIRECTIONS):
            value = float(point.compliance[axis, axis])
            changes = {kind: float(own[axis, axis]) - value for kind, own in better.items()}
            if np.isnan(list(changes.values())).any() or value <= 0.0:
                continue
            size = float(np.abs(list(changes.values())).max())
            motion = machines.at(STRONG, pose).push((name, direction))
            parts = machines.split(pose, motion[:, None], size)
            shares[f"{direction} compliance at {name}{words}"] = {
                joint: part / value for joint, part in parts.items()
            }
            errors[direction] = combine_estimates(
                [
                    errors.get(direction, Estimate()),
                    Estimate({INTERFACE: size}, (), {INTERFACE: parts}),
                ]
            )
        points[name] = dataclasses.replace(point, errors=errors)
    return dataclasses.replace(answer, points=points)


@dataclass(frozen=True, eq=False)
class _Responses:
    """The response of a machine in one form, and what it says about cutting."""

    model: FrfModel
    form: FormResponse
    figures: Mapping[Channel, StabilityFigures]


def _judge_response(
    machines: _Machines, answer: PoseResponse, lines: dict[str, dict[str, float]], words: str
) -> PoseResponse:
    """A response with what shapes change in the ± of its lines and of its most negative real
    parts; adds the line that changes most, over its largest entry.
    """
    curves = answer.curves
    pose = machines.parts.plan.poses[curves.pose]
    found = {kind: _respond(machines.at(kind, pose), answer) for kind in (STRONG, WEAK)}
    change = bound_response_changes(
        curves.receptance, curves.frequencies_hz, [each.form for each in found.values()]
    )
    largest = np.abs(curves.receptance).max(axis=(1, 2))
    shares = change.max(axis=(1, 2)) / np.where(largest > 0.0, largest, np.inf)
    # at rest the compliance says it
    shares = np.where(curves.frequencies_hz > 0.0, shares, np.nan)
    if np.isfinite(shares).any():
        line = int(np.nanargmax(shares))
        omega = 2.0 * np.pi * float(curves.frequencies_hz[line])
        channel = int(np.unravel_index(change[line].argmax(), change[line].shape)[1])
        motion = found[STRONG].model.direct.displacements(omega)[:, channel]
        parts = machines.split(
            pose, np.stack([motion.real, motion.imag], axis=1), float(shares[line])
        )
        at = f"the frequency response at {curves.frequencies_hz[line]:.4g} Hz{words}"
        lines[at] = {name: part for name, part in parts.items() if np.isfinite(part)}
    return dataclasses.replace(
        answer,
        curves=dataclasses.replace(curves, error_share={**curves.error_share, INTERFACE: change}),
        figures=tuple(_judge_figures(own, list(found.values())) for own in answer.figures),
    )


def _judge_numbers(
    machines: _Machines, answer: PoseResponse, shares: dict[str, dict[str, float]], words: str
) -> PoseResponse:
    """A response with what shapes change in the ± of its peaks and levels; adds to the shares."""
    if not answer.numbers:
        return answer
    pose = machines.parts.plan.poses[answer.curves.pose]
    count = max((own.mode for own in answer.numbers), default=-1) + 1
    plain = machines.watch(None, pose, count)
    better = {kind: machines.watch(kind, pose, count) for kind in (STRONG, WEAK)}
    moved = {
        kind: follow_numbers(answer.numbers, machines.at(kind, pose), plain, modes)
        for kind, modes in better.items()
    }
    numbers = []
    for own, *others in zip(answer.numbers, *moved.values(), strict=True):
        size = max(abs(other.size - own.size) for other in others)
        if np.isnan([other.size for other in others]).any():
            error = Estimate({INTERFACE: None})
        else:
            shape = (
                better[STRONG].modes.shapes[:, [others[0].mode]]
                if own.kind == "peak"
                else machines.at(STRONG, pose).push(own.output)[:, None]
            )
            parts = machines.split(pose, shape, size)
            error = Estimate({INTERFACE: size}, (), {INTERFACE: parts})
            shares[f"{own.name}{words}"] = {name: part / own.size for name, part in parts.items()}
        numbers.append(dataclasses.replace(own, error=combine_estimates([own.error, error])))
    return dataclasses.replace(answer, numbers=tuple(numbers))


def _respond(model: CoupledPose, answer: PoseResponse) -> _Responses:
    """The response of a machine at the lines of an answer, on its own peaks and around them."""
    request = model.parts.scene.analyses.get(FrfRequest)
    if request is None:
        raise ValueError("a frequency response needs an analysis in the scene")
    lines, prepared = answer.curves.frequencies_hz, prepare_response(model)
    natural = model.all_modes.frequencies_hz
    peaks = natural[natural <= request.to_hz]
    grid = frequency_grid(request, find_peaks(prepared, request.to_hz))
    whole = evaluate_frf(prepared, np.unique(np.concatenate([lines, grid, peaks])))
    at_lines, at_peaks = (
        whole.receptance[np.searchsorted(whole.frequencies_hz, own)] for own in (lines, peaks)
    )
    bounded = any(own.most_negative_real is not None for own in answer.figures)
    figures = find_stability_figures(prepared, whole) if bounded else ()
    return _Responses(
        prepared,
        FormResponse(at_lines, peaks, at_peaks),
        {own.channel: own for own in figures},
    )


def _judge_figures(own: DrivePointFigures, responses: Sequence[_Responses]) -> DrivePointFigures:
    """The figures of a drive point with what shapes change of the most negative real part."""
    if own.most_negative_real is None or own.most_negative_real_error is None:
        return own
    depths = [
        figures.most_negative_real
        for each in responses
        if (figures := each.figures.get(own.channel)) is not None
    ]
    known = [depth for depth in depths if depth is not None]
    if len(known) < len(responses):
        return dataclasses.replace(
            own, most_negative_real_error=None, most_negative_real_error_share={}
        )
    size = max(abs(depth - own.most_negative_real) for depth in known)
    return dataclasses.replace(
        own,
        most_negative_real_error=own.most_negative_real_error + size,
        most_negative_real_error_share={**own.most_negative_real_error_share, INTERFACE: size},
    )


def _describe(machines: _Machines, joint: GluedJoint) -> JointShapes:
    """The shapes of a joint, as it is and as it was compared."""
    (component, interface), _ = joint.ends
    entries = [
        parts.superelements[component].interface_maps[interface].shapes
        for parts in (machines.parts, machines.shaped.forms[STRONG])
    ]
    own, compared = (0 if entry is None else entry.count for entry in entries)
    return JointShapes(str(joint), own, compared)


def _warn_of_joints(machines: _Machines, found: InterfaceErrorsAnswer) -> list[str]:
    """A warning for every joint whose own part of a number is large, with the worst number."""
    warnings = []
    for joint in machines.shaped.joints:
        number, share = found.largest(joint.name)
        if share < WRONG:
            continue
        own = found.joints[joint.name].shapes
        what = f"{own} deformation shapes are" if own else "six motions of each are"
        warnings.append(
            f"joint {joint.name}: {what} too few for {joint}: {number} may be off by {show_share(share)}; write"
            f" coupling = {{ flexible = {max(ADVISED_SHAPES, 2 * own)} }} for both"
        )
    return warnings


def _warn_of_lost(lost: list[str]) -> list[str]:
    if not lost:
        return []
    return [
        f"frequency {', '.join(lost)} has no mode of its shape where rigid joints have deformation shapes"
    ]


def _warn_of_failures(shaped: ShapedMachines) -> list[str]:
    return [
        f"what joint {name} leaves out is not known: {reason}"
        for name, reason in shaped.failures.items()
    ]
