"""The state space of a machine wherever its axes stand: one basis for the whole travel, rows of joints
interpolated between knots, and the error in poses between them.
"""

import dataclasses
import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import cast

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.machine import Pose, position_units
from headstock.pipeline.exchange.state_spaces import list_units
from headstock.pipeline.exchange.varying_spaces import VaryingStateSpace
from headstock.pipeline.stages.frf import add_load_inputs
from headstock.pipeline.stages.machine import CoupledPose, couple_pose, damp_system
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.reduction.coupling.joint_springs import PlacedJoint
from headstock.reduction.coupling.travel import PlacedRows, TravelCoordinates, find_travel
from headstock.scene.exports import Export
from headstock.scene.scene import LOAD
from headstock.solvers.control.drive_trains import FORCE, MOTOR, SCALE
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import add_modal_damping, equivalent_viscous
from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest
from headstock.solvers.linear.modal_coordinates import (
    count_modes,
    elastic_displacements,
    keep_modes,
    modal_motion,
    to_modal_coordinates,
)
from headstock.solvers.second_order import (
    Channel,
    ComplexArray,
    SecondOrderSystem,
    input_columns,
    output_rows,
)
from headstock.solvers.state_spaces.varying_matrices import (
    CONSTANT,
    Knots,
    PosedMatrices,
    VaryingMatrices,
    VaryingSpring,
    add_springs,
    find_largest_error,
    lay_field,
    list_grid,
    respond_posed,
    span_motions,
    split_patterns,
)

DEFAULT_ERROR = 0.01
FIRST_KNOTS = 3
MOST_POSES = 150  # solved with all modes
MOST_KNOTS = (65, 130)  # of joints along an axis, of channels and damping along all together
MOST_CHECKED = 16  # poses between knots
INTERPOLATED = 0.3  # of the error that is asked for may come of interpolation
SHARES = tuple(0.5 + 0.5 * side * 0.5**n for n in range(1, 8) for side in (0.0, 1.0, -1.0))
LINES = 40  # even frequencies of a response that is compared
FEW_LINES = 12  # of one that is compared to place knots
SOLVED = 8.0  # times the highest frequency: exact responses have modes up to here
SERVING = 1.5  # times the highest frequency: modes up to here are in the basis
DAMPING_OF_UNDAMPED = 0.01  # of responses that are compared, where a scene has none

ADDED = 4  # poses at most at once

LevelledKnots = tuple[dict[str, FloatArray], dict[str, FloatArray]]
Place = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class _Solved:
    """A pose with all its modes.

    Attributes:
        motions: ``(n, k)`` fixed coordinates of the lowest modes and of static motions under every
            channel that they lack.
        omega: ``(n_freq,)`` [rad/s].
        response: ``(n_freq, p, k)`` at these.
        rigid_count: How many of its modes are rigid-body modes.
    """

    coupled: CoupledMachine
    motions: FloatArray
    omega: FloatArray
    response: ComplexArray
    rigid_count: int


@dataclass(eq=False)
class _Travel:
    """The machine, its axes and what was solved of it."""

    state: RunState
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]]
    drives: tuple[Drive, ...]
    rotary: Collection[str]
    up_to_hz: float
    axes: dict[str, tuple[float, float]]
    start: Mapping[str, float]
    solved: dict[Place, _Solved] = field(default_factory=dict)
    placed: dict[Place, PlacedRows] = field(default_factory=dict)
    memo: CouplingMemo = field(default_factory=CouplingMemo)

    def pose(self, place: Place) -> Pose:
        """Return the pose at positions of the axes that move."""
        return Pose("travel", {**self.start, **dict(zip(self.axes, place, strict=True))})

    @property
    def middle(self) -> Place:
        """Positions in the middle of the travel."""
        return tuple(0.5 * (low + high) for low, high in self.axes.values())

    def solve(self, place: Place) -> _Solved:
        """Return the machine at a place with all its modes, solved once."""
        if place not in self.solved:
            self.solved[place] = self._solve(place)
        return self.solved[place]

    def place(self, place: Place) -> PlacedRows:
        """Return the rows of joints and channels at a place."""
        if place not in self.placed:
            self.placed[place] = self.coordinates.place(self.pose(place))
        return self.placed[place]

    @cached_property
    def coordinates(self) -> TravelCoordinates:
        """Return the coordinates that are the same in every pose."""
        names = {name for name, dof in itertools.chain(*self.channels) if dof != LOAD}
        return find_travel(
            self.state.scene.machine,
            self.couple(self.middle).coupled,
            gravity=self.state.plan.gravity,
            channels=names,
            drives=self.drives,
        )

    def couple(self, place: Place) -> CoupledPose:
        """Return the machine coupled at a place, with free motors where there are drives."""
        model = couple_pose(self.state.parts, self.pose(place), memo=self.memo)
        return cast(CoupledPose, model.release(self.drives).model) if self.drives else model

    def damp(
        self, system: SecondOrderSystem, modes: ModalResult | None = None
    ) -> SecondOrderSystem:
        """Return a system with the damping of the scene, all of it viscous.

        Args:
            modes: All undamped modes, where they are already known.
        """
        return equivalent_viscous(damp_system(self.state.scene, system, modes), modes)

    def find_modes(self, stiffness: FloatArray) -> ModalResult:
        """Return the modes in coordinates ``m`` of unit mass, in which as many as in the whole machine
        are rigid, though for it only nearly so.
        """
        squares, shapes = np.linalg.eigh(stiffness)
        rigid = self.solve(self.middle).rigid_count
        squares[:rigid] = 0.0
        hz = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
        return ModalResult(hz, shapes, rigid, 0, np.zeros(len(hz)))

    def damp_somewhat(self, matrices: PosedMatrices) -> PosedMatrices:
        """Return matrices with some damping where they have none."""
        if matrices.damping.any():
            return matrices
        unit = np.eye(len(matrices.stiffness))
        system = SecondOrderSystem(unit, None, matrices.stiffness, {}, {}, ())
        damped = _damp_a_little(system, self.find_modes(matrices.stiffness)).damping
        return matrices._replace(damping=matrices.damping if damped is None else damped)

    def _solve(self, place: Place) -> _Solved:
        inputs, outputs = self.channels
        coordinates = self.coordinates
        model = self.couple(place)
        modes = model.all_modes
        system = _damp_a_little(self.damp(model.system, modes), modes)
        system = add_load_inputs(system, model.loads, inputs)
        whole = to_modal_coordinates(system, inputs, outputs, modes)
        if whole is None:
            raise ModelError(
                "a damper acts on a dof without mass, or a matrix is not symmetric; give every body a mass"
            )
        kept = keep_modes(whole, count_modes(whole, SOLVED * self.up_to_hz))
        omega = _list_lines(self.up_to_hz, modes.frequencies_hz[modes.rigid_count :])
        columns = [
            modal_motion(kept, omega, np.tile(load + 0j, (len(omega), 1))) @ kept.outputs.T
            for load in kept.inputs.T
        ]
        response = np.stack(columns, axis=2) + kept.residual
        lowest = keep_lowest(modes, up_to_hz=SERVING * self.up_to_hz)
        loads = np.hstack([input_columns(system, inputs), output_rows(system, outputs).T])
        elastic = slice(lowest.rigid_count, None)
        squares = (2.0 * np.pi * lowest.frequencies_hz[elastic]) ** 2
        shapes = lowest.shapes[:, elastic]
        rest = elastic_displacements(system, modes, loads) - (shapes / squares) @ (shapes.T @ loads)
        motions = np.hstack([lowest.shapes, rest[:, np.linalg.norm(rest, axis=0) > 0.0]])
        motions = coordinates.bring_home(model.coupled, motions)
        return _Solved(model.coupled, motions, omega, response, modes.rigid_count)


@dataclass(frozen=True, eq=False)
class _Reduced:
    """The machine in a basis ``(n, m)`` of its fixed coordinates."""

    travel: _Travel
    basis: FloatArray

    def sum(self, kind: str) -> FloatArray:
        """Return stiffness, mass, damping or loss ``(m, m)`` of the bodies."""
        coordinates = self.travel.coordinates
        matrices = coordinates.matrices
        parts = {"mass": matrices.masses, "damping": matrices.dampings}
        weights = coordinates.loss_factors if kind == "loss" else {}
        total = coordinates.sum_bodies(self.basis, parts.get(kind, matrices.stiffnesses), weights)
        if kind == "mass":
            total += coordinates.sum_rotors(self.place(self.travel.middle))
        return total

    @cached_property
    def bodies(self) -> dict[str, FloatArray]:
        """Return the sums over bodies by kind."""
        return {kind: self.sum(kind) for kind in ("stiffness", "damping", "loss")}

    def place(self, place: Place) -> PlacedRows:
        """Return the rows at a place."""
        return self.travel.place(place).reduce(self.basis)

    def at(self, place: Place) -> tuple[PosedMatrices, FloatArray]:
        """Return the matrices at a place with exact rows, and the damping that is no sum over joints and
        bodies ``(m, m)``.
        """
        rows, factors = self.place(place), self.travel.coordinates.loss_factors
        losses = [(s, factors.get(s.name, 0.0)) for s in rows.springs]  # none of couplings
        stiffness = add_springs(
            self.bodies["stiffness"], ((s.rows, s.stiffness) for s in rows.springs)
        )
        viscous = add_springs(self.bodies["damping"], ((s.rows, s.damping) for s in rows.springs))
        loss = add_springs(
            self.bodies["loss"], ((s.rows, factor * s.stiffness) for s, factor in losses)
        )
        system = SecondOrderSystem(
            np.eye(len(stiffness)),
            viscous if viscous.any() else None,
            0.5 * (stiffness + stiffness.T),
            {},
            {},
            (),
            loss if any(factors.values()) else None,
        )
        damped = self.travel.damp(system, self.travel.find_modes(system.stiffness)).damping
        total = np.zeros_like(viscous) if damped is None else damped
        inputs, outputs = self.travel.channels
        loads = [
            rows.loads[name] if dof == LOAD else rows.channels[name, dof] for name, dof in inputs
        ]
        moved = [rows.channels[channel] for channel in outputs]
        matrices = PosedMatrices(stiffness, total, np.array(loads).T, np.array(moved))
        return matrices, total - viscous

    @cached_property
    def slides(self) -> dict[str, tuple[str, ...]]:
        """Return the axes that each joint's rows or stiffness depend on."""
        travel = self.travel
        middle = travel.middle
        before = {spring.name: spring for spring in travel.place(middle).springs}
        found: dict[str, tuple[str, ...]] = dict.fromkeys(before, ())
        for number, (axis, limits) in enumerate(travel.axes.items()):
            for limit in limits:
                place = (*middle[:number], limit, *middle[number + 1 :])
                for spring in travel.place(place).springs:
                    if axis not in found[spring.name] and _differs(spring, before[spring.name]):
                        found[spring.name] += (axis,)
        return found

    def lay(self, knots: LevelledKnots) -> VaryingMatrices:
        """Return the matrices with rows interpolated between knots."""
        stiffness, damping = self.bodies["stiffness"], self.bodies["damping"]
        first = {spring.name: spring for spring in self.place(self.travel.middle).springs}
        springs = []
        for name, axes in self.slides.items():
            laid = self._lay_spring(name, axes, knots[0]) if axes else None
            if laid is not None and any(field.varies for field in laid.fields):
                springs.append(laid)
                continue
            spring = first[name]
            stiffness = add_springs(stiffness, [(spring.rows, spring.stiffness)])
            damping = add_springs(damping, [(spring.rows, spring.damping)])
        counts = [len(positions) for positions in knots[1].values()]
        posed = [self.at(tuple(place.values())) for place in list_grid(knots[1])]
        amounts, patterns = split_patterns(
            np.array([further for _, further in posed]),
            _weigh_modes(posed[0][0], self.travel.up_to_hz),
        )
        of_joints, others = (
            {name: Knots(positions) for name, positions in level.items()} for level in knots
        )
        return VaryingMatrices(
            (of_joints, others),
            stiffness,
            damping,
            tuple(springs),
            patterns,
            lay_field(list(amounts), counts, 1),
            lay_field([matrices.loads.T for matrices, _ in posed], counts, 1),
            lay_field([matrices.rows for matrices, _ in posed], counts, 1),
        )

    def _lay_spring(
        self, name: str, axes: Sequence[str], knots: Mapping[str, FloatArray]
    ) -> VaryingSpring:
        """Return a joint at the knots of the axes it depends on, the others in the middle."""
        middle = dict(zip(self.travel.axes, self.travel.middle, strict=True))
        grid = {
            axis: positions if axis in axes else np.array([middle[axis]])
            for axis, positions in knots.items()
        }
        placed = [
            next(s for s in self.place(tuple(place.values())).springs if s.name == name)
            for place in list_grid(grid)
        ]
        acting = [
            row
            for row in range(len(placed[0].rows))
            if any(s.stiffness[row].any() or s.damping[row].any() for s in placed)
        ]
        counts, square = [len(positions) for positions in grid.values()], np.ix_(acting, acting)
        rows = [s.rows[acting] for s in placed]
        stiffness, damping = ([m[square] for m in ms] for ms in (
            [s.stiffness for s in placed], [s.damping for s in placed]))  # fmt: skip
        return VaryingSpring(*(lay_field(part, counts, 0) for part in (rows, stiffness, damping)))


def _differs(one: PlacedJoint, other: PlacedJoint) -> bool:
    """Return whether a joint is another one in another pose, by more than roundoff."""
    return any(
        _changes(here, there, CONSTANT)
        for here, there in (
            (one.rows, other.rows),
            (one.stiffness, other.stiffness),
            (one.damping, other.damping),
        )
    )


def _changes(here: FloatArray, there: FloatArray, share: float = 1e-9) -> bool:
    return bool(np.abs(here - there).max(initial=0.0) > share * np.abs(there).max(initial=0.0))


def find_varying_state_space(
    state: RunState,
    wanted: Export,
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    pose: Pose,
    rotary: Collection[str],
) -> VaryingStateSpace:
    """Return the state space over the travel of some axes, in one basis that covers it.

    Poses are added until the error in poses between them is what is asked for.

    Args:
        pose: Where the axes stand that do not move, and the others at the start.

    Raises:
        ModelError: Something else than rows of joints changes along the travel.
    """
    machine = state.scene.machine
    axes = {name: machine.axes[name].limits for name in wanted.travel}
    start = {name: pose.positions.get(name, 0.0) for name in machine.axes}
    drives = () if wanted.motors == "locked" else tuple(state.scene.drives.values())
    if drives:
        names = [drive.name for drive in drives]
        channels = (
            (*((name, FORCE) for name in names), *channels[0]),
            (*channels[1], *((name, MOTOR) for name in names), *((name, SCALE) for name in names)),
        )
    travel = _Travel(state, channels, drives, rotary, wanted.hz or 0.0, axes, start)
    target = wanted.error or DEFAULT_ERROR
    matrices, error, held_out = _refine(travel, target)
    rate = 1.1 * max(_find_rate(matrices.at(place)) for place in matrices.grid)
    units = position_units(machine)
    return VaryingStateSpace(
        matrices, channels, tuple(rotary), tuple(units[name] for name in axes), start, rate,
        wanted.step, error, travel.up_to_hz, target, held_out, len(travel.solved),
    )  # fmt: skip


def _refine(travel: _Travel, target: float) -> tuple[VaryingMatrices, float, int]:
    """Add motions of poses to the basis until the error is small enough or the budget is spent; return
    the matrices, the error and the number of poses in which it was found.
    """
    first: dict[str, FloatArray] = {
        name: np.linspace(*limits, FIRST_KNOTS, dtype=np.float64)
        for name, limits in travel.axes.items()
    }
    knots: LevelledKnots = (first, dict(first))
    serving: list[Place] = [travel.middle, *itertools.product(*travel.axes.values())]
    while True:
        reduced = _span(travel, serving)
        matrices, knots = _fit_knots(reduced, knots, INTERPOLATED * target)
        between = _list_between(knots[0], serving)
        errors = [
            _find_error(travel, place, matrices.at(_name(travel, place))) for place in between
        ]
        worst = [between[number] for number in np.argsort(errors)[: -ADDED - 1 : -1]]
        if max(errors) <= target or len(travel.solved) + len(between) > MOST_POSES:
            return matrices, max(errors), len(between)
        serving += worst


def _fit_knots(
    reduced: _Reduced, knots: LevelledKnots, target: float
) -> tuple[VaryingMatrices, LevelledKnots]:
    """Halve the distances of knots until interpolated rows respond as exact ones between them."""
    travel = reduced.travel
    while True:
        matrices = reduced.lay(knots)
        errors: dict[Place, float] = {}
        for place in itertools.chain(
            *(_list_between(knots[0], (), [share]) for share in SHARES[:3])
        ):
            exact, _ = reduced.at(place)
            natural = np.sqrt(np.maximum(np.linalg.eigvalsh(exact.stiffness), 0.0))
            omega = _list_lines(travel.up_to_hz, natural / (2.0 * np.pi), FEW_LINES)
            wanted, found = (
                respond_posed(travel.damp_somewhat(one), omega)
                for one in (exact, matrices.at(_name(travel, place)))
            )
            errors[place] = find_largest_error(wanted, found, _find_sizes(travel, wanted))
        place = max(errors, key=lambda place: errors[place])
        level, axis = _find_coarsest(reduced, matrices, place)
        positions = knots[level][axis]
        points = np.prod([len(others) for others in knots[1].values()]) if level else len(positions)
        if errors[place] <= target or points > MOST_KNOTS[level] // 2:
            return matrices, knots
        halved = {axis: np.union1d(positions, 0.5 * (positions[1:] + positions[:-1]))}
        knots = (knots[0] | halved, knots[1]) if level == 0 else (knots[0], knots[1] | halved)


def _span(travel: _Travel, serving: Sequence[Place]) -> _Reduced:
    """Return the machine in a basis of the motions of some poses."""
    motions = np.hstack([travel.solve(place).motions for place in serving])
    reduced = _Reduced(travel, motions)
    placed = [{spring.name: spring for spring in reduced.place(place).springs} for place in serving]
    stiffness, least = reduced.sum("stiffness"), reduced.sum("stiffness")
    for name in placed[0]:
        shares = [
            add_springs(0.0 * least, [(one[name].rows, one[name].stiffness)]) for one in placed
        ]
        stiffness += np.mean(shares, axis=0)
        if all(np.array_equal(share, shares[0]) for share in shares):
            least += shares[0]
    rotors = [travel.coordinates.sum_rotors(reduced.place(place)) for place in serving]
    if any(_changes(rotor, rotors[0]) for rotor in rotors):
        raise ModelError(
            "the inertia of a motor that drives its axis rigidly moves other bodies wherever the axes stand; "
            "give the joint of its drive a stiffness along the axis"
        )
    turn = span_motions(stiffness, least, reduced.sum("mass"), travel.up_to_hz)
    basis = motions @ turn
    for place in serving:
        travel.coordinates.require_held(travel.solve(place).coupled, basis)
    return _Reduced(travel, basis)


def _list_between(
    knots: Mapping[str, FloatArray], serving: Sequence[Place], shares: Sequence[float] = SHARES
) -> list[Place]:
    """Return places between the knots of all axes, at the first share of a cell where no pose serves;
    every cell of an axis comes in turn, those of several axes mixed.
    """
    random = np.random.default_rng(0)
    cells = [list(itertools.pairwise(map(float, positions))) for positions in knots.values()]
    count = min(MOST_CHECKED, int(np.prod([len(each) for each in cells])))
    turns = [
        np.concatenate([random.permutation(len(each)) for _ in range(count // len(each) + 1)])
        for each in cells
    ]
    places = []
    for number in range(count):
        cell = [each[turn[number]] for each, turn in zip(cells, turns, strict=True)]
        inside = (tuple(low + share * (high - low) for low, high in cell) for share in shares)
        places += [place for place in inside if place not in serving and place not in places][:1]
    return places


def _name(travel: _Travel, place: Place) -> dict[str, float]:
    return dict(zip(travel.axes, place, strict=True))


def _find_error(travel: _Travel, place: Place, matrices: PosedMatrices) -> float:
    """Find the error of the frequency response at a place."""
    exact = travel.solve(place)
    response = respond_posed(travel.damp_somewhat(matrices), exact.omega)
    return find_largest_error(exact.response, response, _find_sizes(travel, exact.response))


def _list_lines(up_to_hz: float, natural_hz: FloatArray, count: int = LINES) -> FloatArray:
    """List the angular frequencies at which responses are compared: even ones, and resonances."""
    lines = np.linspace(up_to_hz / count, up_to_hz, count)
    return (
        2.0 * np.pi * np.union1d(lines, natural_hz[(natural_hz > 0.0) & (natural_hz <= up_to_hz)])
    )


def _find_sizes(travel: _Travel, response: ComplexArray) -> FloatArray:
    """Find the size ``(p, k)`` of responses of each pair of units."""
    largest = np.abs(response).max(axis=0)
    inputs, outputs = map(np.array, list_units(travel.channels, travel.rotary))
    sizes = np.ones_like(largest)
    for given, moved in itertools.product(set(inputs), set(outputs)):
        block = np.ix_(outputs == moved, inputs == given)
        sizes[block] = largest[block].max() or 1.0
    return sizes


def _damp_a_little(system: SecondOrderSystem, modes: ModalResult) -> SecondOrderSystem:
    """Return a system with some damping where it has none, so that its responses can be compared."""
    if system.damping is None or not system.damping.any():
        bare = dataclasses.replace(system, damping=None)
        return add_modal_damping(bare, [DAMPING_OF_UNDAMPED], modes)
    return system


def _find_coarsest(reduced: _Reduced, matrices: VaryingMatrices, place: Place) -> tuple[int, str]:
    """Find the set of knots and the axis along which interpolation is worst at a place, the others at
    their nearest knot.
    """
    travel, omega = reduced.travel, 2.0 * np.pi * reduced.travel.up_to_hz
    misfits = {}
    for level, (number, axis) in itertools.product((0, 1), enumerate(travel.axes)):
        near = [
            float(knots.positions[np.argmin(np.abs(knots.positions - position))])
            for knots, position in zip(matrices.knots[level].values(), place, strict=True)
        ]
        near[number] = place[number]
        (exact, further), named = reduced.at(tuple(near)), _name(travel, tuple(near))
        scales = _weigh_modes(exact, travel.up_to_hz)
        here = matrices.at(named)
        changes = (
            here.stiffness - exact.stiffness,
            omega * (matrices.damp_further(matrices.weigh(named)) - further),
        )
        moved = np.linalg.norm(here.rows - exact.rows) / np.linalg.norm(exact.rows)
        misfits[level, axis] = float(
            np.linalg.norm(changes[level] * np.outer(scales, scales), 2) + level * moved
        )
    return max(misfits, key=lambda key: misfits[key])


def _weigh_modes(matrices: PosedMatrices, up_to_hz: float) -> FloatArray:
    """Return the amplitudes ``(m,)`` of coordinates at one energy [s]."""
    return 1.0 / np.sqrt(matrices.stiffness.diagonal() + (2.0 * np.pi * up_to_hz) ** 2)


def _find_rate(matrices: PosedMatrices) -> float:
    """Find a bound of the natural frequencies and decay rates [rad/s]."""
    fastest = np.sqrt(np.linalg.norm(matrices.stiffness, 2))
    return float(max(fastest, np.linalg.norm(matrices.damping, 2)))
