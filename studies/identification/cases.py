"""One variant in one pose as a function of the parameters: modes with their damping, compliances and
responses, and their exact derivatives.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.joints import Joint
from headstock.geometry.machine.machine import Pose, place_components
from headstock.pipeline.stages.machine import damp_system
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.coupling.slopes import (
    CoupledSlopes,
    ModeSlopes,
    ObservedDof,
    Selection,
    StackedPieces,
    difference_pieces,
    slope_modes,
    slope_pole,
    slope_receptances,
    stack_pieces,
)
from headstock.reduction.motions.body_motions import solve_machine_static
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damped_mode import (
    DampedMode,
    follow_damped_mode,
    slope_damped_shape,
)
from headstock.solvers.linear.modal_analysis import slope_shape, slope_squares
from headstock.solvers.linear.symmetric_modes import solve_symmetric_modes
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem
from headstock.studies.identification.parametric_scene import ParametricScene
from headstock.studies.identification.targets import Parameter, ShapeTarget, TargetCase

RIGID_MOTIONS = 6
AT_REST = (0.0,)  # frequencies of a static compliance
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
        modes: What the parameter does to the modes.
    """

    eigenvalues: FloatArray
    modes: ModeSlopes
    pieces: StackedPieces


@dataclass(frozen=True, eq=False)
class CaseState:
    """A case at given parameter values.

    Attributes:
        eigenvalues: ``(m,)`` omega^2 of the modes above the floor.
        shapes: ``(n, m)`` mass-normalised.
        below: How many modes lie below the floor.
    """

    model: CaseModel
    values: Mapping[str, float]
    coupled: CoupledMachine
    eigenvalues: FloatArray
    shapes: FloatArray
    below: int
    _answers: dict[tuple[float, ...], ComplexArray] = field(default_factory=dict)
    _response_slopes: dict[tuple[CaseSlope, tuple[float, ...]], ComplexArray] = field(
        default_factory=dict
    )
    _damped: dict[int, DampedMode] = field(default_factory=dict)

    @cached_property
    def frequencies_hz(self) -> FloatArray:
        """Natural frequencies above the floor ``(m,)``."""
        return np.sqrt(self.eigenvalues) / (2.0 * np.pi)

    @cached_property
    def motions(self) -> FloatArray:
        """Mode shapes in stacked dofs ``(n_all, m)``."""
        return self.coupled.basis @ self.shapes

    @cached_property
    def system(self) -> SecondOrderSystem:
        """The equations of motion with the damping of the scene."""
        return damp_system(self.model.parametric.scene, self.coupled.system)

    def damped_mode(self, mode: int) -> DampedMode:
        """Return what a mode becomes with damping.

        Raises:
            ConvergenceError: It is damped too strongly.
        """
        if mode not in self._damped:
            omega = float(np.sqrt(self.eigenvalues[mode]))
            self._damped[mode] = follow_damped_mode(self.system, omega, self.shapes[:, mode])
        return self._damped[mode]

    def motion(self, mode: int, shape: ShapeTarget) -> FloatArray | ComplexArray:
        """Return a mode in stacked dofs ``(n_all,)``: damped where a shape asks for it."""
        if not self._is_damped_for(shape):
            return self.motions[:, mode]
        return self.coupled.basis @ self.damped_mode(mode).shape

    def slope_motions(
        self, mode: int, shape: ShapeTarget, slopes: list[CaseSlope]
    ) -> FloatArray | ComplexArray:
        """Return the derivatives ``(n_all, p)`` of what ``motion`` returns, up to a factor of it."""
        if not self._is_damped_for(shape):
            return slope_motions(self, mode, slopes)
        return _slope_damped_motions(self, mode, slopes)

    def _is_damped_for(self, shape: ShapeTarget) -> bool:
        system = self.system
        damped = system.damping is not None or system.hysteretic is not None
        return shape.is_complex and damped

    def slope_damping(self, mode: int, slope: CaseSlope) -> float:
        """Return the derivative of the damping ratio of a mode."""
        damped = self.damped_mode(mode)
        motion = self.coupled.basis @ damped.shape
        return damped.slope_ratio(slope_pole(self.slopes, slope.pieces, motion, damped.pole))

    def receptances(
        self, motion: ObservedDof, force: ObservedDof, frequencies_hz: Sequence[float]
    ) -> ComplexArray:
        """Return the motion per unit force at frequencies ``(l,)`` [m/N]; at rest for zero [Hz].

        Raises:
            ModelError: At rest a free motion leaves it undetermined.
        """
        name, dof = motion
        row, column = self.coupled.system.outputs[name, DOF_NAMES[dof]], self._channels[force]
        return np.asarray(row @ self._answer(tuple(frequencies_hz))[:, column])

    def slope_receptances(
        self,
        motion: ObservedDof,
        force: ObservedDof,
        frequencies_hz: Sequence[float],
        slope: CaseSlope,
    ) -> ComplexArray:
        """Return the derivatives of what ``receptances`` returns."""
        lines = tuple(frequencies_hz)
        motions, forces = self._ends
        if (slope, lines) not in self._response_slopes:
            # of all pairs at once: most of the work is done once per force
            by_motion, by_force = (
                self._answer(lines)[:, [self._channels[end] for end in ends]] for ends in self._ends
            )
            self._response_slopes[slope, lines] = slope_receptances(
                self.slopes,
                slope.pieces,
                by_motion,
                by_force,
                2j * np.pi * np.array(lines),
                motions=list(motions),
                forces=list(forces),
            )
        return self._response_slopes[slope, lines][motions[motion], forces[force]]

    @property
    def compliances(self) -> FloatArray:
        """Motion per unit force of each target ``(c,)`` [m/N]."""
        targets = self.model.case.compliances
        pairs = [self.receptances(item.motion, item.force, AT_REST)[0] for item in targets]
        return np.real(pairs)

    @cached_property
    def _ends(self) -> tuple[dict[ObservedDof, int], dict[ObservedDof, int]]:
        """Every motion and every force of compliances and responses, with its place among them."""
        motions, forces = zip(*self.model.case.ends, strict=True)
        return _number(motions), _number(forces)

    @cached_property
    def _channels(self) -> dict[ObservedDof, int]:
        """Columns of the answers by channel."""
        return _number(end for pair in self.model.case.ends for end in pair)

    def _answer(self, frequencies_hz: tuple[float, ...]) -> ComplexArray:
        """Return the motions ``(n, c, l)`` under a unit force in each channel at frequencies."""
        if frequencies_hz not in self._answers:
            inputs = self.coupled.system.inputs
            loads = np.column_stack([inputs[name, DOF_NAMES[dof]] for name, dof in self._channels])
            answers = np.empty((*loads.shape, len(frequencies_hz)), dtype=np.complex128)
            for line, hz in enumerate(frequencies_hz):
                if hz == 0.0:
                    answers[..., line] = solve_machine_static(self.coupled, loads).displacements
                else:
                    dynamic = self.system.dynamic_stiffness(2j * np.pi * hz)
                    answers[..., line] = np.linalg.solve(dynamic, loads)
            self._answers[frequencies_hz] = answers
        return self._answers[frequencies_hz]

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


def _number(ends: Iterable[ObservedDof]) -> dict[ObservedDof, int]:
    """Return every channel with its number, in the order in which they come first."""
    return {end: number for number, end in enumerate(dict.fromkeys(ends))}


def make_case(
    case: TargetCase, parametric: ParametricScene, pose: Pose, parameters: tuple[Parameter, ...]
) -> CaseModel:
    """A case with what has to be watched for its targets.

    Args:
        case: Targets in one pose of one variant.
        parametric: The variant as a function of the parameters.
    """
    watched = {name for target in case.modes if target.shape for name, _, _ in target.shape.entries}
    watched |= {channel.observer for pair in case.ends for channel in pair}
    return CaseModel(case, parametric, pose, parameters, tuple(sorted(watched)))


def solve_case(model: CaseModel, values: Mapping[str, float]) -> CaseState:
    """Modes above the floor and static answers of a case.

    Raises:
        HeadstockError: The machine cannot be built or computed with these values.
    """
    built = model.parametric.build(values)
    coupled = couple(built.superelements, built.machine, model.pose)
    eigenvalues, shapes, below = _solve_modes(model, coupled)
    return CaseState(model, dict(values), coupled, eigenvalues, shapes, below)


def _slope_case(state: CaseState, parameter: Parameter) -> CaseSlope | None:
    """Derivatives of a case by a parameter's value; None where it does not touch the case."""
    pieces = _slope_pieces(state, parameter)
    if pieces is None:
        return None
    modes = slope_modes(state.slopes, pieces, state.eigenvalues, state.shapes)
    return CaseSlope(slope_squares(state.shapes, modes.forces), modes, pieces)


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


def _slope_damped_motions(state: CaseState, mode: int, slopes: list[CaseSlope]) -> ComplexArray:
    """Return the derivatives ``(n_all, p)`` of one damped mode in stacked dofs, up to a multiple of the
    mode itself.
    """
    machine, damped, basis = state.slopes, state.damped_mode(mode), state.coupled.basis
    poles, motion = np.array([damped.pole]), (basis @ damped.shape)[:, None]
    forces = np.zeros((basis.shape[1], len(slopes)), dtype=np.complex128)
    total = np.zeros((len(basis), len(slopes)), dtype=np.complex128)
    for column, slope in enumerate(slopes):
        stacked = machine.dynamic_changes(slope.pieces, motion, poles)
        carried = machine.carried_motions(slope.pieces, motion)
        if carried is not None:
            total[:, column] = carried[:, 0]
            stacked = stacked + machine.dynamic_times(carried, poles)
            reactions = machine.dynamic_times(motion, poles)
            forces[:, column] = machine.carried_forces(slope.pieces, reactions)[:, 0]
        forces[:, column] += basis.T @ stacked[:, 0]
    return total + basis @ slope_damped_shape(state.system, damped, forces)


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


def _slope_pieces(state: CaseState, parameter: Parameter) -> StackedPieces | None:
    """Derivatives of the touched parts by the parameter's value: of the small matrices, never of an
    eigenvalue.
    """
    touched = state.model.parametric.touched[parameter.name]
    if not touched.any:
        return None
    if touched.springs_only:
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
    curved |= any(joints[name].layer is not None for name in touched.joints)
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
    """Derivatives of joints in stiffness and damping, exactly."""
    parametric, machine = state.model.parametric, state.model.parametric.scene.machine
    pieces = StackedPieces({}, {"stiffness": {}, "damping": {}, "loss": {}}, {}, {}, {})
    for name in parametric.touched[parameter.name].joints:
        joint = parametric.joints[name]
        built = joint.build(state.values)
        slopes = {
            law.key[2]: law.slope(state.values, parameter.name)
            for law in joint.laws
            if law.key[2] == "loss_factor"
        }
        stiffness, damping = np.zeros((6, 6)), np.zeros((6, 6))
        for law in joint.laws:
            if law.key[2] in ("stiffness", "damping"):
                for dof in joint.dofs(law):
                    matrix = stiffness if law.key[2] == "stiffness" else damping
                    matrix[dof, dof] = law.slope(state.values, parameter.name)
        pieces.joints["stiffness"][name] = stiffness
        pieces.joints["damping"][name] = damping + machine.rayleigh.beta * stiffness
        pieces.joints["loss"][name] = (
            built.loss_factor * stiffness + slopes.get("loss_factor", 0.0) * built.stiffness
        )
    return pieces


def _owners(state: CaseState, observer: str) -> set[str]:
    machine = state.model.parametric.scene.machine
    if observer in machine.points:
        point = machine.points[observer]
        return {end.component for end in (point.tool, point.work) if end.component is not None}
    if observer in machine.sensors:
        return {machine.sensors[observer].component}
    return {observer.partition(".")[0]}


def _pieces_at(state: CaseState, values: Mapping[str, float], wanted: Selection) -> StackedPieces:
    built = state.model.parametric.build(values)
    placements = place_components(built.machine, state.model.pose)
    moved = dataclasses.replace(
        state.coupled.layout, superelements=built.superelements, placements=placements
    )
    return stack_pieces(moved, built.machine, wanted)
