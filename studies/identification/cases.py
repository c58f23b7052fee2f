"""One variant in one pose as a function of the parameters: modes and compliances, and their exact
derivatives.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.joints import Joint
from headstock.geometry.machine.machine import Pose, place_components
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.coupling.slopes import (
    CoupledSlopes,
    ModeSlopes,
    Selection,
    StackedPieces,
    difference_pieces,
    slope_modes,
    slope_point_compliance,
    stack_pieces,
)
from headstock.reduction.motions.body_motions import solve_machine_static
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import slope_shape, slope_squares
from headstock.solvers.linear.symmetric_modes import solve_symmetric_modes
from headstock.studies.identification.parametric_scene import ParametricScene
from headstock.studies.identification.targets import Parameter, ShapeTarget, TargetCase

RIGID_MOTIONS = 6
SPARE_MODES = 8  # computed above the targets, so that a pairing can choose
STEP = 2.0**-10  # of the difference of parts, relative to the parameter
# the same where a part is meshed anew: well above what two meshes differ by
MESHED_STEP = 2.0**-6
# reach and weight of each pair of a difference
SECOND_ORDER = ((1.0, 0.5),)
FOURTH_ORDER = ((1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))


@dataclass(frozen=True, eq=False)
class CaseModel:
    """One case of a task, ready to be computed for any parameter values.

    Attributes:
        pose: Where the axes stand.
        parameters: In the order of the columns of a Jacobian.
        observers: Points, interfaces and components whose motion its targets ask for.
    """

    case: TargetCase
    parametric: ParametricScene
    pose: Pose
    parameters: tuple[Parameter, ...]
    observers: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class CaseSlope:
    """Derivatives of a case by one parameter value.

    Attributes:
        eigenvalues: ``(m,)`` of omega^2.
        compliances: ``(c,)``.
        modes: What the parameter does to the modes.
    """

    eigenvalues: FloatArray
    compliances: FloatArray
    modes: ModeSlopes
    pieces: StackedPieces


@dataclass(frozen=True, eq=False)
class CaseState:
    """A case at given parameter values.

    Attributes:
        eigenvalues: ``(m,)`` omega^2 of the modes above the floor.
        shapes: ``(n, m)`` mass-normalised.
        below: How many modes lie below the floor.
        displacements: ``(n, 2 c)`` static motion under a unit force at the motion port and at the
            force port of each compliance.
    """

    model: CaseModel
    values: Mapping[str, float]
    coupled: CoupledMachine
    eigenvalues: FloatArray
    shapes: FloatArray
    below: int
    displacements: FloatArray

    @cached_property
    def frequencies_hz(self) -> FloatArray:
        """Natural frequencies above the floor ``(m,)``."""
        return np.sqrt(self.eigenvalues) / (2.0 * np.pi)

    @cached_property
    def motions(self) -> FloatArray:
        """Mode shapes in stacked dofs ``(n_all, m)``."""
        return self.coupled.basis @ self.shapes

    @cached_property
    def compliances(self) -> FloatArray:
        """Motion per unit force of each target ``(c,)`` [m/N]."""
        channels = [target.motion for target in self.model.case.compliances]
        rows = [self.coupled.system.outputs[name, DOF_NAMES[dof]] for name, dof in channels]
        return np.array([row @ self.displacements[:, 2 * i + 1] for i, row in enumerate(rows)])

    @cached_property
    def answers(self) -> FloatArray:
        """The static motions in stacked dofs ``(n_all, 2 c)``."""
        return self.coupled.basis @ self.displacements

    @cached_property
    def by_parameter(self) -> dict[int, CaseSlope]:
        """Derivatives by each parameter that touches the case, by its place among the parameters.

        Raises:
            HeadstockError: The parts cannot be built next to these values.
        """
        slopes = (
            (index, _slope_case(self, parameter))
            for index, parameter in enumerate(self.model.parameters)
        )
        return {index: slope for index, slope in slopes if slope is not None}

    @cached_property
    def slopes(self) -> CoupledSlopes:
        """The machine ready to be differentiated."""
        machine = self.model.parametric.build(self.values).machine
        names = self.coupled.layout.superelements
        return CoupledSlopes(
            self.coupled,
            stack_pieces(
                self.coupled.layout,
                machine,
                Selection(tuple(names), tuple(machine.joints), self.model.observers),
            ),
        )


def make_case(
    case: TargetCase, parametric: ParametricScene, pose: Pose, parameters: tuple[Parameter, ...]
) -> CaseModel:
    """A case with what has to be watched for its targets.

    Args:
        case: Targets in one pose of one variant.
        parametric: The variant as a function of the parameters.
    """
    watched = {name for target in case.modes if target.shape for name, _, _ in target.shape.entries}
    watched |= {
        channel.observer for target in case.compliances for channel in (target.motion, target.force)
    }
    return CaseModel(case, parametric, pose, parameters, tuple(sorted(watched)))


def solve_case(model: CaseModel, values: Mapping[str, float]) -> CaseState:
    """Modes above the floor and static answers of a case.

    Raises:
        HeadstockError: The machine cannot be built or computed with these values.
    """
    built = model.parametric.build(values)
    coupled = couple(built.superelements, built.machine, model.pose)
    eigenvalues, shapes, below = _solve_modes(model, coupled)
    return CaseState(
        model, dict(values), coupled, eigenvalues, shapes, below, _solve_static(model, coupled)
    )


def _slope_case(state: CaseState, parameter: Parameter) -> CaseSlope | None:
    """Derivatives of a case by a parameter's value; None where it does not touch the case."""
    pieces = _slope_pieces(state, parameter)
    if pieces is None:
        return None
    modes = slope_modes(state.slopes, pieces, state.eigenvalues, state.shapes)
    compliances = [
        slope_point_compliance(
            state.slopes,
            pieces,
            state.answers[:, 2 * i : 2 * i + 2],
            motion=target.motion,
            force=target.force,
        )
        for i, target in enumerate(state.model.case.compliances)
    ]
    return CaseSlope(
        slope_squares(state.shapes, modes.forces), np.array(compliances), modes, pieces
    )


def shape_rows(state: CaseState, shape: ShapeTarget) -> FloatArray:
    """Return the rows ``(k, n_all)`` of the motions that a shape consists of; rotations times the
    length of the machine.
    """
    observers, length = state.slopes.pieces.observers, state.coupled.layout.length
    return np.array(
        [observers[name][dof] * (length if dof > 2 else 1.0) for name, dof, _ in shape.entries]
    )


def slope_motions(state: CaseState, index: int, slopes: list[CaseSlope]) -> FloatArray:
    """Derivatives ``(n_all, p)`` of one mass-normalised mode shape in stacked dofs by ``p``
    parameters.

    Args:
        state: The case at the values where the derivatives are wanted.
        slopes: Derivatives of the case's matrices by each parameter.
    """
    forces = np.column_stack([slope.modes.forces[:, index] for slope in slopes])
    terms = np.array([slope.modes.mass_terms[index] for slope in slopes])
    system = state.coupled.system
    turned = slope_shape(
        system.stiffness,
        system.mass,
        state.eigenvalues,
        state.shapes,
        index,
        forces=forces,
        mass_terms=terms,
    )
    return state.coupled.basis @ turned + np.column_stack(
        [slope.modes.carried[:, index] for slope in slopes]
    )


def _solve_modes(model: CaseModel, coupled: CoupledMachine) -> tuple[FloatArray, FloatArray, int]:
    """Return eigenvalues and shapes above the floor, and how many modes lie below it."""
    case = model.case
    if not case.modes and case.limit is None:
        return np.zeros(0), np.zeros((coupled.basis.shape[1], 0)), 0
    wanted = case.most_modes + RIGID_MOTIONS + SPARE_MODES
    floor = (2.0 * np.pi * case.floor_hz) ** 2
    while True:
        pairs = solve_symmetric_modes(coupled.system.stiffness, coupled.system.mass, wanted=wanted)
        above = np.flatnonzero(pairs.eigenvalues > floor)
        if len(above) >= len(case.modes) + SPARE_MODES or wanted >= len(coupled.system.mass):
            break
        wanted *= 2
    if len(above) < len(case.modes):
        raise ModelError(
            f"case {case.name}: {len(case.modes)} frequencies are to be met and the model has {len(above)} above {case.floor_hz:g} Hz"
        )
    below, count = len(pairs.eigenvalues) - len(above), len(pairs.eigenvalues)
    for target in case.modes:
        if target.number is not None and not below < target.number <= count:
            raise ModelError(
                f"case {case.name}: {target.name}: the model has modes {below + 1} to {count} above {case.floor_hz:g} Hz"
            )
    return pairs.eigenvalues[above], pairs.shapes[:, above], below


def _solve_static(model: CaseModel, coupled: CoupledMachine) -> FloatArray:
    channels = [
        channel for target in model.case.compliances for channel in (target.motion, target.force)
    ]
    if not channels:
        return np.zeros((coupled.basis.shape[1], 0))
    loads = np.column_stack([coupled.system.inputs[name, DOF_NAMES[dof]] for name, dof in channels])
    return solve_machine_static(coupled, loads).displacements


def _slope_pieces(state: CaseState, parameter: Parameter) -> StackedPieces | None:
    """Derivatives of the touched parts by the parameter's value: of the small matrices, never of an
    eigenvalue.
    """
    touched = state.model.parametric.touched[parameter.name]
    if not touched.any:
        return None
    if touched.stiffness_only:
        return _slope_springs(state, parameter)
    joints = state.model.parametric.scene.machine.joints
    neighbours = [
        name for name, joint in joints.items() if _bodies_of(joint) & set(touched.components)
    ]
    watched = [
        name for name in state.model.observers if _owners(state, name) & set(touched.components)
    ]
    wanted = Selection(
        touched.components, tuple(dict.fromkeys([*touched.joints, *neighbours])), tuple(watched)
    )
    value = state.values[parameter.name]
    reached = MESHED_STEP if touched.meshed else STEP
    step = reached * (abs(value) if parameter.logarithmic else parameter.upper - parameter.lower)
    pairs = []
    curved = touched.matrices or _has_curved_levers(state.model.parametric)
    for reach, weight in FOURTH_ORDER if curved and not touched.meshed else SECOND_ORDER:
        after, before = (
            _pieces_at(state, {**state.values, parameter.name: value + side * reach * step}, wanted)
            for side in (1.0, -1.0)
        )
        pairs.append((after, before, weight / step))
    return difference_pieces(pairs)


def _has_curved_levers(parametric: ParametricScene) -> bool:
    """Tell whether carriages run on rails, or there are screws: other levers are linear in every place,
    so that one pair of a difference is exact.
    """
    return any(part.rails for part in parametric.superelements.values()) or any(
        joint.screw is not None for joint in parametric.scene.machine.joints.values()
    )


def _bodies_of(joint: Joint) -> set[str | None]:
    """Components that a joint's rows and stiffness depend on the places of."""
    shaft = joint.screw
    ends = (
        joint.ends
        if shaft is None
        else (
            *joint.ends,
            *(end for end in (shaft.floating_end, shaft.second_end) if end is not None),
        )
    )
    return {end.component for end in ends}


def _slope_springs(state: CaseState, parameter: Parameter) -> StackedPieces:
    """Derivatives of joint stiffnesses, exactly."""
    springs: dict[str, FloatArray] = {}
    for name in state.model.parametric.touched[parameter.name].joints:
        joint = state.model.parametric.joints[name]
        springs[name] = np.zeros((6, 6))
        for law in joint.stiffness_laws:
            for dof in joint.dofs(law):
                springs[name][dof, dof] = law.slope(state.values, parameter.name)
    return StackedPieces({}, {}, {}, springs, {}, {})


def _owners(state: CaseState, observer: str) -> set[str]:
    machine = state.model.parametric.scene.machine
    if observer in machine.points:
        point = machine.points[observer]
        return {end.component for end in (point.tool, point.work) if end.component is not None}
    return {observer.partition(".")[0]}


def _pieces_at(state: CaseState, values: Mapping[str, float], wanted: Selection) -> StackedPieces:
    built = state.model.parametric.build(values)
    placements = place_components(built.machine, state.model.pose)
    moved = dataclasses.replace(
        state.coupled.layout, superelements=built.superelements, placements=placements
    )
    return stack_pieces(moved, built.machine, wanted)
