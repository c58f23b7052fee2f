"""The state space of a machine wherever its axes stand: one basis for the whole travel, rows of joints
interpolated between knots, and the error in poses between them.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose, position_units
from headstock.pipeline.exchange.state_spaces import list_units
from headstock.pipeline.exchange.varying_spaces import VaryingStateSpace
from headstock.pipeline.stages.frf import add_load_inputs
from headstock.pipeline.stages.machine import couple_pose, damp_system
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.reduction.coupling.travel import PlacedRows, TravelCoordinates, find_travel
from headstock.scene.exports import Export
from headstock.scene.scene import LOAD
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import add_modal_damping, equivalent_viscous
from headstock.solvers.linear.modal_analysis import keep_lowest
from headstock.solvers.linear.modal_coordinates import (
    count_modes,
    elastic_displacements,
    keep_modes,
    modal_motion,
    to_modal_coordinates,
)
from headstock.solvers.linear.varying_matrices import (
    Knots,
    PosedMatrices,
    VaryingMatrices,
    VaryingSpring,
    add_springs,
    find_largest_error,
    lay_field,
    list_grid,
    respond,
    span_motions,
)
from headstock.solvers.second_order import (
    Channel,
    ComplexArray,
    SecondOrderSystem,
    input_columns,
    output_rows,
)

DEFAULT_ERROR = 0.01
FIRST_KNOTS = 3
MOST_POSES = 150  # solved with all modes
MOST_KNOTS = 15  # of an axis
SHARES = tuple(0.5 + 0.5 * side * 0.5**n for n in range(1, 8) for side in (0.0, 1.0, -1.0))
LINES = 40  # even frequencies of a response that is compared
SOLVED = 8.0  # times the highest frequency: exact responses have modes up to here
SERVING = 1.5  # times the highest frequency: modes up to here are in the basis
DAMPING_OF_UNDAMPED = 0.01  # of responses that are compared, where a scene has none
BASIS_SHARE = (
    0.5  # of the error that is asked for: more of it in the basis asks for motions of the pose
)

ADDED = 4  # poses at most at once

Place = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class _Solved:
    """A pose with all its modes.

    Attributes:
        motions: ``(n, k)`` fixed coordinates of the lowest modes and of static motions under every
            channel that they lack.
        omega: ``(n_freq,)`` [rad/s].
        response: ``(n_freq, p, k)`` at these.
    """

    coupled: CoupledMachine
    motions: FloatArray
    omega: FloatArray
    response: ComplexArray


@dataclass(eq=False)
class _Travel:
    """The machine, its axes and what was solved of it."""

    state: RunState
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]]
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
        """What is the same in every pose."""
        names = {name for name, dof in itertools.chain(*self.channels) if dof != LOAD}
        coupled = couple_pose(self.state.parts, self.pose(self.middle), memo=self.memo).coupled
        return find_travel(
            self.state.scene.machine,
            coupled,
            gravity=self.state.plan.gravity,
            channels=names,
        )

    def damp(self, system: SecondOrderSystem) -> SecondOrderSystem:
        """Return a system with the damping of the scene, all of it viscous."""
        return equivalent_viscous(damp_system(self.state.scene, system))

    def _solve(self, place: Place) -> _Solved:
        inputs, outputs = self.channels
        coordinates = self.coordinates
        model = couple_pose(self.state.parts, self.pose(place), memo=self.memo)
        modes = model.all_modes
        system = _damp_a_little(self.damp(model.system))
        system = add_load_inputs(system, model.loads, inputs)
        whole = to_modal_coordinates(system, inputs, outputs, modes)
        if whole is None:
            raise ModelError(
                "a damper acts on a dof without mass, or a matrix is not symmetric; give every body a mass"
            )
        kept = keep_modes(whole, count_modes(whole, SOLVED * self.up_to_hz))
        resonances = modes.frequencies_hz[modes.rigid_count :]
        lines = np.linspace(self.up_to_hz / LINES, self.up_to_hz, LINES)
        hz = np.union1d(lines, resonances[resonances <= self.up_to_hz])
        omega = 2.0 * np.pi * hz
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
        return _Solved(
            model.coupled, coordinates.bring_home(model.coupled, motions), omega, response
        )


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
        return coordinates.sum_bodies(self.basis, parts.get(kind, matrices.stiffnesses), weights)

    @cached_property
    def bodies(self) -> dict[str, FloatArray]:
        """Return the sums over bodies by kind."""
        return {kind: self.sum(kind) for kind in ("stiffness", "damping", "loss")}

    def place(self, place: Place) -> PlacedRows:
        """Return the rows at a place."""
        return self.travel.place(place).reduce(self.basis)

    def at(self, place: Place) -> tuple[PosedMatrices, PlacedRows, FloatArray]:
        """Return the matrices at a place with exact rows, these, and the damping that is no sum over
        joints and bodies ``(m, m)``.
        """
        rows, factors = self.place(place), self.travel.coordinates.loss_factors
        stiffness = add_springs(
            self.bodies["stiffness"], ((s.rows, s.stiffness) for s in rows.springs)
        )
        viscous = add_springs(self.bodies["damping"], ((s.rows, s.damping) for s in rows.springs))
        loss = add_springs(
            self.bodies["loss"], ((s.rows, factors[s.name] * s.stiffness) for s in rows.springs)
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
        damped = self.travel.damp(system).damping
        total = np.zeros_like(viscous) if damped is None else damped
        inputs, outputs = self.travel.channels
        loads = [
            rows.loads[name] if dof == LOAD else rows.channels[name, dof] for name, dof in inputs
        ]
        moved = [rows.channels[channel] for channel in outputs]
        matrices = PosedMatrices(stiffness, total, np.array(loads).T, np.array(moved))
        return matrices, rows, total - viscous

    def lay(self, knots: Mapping[str, FloatArray]) -> VaryingMatrices:
        """Return the matrices with rows interpolated between knots."""
        counts = [len(positions) for positions in knots.values()]
        laid = [self.at(tuple(place.values())) for place in list_grid(knots)]
        stiffness, damping = self.bodies["stiffness"], self.bodies["damping"]
        springs = []
        for together in zip(*(rows.springs for _, rows, _ in laid), strict=True):
            acting = [
                row
                for row in range(len(together[0].rows))
                if any(s.stiffness[row].any() or s.damping[row].any() for s in together)
            ]
            if not acting:
                continue
            square = np.ix_(acting, acting)
            spring = VaryingSpring(
                lay_field([s.rows[acting] for s in together], counts),
                lay_field([s.stiffness[square] for s in together], counts),
                lay_field([s.damping[square] for s in together], counts),
            )
            if any(part.varies for part in spring.fields):
                springs.append(spring)
                continue
            first = together[0]
            stiffness = add_springs(stiffness, [(first.rows, first.stiffness)])
            damping = add_springs(damping, [(first.rows, first.damping)])
        return VaryingMatrices(
            {name: Knots(positions) for name, positions in knots.items()},
            stiffness,
            damping,
            tuple(springs),
            lay_field([further for _, _, further in laid], counts),
            lay_field([matrices.loads.T for matrices, _, _ in laid], counts),
            lay_field([matrices.rows for matrices, _, _ in laid], counts),
        )


def find_varying_state_space(
    state: RunState,
    wanted: Export,
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    pose: Pose,
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
    travel = _Travel(state, channels, wanted.hz or 0.0, axes, start)
    target = wanted.error or DEFAULT_ERROR
    matrices, error, held_out = _refine(travel, target)
    rate = 1.1 * max(_find_rate(matrices.at(place)) for place in matrices.grid)
    units = position_units(machine)
    return VaryingStateSpace(
        matrices, channels, tuple(units[name] for name in axes), start, rate, wanted.step,
        error, travel.up_to_hz, target, held_out, len(travel.solved),
    )  # fmt: skip


def _refine(travel: _Travel, target: float) -> tuple[VaryingMatrices, float, int]:
    """Add poses to the basis and knots to the axes until the error is small enough or the budget is
    spent; return the matrices, the error and the number of poses in which it was found.
    """
    knots = {name: np.linspace(*limits, FIRST_KNOTS) for name, limits in travel.axes.items()}
    serving: list[Place] = [travel.middle, *itertools.product(*travel.axes.values())]
    while True:
        reduced = _span(travel, serving)
        matrices = reduced.lay(knots)
        between = _list_between(knots, serving)
        errors = [
            _find_error(travel, place, matrices.at(_name(travel, place))) for place in between
        ]
        worst = int(np.argmax(errors))
        place, error = between[worst], errors[worst]
        full = len(travel.solved) + len(between) > MOST_POSES
        if error <= target or full:
            return matrices, error, len(between)
        lacking = [
            place
            for number in np.argsort(errors)[: -ADDED - 1 : -1]
            if _find_error(travel, place := between[number], reduced.at(place)[0])
            > BASIS_SHARE * target
        ]
        if lacking:
            serving += lacking
            continue
        axis = _find_coarsest(reduced, matrices, place)
        if len(knots[axis]) >= MOST_KNOTS:
            return matrices, error, len(between)
        position = place[list(travel.axes).index(axis)]
        knots[axis] = np.union1d(knots[axis], [position])


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
    turn = span_motions(stiffness, least, reduced.sum("mass"), travel.up_to_hz)
    basis = motions @ turn
    for place in serving:
        travel.coordinates.require_held(travel.solve(place).coupled, basis)
    return _Reduced(travel, basis)


def _list_between(knots: Mapping[str, FloatArray], serving: Sequence[Place]) -> list[Place]:
    """Return a place within each cell of the knots, in the middle unless a pose there serves."""
    cells = [list(itertools.pairwise(positions.tolist())) for positions in knots.values()]
    places = []
    for cell in itertools.product(*cells):
        inside = (tuple(low + share * (high - low) for low, high in cell) for share in SHARES)
        places += [place for place in inside if place not in serving][:1]
    return places


def _name(travel: _Travel, place: Place) -> dict[str, float]:
    return dict(zip(travel.axes, place, strict=True))


def _find_error(travel: _Travel, place: Place, matrices: PosedMatrices) -> float:
    """Find the error of the frequency response at a place."""
    exact = travel.solve(place)
    if not matrices.damping.any():
        unit = np.eye(len(matrices.stiffness))
        system = SecondOrderSystem(unit, None, matrices.stiffness, {}, {}, ())
        damping = _damp_a_little(system).damping
        matrices = matrices._replace(damping=unit if damping is None else damping)
    largest = np.abs(exact.response).max(axis=0)
    named = [np.array(units) for units in list_units(travel.channels)]
    sizes = np.ones_like(largest)
    for given, moved in itertools.product(set(named[0]), set(named[1])):
        block = np.ix_(named[1] == moved, named[0] == given)
        sizes[block] = largest[block].max() or 1.0
    return find_largest_error(exact.response, respond(matrices, exact.omega), sizes)


def _damp_a_little(system: SecondOrderSystem) -> SecondOrderSystem:
    """Return a system with some damping where it has none, so that its responses can be compared."""
    if system.damping is None or not system.damping.any():
        return add_modal_damping(dataclasses.replace(system, damping=None), [DAMPING_OF_UNDAMPED])
    return system


def _find_coarsest(reduced: _Reduced, matrices: VaryingMatrices, place: Place) -> str:
    """Find the axis along which interpolation is worst at a place, the others at their nearest knot."""
    travel = reduced.travel
    misfits = {}
    for number, name in enumerate(travel.axes):
        near = [
            float(knots.positions[np.argmin(np.abs(knots.positions - position))])
            for knots, position in zip(matrices.knots.values(), place, strict=True)
        ]
        near[number] = place[number]
        exact, _, _ = reduced.at(tuple(near))
        found = matrices.at(_name(travel, tuple(near)))
        scales = 1.0 / np.sqrt(exact.stiffness.diagonal() + (2.0 * np.pi * travel.up_to_hz) ** 2)
        omega = 2.0 * np.pi * travel.up_to_hz
        misfits[name] = float(
            np.linalg.norm((found.stiffness - exact.stiffness) * np.outer(scales, scales), 2)
            + omega * np.linalg.norm((found.damping - exact.damping) * np.outer(scales, scales), 2)
            + np.linalg.norm(found.rows - exact.rows) / np.linalg.norm(exact.rows)
        )
    return max(misfits, key=lambda name: misfits[name])


def _find_rate(matrices: PosedMatrices) -> float:
    """Find a bound of the natural frequencies and decay rates [rad/s]."""
    fastest = np.sqrt(np.linalg.norm(matrices.stiffness, 2))
    return float(max(fastest, np.linalg.norm(matrices.damping, 2)))
