"""A planar 3-RPR that swings through its singular pose for a long time: its energy stays, and so do its closures (H37)."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import closure_residual
from headstock.geometry.mechanisms.mechanism import Mechanism
from headstock.geometry.mechanisms.platforms import planar_3rpr, planar_3rpr_state
from headstock.solvers.mechanisms.compliant_mechanism import CompliantMechanism, LumpedSprings, MechanismBody
from headstock.solvers.mechanisms.generalized_alpha import AlphaScheme, MotionState, integrate_motion
from headstock.solvers.mechanisms.motion import ConstrainedMotion, StartReport, project_start
from headstock.solvers.mechanisms.partitioning import Drive
from headstock.validation.references.rows import ValidationRow, judge_bound, show

ANGLES = np.radians([90.0, 210.0, 330.0])
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
OUTER, INNER, MASS, INERTIA = 1.0, 0.3, 20.0, 0.5
BASE, PLATFORM = OUTER * CIRCLE, INNER * CIRCLE
SOFT = 1e5  # of each leg [N/m]
WELL = float(np.radians(8.0))  # the legs' length is that of the platform turned so far
SPIN = -6.0  # of the platform at the start [rad/s]
STEP = 1e-3
LOOK_EVERY = 4  # steps


@dataclass(frozen=True, eq=False)
class Passage:
    """A swing through the singular pose.

    Attributes:
        angles: ``(k,)`` of the platform [rad].
        energies: ``(k,)`` [J].
        violations: ``(k,)`` of the closures [m, rad].
        report: Of the projected start.
    """

    angles: FloatArray
    energies: FloatArray
    violations: FloatArray
    report: StartReport


def planar_machine(stiffness: float) -> CompliantMechanism:
    """A heavy platform on three springs, singular where it is not turned."""
    springs = LumpedSprings(np.full(3, 1.0 / stiffness), np.zeros(3), np.arange(3, dtype=np.intp), ("leg_1", "leg_2", "leg_3"))
    body = MechanismBody("platform", "platform_1", MASS, inertia=np.diag([0.0, 0.0, INERTIA]))
    return CompliantMechanism(planar_mechanism(), (body,), springs, tool="platform_1")


def planar_mechanism() -> Mechanism:
    """The 3-RPR of the case."""
    return planar_3rpr(BASE, PLATFORM)


def leg_length(angle: float) -> float:
    """Of each leg at an angle of the platform in the middle [m]."""
    return float(np.sqrt(OUTER**2 + INNER**2 - 2.0 * OUTER * INNER * np.cos(angle)))


def check_singular_passage(comm: MPI.Comm, span: float = 20.0) -> list[ValidationRow]:
    """Twenty seconds in steps of a millisecond, to and fro over the pose in which the legs do not hold the platform."""
    case, found = "singular-passage", swing_through(span)
    crossings = float((np.diff(np.sign(found.angles)) != 0).sum())
    off = float(np.abs(found.energies / found.energies[0] - 1.0).max())
    return [
        show(case, "passages of the singular pose", crossings, "-", f"in {span:g} s"),
        judge_bound(case, f"energy off its start in {span:g} s, relative", off, 1e-3),
        judge_bound(case, "largest violation of the closures [m, rad]", float(found.violations.max()), 1e-12),
    ]


def swing_through(span: float) -> Passage:
    """The full equations with multipliers, generalised-α without numerical damping."""
    model, mechanism = planar_machine(SOFT), planar_mechanism()
    lengths = np.full(3, leg_length(WELL))
    problem = ConstrainedMotion(model, lambda time: Drive(lengths, np.zeros(3), np.zeros(3)), lambda time: np.zeros(3))
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
        if count % LOOK_EVERY:
            return
        dynamics, coordinates, _ = problem.evaluate(state)
        rates = np.concatenate([np.zeros(3), state.velocity])
        stored = 0.5 * SOFT * float((coordinates[mechanism.compliant_slice] ** 2).sum())
        energy = 0.5 * float(rates @ dynamics.mass @ rates) + stored
        open_by = float(np.abs(closure_residual(model.mechanism, coordinates, dynamics.placement)).max())
        seen.append((float(state.position[names.index("th1")] + state.position[names.index("ps1")]), energy, open_by))

    integrate_motion(problem, start, STEP, round(span / STEP), observe=observe, scheme=AlphaScheme(1.0))
    angles, energies, violations = np.array(seen).T
    return Passage(angles, energies, violations, report)
