"""Mechanisms in motion: energy, orders of both integrators, drift, three models on one path, and a
swing through a singular pose (H37).
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.integrate

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import closure_residual
from headstock.geometry.mechanisms.kinematics import place_markers
from headstock.geometry.mechanisms.mechanism import Mechanism
from headstock.solvers.mechanisms.dynamics import CompliantMechanism, LumpedSprings, MechanismBody
from headstock.solvers.mechanisms.partitioning import Drive
from headstock.solvers.motion.alpha import AlphaScheme
from headstock.solvers.mpi import MPI
from headstock.validation.mechanisms.absolute_bodies import (
    AbsoluteState,
    AbsoluteSystem,
    solve_instant,
)
from headstock.validation.mechanisms.generalized_alpha import (
    MotionState,
    integrate_constrained,
)
from headstock.validation.mechanisms.mechanism_cases import absolute_state, absolute_tripteor
from headstock.validation.mechanisms.motion import (
    ConstrainedMotion,
    PartitionedMotion,
    StartReport,
    project_start,
)
from headstock.validation.mechanisms.platforms import planar_3rpr, planar_3rpr_state
from headstock.validation.mechanisms.tripteor_machine import (
    load_tripteor,
    oscillating_drive,
    steady_force,
)
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_order,
    compare_value,
    show,
)

EXACT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-16}
DAMPING = 2000.0  # N s/m in every compliance: about 1 % in the first modes
POSE = "config_1"
LOOK_EVERY = 25  # steps between two looks at the constraints
ANGLES = np.radians([90.0, 210.0, 330.0])
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
OUTER, INNER, MASS, INERTIA = 1.0, 0.3, 20.0, 0.5
BASE, PLATFORM = OUTER * CIRCLE, INNER * CIRCLE
SOFT = 1e5  # of each leg [N/m]
WELL = float(np.radians(8.0))  # the legs' length is that of the platform turned so far
SPIN = -6.0  # of the platform at the start [rad/s]
STEP = 1e-3
SINGULAR_LOOK_EVERY = 4  # steps


@dataclass(frozen=True)
class _Run:
    """A time span [s] and the numbers of steps it is cut into, each twice the one before."""

    span: float
    steps: tuple[int, ...]


FULL_RUN = _Run(0.01, (100, 200, 400, 800))


def check_energy_balance(comm: MPI.Comm, run: _Run = FULL_RUN) -> Iterator[ValidationRow]:
    """Energy gained is work put in, by a Runge-Kutta method of order 8 to its tolerance and by
    generalised-α to order 2.
    """
    (motion, start) = _moving(damped=True)
    reference = _reference(motion, start, run.span)
    gained = motion.energy(run.span, reference[:6], reference[6:12]) - motion.energy(0.0, *start)
    yield show("energy gained", gained, "J", "moving legs, force on the tool, gravity, damping")
    yield compare_value("work put in, DOP853", reference[12], Target(gained, "J", 1e-9, "identity"))
    errors = [_energy_error(motion, start, run.span, count) for count in run.steps]
    yield from _order_rows("energy mismatch, generalised-α", run, errors)


def check_integration_orders(comm: MPI.Comm, run: _Run = FULL_RUN) -> Iterator[ValidationRow]:
    """Reduced ODE and index-3 DAE by generalised-α, both against the reduced ODE by a Runge-Kutta
    method of order 8.
    """
    (motion, start) = _moving()
    reference = _reference(motion, start, run.span)[:6]
    scale = float(np.abs(reference).max())
    problems: dict[str, tuple[PartitionedMotion | ConstrainedMotion, MotionState]] = {
        "reduced ODE": (motion, motion.start(0.0, *start)),
        "index-3 DAE": _full_problem(motion, start),
    }
    for name, (problem, first) in problems.items():
        ends = [
            integrate_constrained(problem, first, run.span / count, count) for count in run.steps
        ]
        errors = [float(np.abs(end.position[-6:] - reference).max()) / scale for end in ends]
        yield from _order_rows(name, run, errors)


def check_constraint_drift(comm: MPI.Comm, count: int = 10_000) -> list[ValidationRow]:
    """Violation of positions and velocities over many steps of the index-3 DAE, at the step of the
    contouring runs.
    """
    (motion, start) = _moving()
    full, first = _full_problem(motion, start)
    seen: list[tuple[float, float]] = []
    number = 0

    def observe(state: MotionState) -> None:
        nonlocal number
        number += 1
        if number % LOOK_EVERY == 0:
            seen.append(_violations(full, state))

    integrate_constrained(full, first, 48e-6, count, observe=observe)
    position, velocity = np.array(seen).T
    return [
        compare_bound(
            f"largest position violation in {count} steps [m, rad]", position.max(), 1e-12
        ),
        compare_bound(
            "its mean in the second half over the first, less one",
            _growth(position),
            0.5,
            "no growth",
        ),
        compare_bound(
            f"largest velocity violation in {count} steps [m/s, rad/s]", velocity.max(), 1e-5
        ),
        compare_bound(
            "its mean in the second half over the first, less one",
            _growth(velocity),
            0.5,
            "no growth",
        ),
    ]


def check_million_steps(comm: MPI.Comm) -> list[ValidationRow]:
    """Repeat it over a million steps, 48 s of motion."""
    return check_constraint_drift(comm, 1_000_000)


def check_common_path(comm: MPI.Comm) -> list[ValidationRow]:
    """Reduced ODE and absolute coordinates integrated over the same time, both by a Runge-Kutta
    method of order 8.
    """
    tripteor, span = load_tripteor(), 0.01
    motion, start = _moving()
    reference = _reference(motion, start, span)
    coordinates = motion.at(span, reference[:6], reference[6:12]).state
    tool = place_markers(motion.model.mechanism, coordinates).positions[
        motion.model.mechanism.markers.index("tcp")
    ]
    system = absolute_tripteor(tripteor, motion.drive)
    first = motion.at(0.0, *start)
    found = _integrate_absolute(system, absolute_state(tripteor, first.state, first.rates), span)
    spindle = next(body for body in tripteor.model.bodies if body.name == "spindle")
    place = np.array([0.0, 0.0, tripteor.scene.mounted.dimensions.tool_length]) - spindle.center
    reached = found.place[8] + found.rotation[8] @ place
    stretch = solve_instant(system, span, found, np.zeros(3)).stretch
    off = np.abs(stretch - reference[:6]).max() / np.abs(reference[:6]).max()
    return [
        compare_bound("tool point after 10 ms [m]", np.abs(reached - tool).max(), 1e-10),
        compare_bound("compliances after 10 ms, relative", off, 1e-8),
    ]


def _moving(*, damped: bool = False) -> tuple[PartitionedMotion, tuple[FloatArray, FloatArray]]:
    """Return the machine on oscillating drives under a turning force, and a start off equilibrium."""
    tripteor = load_tripteor()
    coordinates = tripteor.poses[POSE]
    model = (
        dataclasses.replace(tripteor.model, damping=DAMPING * np.eye(6))
        if damped
        else tripteor.model
    )
    drive = oscillating_drive(coordinates[model.mechanism.driven_slice])
    motion = PartitionedMotion(model, drive, steady_force, coordinates)
    compliant: FloatArray = np.zeros(6)
    for _ in range(10):
        still = motion.at(0.0, compliant, np.zeros(6))
        compliant = still.load / still.stiffness
    # from quasi-static rest, with the legs stretched further: the first three modes swing
    return motion, (compliant + np.array([0.0, 4e-5, 0.0, 5e-5, 0.0, -6e-5]), np.zeros(6))


def _reference(
    motion: PartitionedMotion, start: tuple[FloatArray, FloatArray], span: float
) -> FloatArray:
    first = np.concatenate([*start, [0.0]])
    done = scipy.integrate.solve_ivp(motion.state_rates, (0.0, span), first, **EXACT)
    return done.y[:, -1]


def _full_problem(
    motion: PartitionedMotion, start: tuple[FloatArray, FloatArray]
) -> tuple[ConstrainedMotion, MotionState]:
    full = ConstrainedMotion(motion.model, motion.drive, motion.force)
    begun = motion.at(0.0, *start)
    return full, full.start(0.0, begun.state[full.free], begun.rates[full.free])


def _energy_error(
    motion: PartitionedMotion, start: tuple[FloatArray, FloatArray], span: float, count: int
) -> float:
    """Energy gained less work put in, by the trapezoidal rule over the steps [J], relative."""
    powers: list[float] = []

    def observe(state: MotionState) -> None:
        powers.append(
            float(
                motion.state_rates(
                    state.time, np.concatenate([state.position, state.velocity, [0.0]])
                )[-1]
            )
        )

    first = motion.start(0.0, *start)
    observe(first)
    last = integrate_constrained(
        motion, first, span / count, count, observe=observe, scheme=AlphaScheme(1.0)
    )
    gained = motion.energy(span, last.position, last.velocity) - motion.energy(0.0, *start)
    return abs(float(np.trapezoid(powers, dx=span / count)) - gained) / abs(gained)


def _order_rows(what: str, run: _Run, errors: list[float]) -> Iterator[ValidationRow]:
    for count, error in zip(run.steps, errors, strict=True):
        yield show(f"{what}, {count} steps in {1e3 * run.span:g} ms", error, "-", "relative")
    yield compare_order(f"{what}, order", errors, 2.0, within=0.1)


def _violations(full: ConstrainedMotion, state: MotionState) -> tuple[float, float]:
    dynamics, _, _ = full.evaluate(state)
    rates = np.concatenate([full.drive(state.time).speed, state.velocity])
    return float(np.abs(full.residual(state)[1]).max()), float(
        np.abs(dynamics.closure_jacobian @ rates).max()
    )


def _growth(values: FloatArray) -> float:
    half = len(values) // 2
    return max(0.0, float(values[half:].mean() / values[:half].mean() - 1.0))


def _integrate_absolute(system: AbsoluteSystem, start: AbsoluteState, span: float) -> AbsoluteState:
    """Bodies by velocities, rotation matrices by ``R' = omega x R``."""
    count = len(start.place)

    def unpack(values: FloatArray) -> AbsoluteState:
        parts = np.split(values, np.cumsum([3 * count, 9 * count, 3 * count]))
        return AbsoluteState(
            parts[0].reshape(-1, 3),
            parts[1].reshape(-1, 3, 3),
            parts[2].reshape(-1, 3),
            parts[3].reshape(-1, 3),
        )

    def rates(time: float, values: FloatArray) -> FloatArray:
        state = unpack(values)
        found = solve_instant(system, time, state, steady_force(time))
        turning = np.cross(state.spin[:, None, :], np.swapaxes(state.rotation, 1, 2))
        parts = (state.velocity, np.swapaxes(turning, 1, 2), found.acceleration, found.spin_rate)
        return np.concatenate([part.ravel() for part in parts])

    first = np.concatenate(
        [part.ravel() for part in (start.place, start.rotation, start.velocity, start.spin)]
    )
    return unpack(
        scipy.integrate.solve_ivp(
            rates, (0.0, span), first, method="DOP853", rtol=1e-12, atol=1e-15
        ).y[:, -1]
    )


@dataclass(frozen=True, eq=False)
class _Passage:
    """A swing through the singular pose.

    Attributes:
        angles: ``(k,)`` of the platform [rad].
        energies: ``(k,)`` [J].
        violations: ``(k,)`` of the closures [m, rad].
    """

    angles: FloatArray
    energies: FloatArray
    violations: FloatArray
    report: StartReport


def _planar_machine(stiffness: float) -> CompliantMechanism:
    """Return a heavy platform on three springs, singular where it is not turned."""
    springs = LumpedSprings(
        np.full(3, 1.0 / stiffness),
        np.zeros(3),
        np.arange(3, dtype=np.intp),
        ("leg_1", "leg_2", "leg_3"),
    )
    body = MechanismBody("platform", "platform_1", MASS, inertia=np.diag([0.0, 0.0, INERTIA]))
    return CompliantMechanism(_planar_mechanism(), (body,), springs, tool="platform_1")


def _planar_mechanism() -> Mechanism:
    """Return the 3-RPR of the case."""
    return planar_3rpr(BASE, PLATFORM)


def _leg_length(angle: float) -> float:
    """Of each leg at an angle of the platform in the middle [m]."""
    return float(np.sqrt(OUTER**2 + INNER**2 - 2.0 * OUTER * INNER * np.cos(angle)))


def check_singular_passage(comm: MPI.Comm, span: float = 20.0) -> list[ValidationRow]:
    """Twenty seconds in steps of a millisecond, to and fro over the pose in which the legs do not
    hold the platform.
    """
    found = _swing_through(span)
    crossings = float((np.diff(np.sign(found.angles)) != 0).sum())
    off = float(np.abs(found.energies / found.energies[0] - 1.0).max())
    return [
        show("passages of the singular pose", crossings, "-", f"in {span:g} s"),
        compare_bound(f"energy off its start in {span:g} s, relative", off, 1e-3),
        compare_bound("largest violation of the closures [m, rad]", found.violations.max(), 1e-12),
    ]


def _swing_through(span: float) -> _Passage:
    """Integrate the full equations with multipliers, generalised-α without numerical damping."""
    model, mechanism = _planar_machine(SOFT), _planar_mechanism()
    lengths = np.full(3, _leg_length(WELL))
    problem = ConstrainedMotion(
        model, lambda time: Drive(lengths, np.zeros(3), np.zeros(3)), lambda time: np.zeros(3)
    )
    given = planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), WELL)
    given[:3] = lengths
    closed, names = given[problem.free], model.mechanism.coordinates[3:]
    speed = np.zeros_like(closed)
    speed[[names.index(f"ps{leg}") for leg in (1, 2, 3)]] = SPIN
    start, report = project_start(problem, 0.0, closed, speed)
    seen: list[tuple[float, float, float]] = []
    count = 0

    def observe(state: MotionState) -> None:
        nonlocal count
        count += 1
        if count % SINGULAR_LOOK_EVERY:
            return
        dynamics, coordinates, _ = problem.evaluate(state)
        rates = np.concatenate([np.zeros(3), state.velocity])
        stored = 0.5 * SOFT * float((coordinates[mechanism.compliant_slice] ** 2).sum())
        energy = 0.5 * float(rates @ dynamics.mass @ rates) + stored
        open_by = float(
            np.abs(closure_residual(model.mechanism, coordinates, dynamics.placement)).max()
        )
        seen.append(
            (
                float(state.position[names.index("th1")] + state.position[names.index("ps1")]),
                energy,
                open_by,
            )
        )

    integrate_constrained(
        problem, start, STEP, round(span / STEP), observe=observe, scheme=AlphaScheme(1.0)
    )
    angles, energies, violations = np.array(seen).T
    return _Passage(angles, energies, violations, report)
