"""The stage that estimates the error of rigid joints between elastic bodies: their interfaces get
deformation shapes in both forms, and the small coupled machines are compared.
"""

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import CouplingKind
from headstock.pipeline.accuracy.followed import (
    FOLLOWED,
    MachineFamily,
    follow_numbers,
    list_followed,
    put_errors,
)
from headstock.pipeline.answers.accuracy import InterfaceErrorsAnswer, JointShapes
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.numbers.changes import compare_numbers, to_errors
from headstock.pipeline.numbers.estimates import INTERFACE, Estimate, show_share
from headstock.pipeline.numbers.numbers import Key, Number, make_key
from headstock.pipeline.planning.interfaces import GluedJoint, find_glued_joints, give_shapes
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.frf import frequency_grid, prepare_response
from headstock.pipeline.stages.machine import CoupledPose
from headstock.pipeline.stages.run_state import (
    MachineParts,
    Outcome,
    ReducedComponent,
    RunState,
)
from headstock.pipeline.stages.shared_components import make_superelements
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.estimates.model_errors import (
    FormResponse,
    bound_response_changes,
    shape_energies,
    split_change,
)
from headstock.scene.analyses.frf import FrfRequest
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
# Shapes to compare those of a joint with, the first number that the meshes can resolve:
# 40 hold every product of degree four, with which bars twist; a joint that has many, twice as many
COMPARED_SHAPES = (40, 24, 12)
MOST_SHAPES = 300
ADVISED_SHAPES = 24
WRONG = 0.01  # relative error of a number that causes a warning


@dataclass(frozen=True, eq=False)
class _ShapedMachines:
    """Store a machine whose rigid joints have deformation shapes, in both forms.

    Attributes:
        forms: Form to the machine's parts, complete on rank 0.
        failures: Joint to the reason why its error is unknown.
    """

    forms: Mapping[CouplingKind, MachineParts]
    joints: tuple[GluedJoint, ...]
    failures: Mapping[str, str]


def run_interfaces_stage(state: RunState, stage: Stage) -> Outcome:
    """Compare frequencies, compliances and responses with those of the machine whose rigid joints
    have deformation shapes; collective.

    The strong form is too stiff, the weak one too soft: the larger of the two differences is the
    possible error of a number.
    """
    shaped = make_shaped_machines(state)
    return estimate_interfaces(state, shaped) if state.is_root else Outcome()


def make_shaped_machines(state: RunState) -> _ShapedMachines:
    """Reduce superelements with deformation shapes at rigid joints, in both forms; collective.

    Args:
        state: State of the run, after its analyses.
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
        # a mesh may resolve fewer shapes
        failures |= {name: why for name, why in failed.items() if len(counts[name]) == 1}
        joints = [joint for joint in joints if joint.name not in failures]
        counts = {name: own[1:] if name in failed else own for name, own in counts.items()}
    return _ShapedMachines(forms, tuple(joints), failures)


def _choose_counts(state: RunState, joint: GluedJoint) -> list[int]:
    """Return the numbers of shapes to compare a joint with, the best first."""
    own = max(
        state.plan.components[component].interfaces[interface].flexible
        for component, interface in joint.ends
    )
    counts = [min(MOST_SHAPES, max(count, 2 * own)) for count in COMPARED_SHAPES]
    return list(dict.fromkeys(counts))


def _reduce_with_shapes(
    state: RunState, shapes: Mapping[GluedJoint, int], kind: CouplingKind
) -> tuple[MachineParts, dict[str, str]]:
    """Return the machine with shapes at some joints, and the joints with a component that cannot
    have them; collective.
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
    """Find the joints between interfaces that cannot share shapes, with the reason."""
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


class _ShapedFamily(MachineFamily):
    """Compare the machine with the same machine with shapes in both forms."""

    def __init__(self, parts: MachineParts, shaped: _ShapedMachines) -> None:
        super().__init__(parts)
        self.joints = shaped.joints
        self.forms = {kind: self.change(own) for kind, own in shaped.forms.items()}

    def split(self, pose: str, motions: FloatArray, size: float) -> dict[str, float]:
        """Divide a bound among joints, by the energy of their shapes in motions ``(n, m)`` of the
        machine in the strong form.
        """
        machine = self.base.parts.scene.machine
        joints = {joint.name: machine.joints[joint.name] for joint in self.joints}
        energies = shape_energies(self.forms[STRONG].at(pose).coupled, joints, motions)
        return split_change(size, {name: float(energy.sum()) for name, energy in energies.items()})


def estimate_interfaces(state: RunState, shaped: _ShapedMachines) -> Outcome:
    """Add the changes by shapes to the ± of the frequencies, compliances and responses of a run; on
    rank 0.
    """
    family = _ShapedFamily(state.parts, shaped)
    shares: dict[Key, dict[str, float]] = {}
    lines: dict[Key, dict[str, float]] = {}
    lost: list[str] = []
    names: dict[Key, str] = {}
    several = len(state.plan.poses) > 1
    for index, answer in enumerate(state.answers if shaped.joints else ()):
        if not isinstance(answer, FOLLOWED):
            continue
        base = list_followed(answer)
        errors = _compare_forms(family, answer, base)
        names |= {number.key: number.describe(several_poses=several) for number in base}
        shares |= _relative_parts(base, errors)
        if isinstance(answer, PoseModes):
            lost += [names[number.key] for number in base if number.key not in shares]
        if isinstance(answer, PoseResponse):
            answer, worst = _compare_lines(family, answer)
            lines |= worst
        state.answers[index] = put_errors(answer, errors, INTERFACE, "add")
    found = InterfaceErrorsAnswer(
        {joint.name: _describe(family, joint) for joint in shaped.joints},
        shares,
        lines,
        dict(shaped.failures),
    )
    largest = max((sum(parts.values()) for parts in (shares or lines).values()), default=0.0)
    return Outcome(
        detail=f"shapes at {', '.join(joint.name for joint in shaped.joints) or 'no joint'} change "
        f"{'numbers' if shares else 'lines'} by up to {show_share(largest)}",
        answers=(found,),
        warnings=tuple(_list_warnings(shaped, found, names, lost, several=several)),
    )


def _relative_parts(
    base: Sequence[Number], errors: Mapping[Key, Estimate]
) -> dict[Key, dict[str, float]]:
    """Return the part of each joint in ± over the number; nothing for lost numbers."""
    return {
        number.key: {
            joint: part / number.value
            for joint, part in errors[number.key].parts[INTERFACE].items()
        }
        for number in base
        if errors[number.key].total is not None
    }


def _compare_forms(
    family: _ShapedFamily, answer: Answer, base: Sequence[Number]
) -> dict[Key, Estimate]:
    """Return the part of shapes in ± of numbers: the larger change of both forms, by joint."""
    moved = {kind: follow_numbers(answer, family.base, own) for kind, own in family.forms.items()}
    moves = {
        (str(kind), INTERFACE): compare_numbers(base, own.numbers) for kind, own in moved.items()
    }

    def split(key: Key, size: float) -> dict[str, float]:
        return family.split(str(key["pose"]), moved[STRONG].motion(key), size)

    return to_errors(base, moves, join="largest", split=split)


@dataclass(frozen=True, eq=False)
class _Responses:
    """Store the response of a machine in one form, and its figures for chatter."""

    model: FrfModel
    form: FormResponse
    figures: Mapping[Channel, StabilityFigures]


def _compare_lines(
    family: _ShapedFamily, answer: PoseResponse
) -> tuple[PoseResponse, dict[Key, dict[str, float]]]:
    """Return a response with the changes by shapes in the ± of its lines and of its most negative
    real parts; and the part of each joint at the line that changes most, relative to the largest
    entry of the line.
    """
    curves, pose = answer.curves, answer.curves.pose
    found = {kind: _respond(own.at(pose), answer) for kind, own in family.forms.items()}
    change = bound_response_changes(
        curves.receptance, curves.frequencies_hz, [each.form for each in found.values()]
    )
    largest = np.abs(curves.receptance).max(axis=(1, 2))
    shares = change.max(axis=(1, 2)) / np.where(largest > 0.0, largest, np.inf)
    # at rest the compliance is compared instead
    shares = np.where(curves.frequencies_hz > 0.0, shares, np.nan)
    worst: dict[Key, dict[str, float]] = {}
    if np.isfinite(shares).any():
        line = int(np.nanargmax(shares))
        omega = 2.0 * np.pi * float(curves.frequencies_hz[line])
        channel = int(np.unravel_index(change[line].argmax(), change[line].shape)[1])
        motion = found[STRONG].model.direct.displacements(omega)[:, channel]
        parts = family.split(
            pose, np.stack([motion.real, motion.imag], axis=1), float(shares[line])
        )
        key = make_key("response_line", pose=pose, line=f"{curves.frequencies_hz[line]:.4g} Hz")
        worst[key] = {name: part for name, part in parts.items() if np.isfinite(part)}
    curves = dataclasses.replace(curves, error_share={**curves.error_share, INTERFACE: change})
    depths = _compare_depths(answer, list(found.values()))
    return dataclasses.replace(answer, curves=curves).with_errors(depths, "add"), worst


def _respond(model: CoupledPose, answer: PoseResponse) -> _Responses:
    """Compute the response of a machine at an answer's lines, and around its own peaks."""
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


def _compare_depths(answer: PoseResponse, responses: Sequence[_Responses]) -> dict[Key, Estimate]:
    """Return the changes by shapes of the most negative real parts that have a ±."""
    errors: dict[Key, Estimate] = {}
    for own in answer.figures:
        key = answer.figure_key(own.channel)
        if own.most_negative_real is None or key not in answer.errors:
            continue
        depths = [
            figures.most_negative_real
            for each in responses
            if (figures := each.figures.get(own.channel)) is not None
        ]
        sizes = [abs(depth - own.most_negative_real) for depth in depths if depth is not None]
        size = max(sizes) if len(sizes) == len(responses) else None
        errors[key] = Estimate({INTERFACE: size})
    return errors


def _describe(family: _ShapedFamily, joint: GluedJoint) -> JointShapes:
    """Describe the shapes of a joint, in the scene and in the comparison."""
    (component, interface), _ = joint.ends
    entries = [
        parts.superelements[component].interface_maps[interface].shapes
        for parts in (family.base.parts, family.forms[STRONG].parts)
    ]
    own, compared = (0 if entry is None else entry.count for entry in entries)
    return JointShapes(str(joint), own, compared)


def _list_warnings(
    shaped: _ShapedMachines,
    found: InterfaceErrorsAnswer,
    names: Mapping[Key, str],
    lost: Sequence[str],
    *,
    several: bool,
) -> Iterator[str]:
    """Yield a warning for every joint with a large part of a number, with the worst number; for
    modes that lose their shape; and for joints whose error is unknown.
    """
    for joint in shaped.joints:
        number, share = found.largest(joint.name)
        if number is None or share < WRONG:
            continue
        own = found.joints[joint.name].shapes
        what = f"{own} deformation shapes are" if own else "six motions of each are"
        words = names.get(number) or f"the {number.describe(several_poses=several)}"
        yield (
            f"joint {joint.name}: {what} too few for {joint}: {words} may be off by {show_share(share)}; write"
            f" coupling = {{ flexible = {max(ADVISED_SHAPES, 2 * own)} }} for both"
        )
    if lost:
        yield (
            f"{', '.join(lost)} has no mode of its shape where rigid joints have deformation shapes"
        )
    for name, reason in shaped.failures.items():
        yield f"what joint {name} leaves out is not known: {reason}"
