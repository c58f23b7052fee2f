"""The mechanism's equations against complex steps, a published table, symmetry, limits and a model
in absolute coordinates.
"""

import dataclasses
from collections.abc import Callable, Iterator
from itertools import product

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import (
    closure_bias,
    closure_residual,
    evaluate_kinematics,
)
from headstock.geometry.mechanisms.exechon import (
    ASSEMBLIES,
    ExechonDimensions,
    platform_states,
    survey_tool_poses,
)
from headstock.geometry.mechanisms.kinematics import cross, marker_bias, place_markers
from headstock.solvers.mechanisms.dynamics import CompliantMechanism, evaluate_dynamics
from headstock.solvers.mechanisms.modes import linearise_poses, solve_lumped_modes, tool_compliance
from headstock.solvers.mechanisms.partitioning import (
    Drive,
    PartitionedDynamics,
    compose_state,
    driven_forces,
    partition_dynamics,
)
from headstock.solvers.mpi import MPI
from headstock.validation.mechanisms.absolute_bodies import (
    BODY_NAMES,
    AbsoluteState,
    AbsoluteSystem,
    LegStiffness,
    absolute_exechon,
    linearise_rest,
    solve_instant,
)
from headstock.validation.mechanisms.motion import ConstrainedMotion, DriveLaw, PartitionedMotion
from headstock.validation.mechanisms.tripteor_machine import (
    Tripteor,
    load_tripteor,
    oscillating_drive,
    plane_states,
    steady_force,
)
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    reference_case,
)

STEP = 1e-40
SMALL_FORCE = 1.0
INSTANT = 0.05
AMPLITUDE = 1e-6


def check_mechanism_derivatives(comm: MPI.Comm) -> list[ValidationRow]:
    """Closure and mark Jacobians, their bias and the inertial forces at a random open state,
    against the complex step.
    """
    tripteor = load_tripteor()
    mechanism, rng = tripteor.model.mechanism, np.random.default_rng(20100)
    state, rates = rng.normal(size=(2, len(mechanism.coordinates)))
    found = evaluate_kinematics(mechanism, state)
    weightless = dataclasses.replace(tripteor.model, gravity=np.zeros(3))
    bias = closure_bias(mechanism, found.placement, marker_bias(found.placement, rates))
    inertial = -evaluate_dynamics(weightless, found, rates).load
    closures = _complex_step(lambda q: closure_residual(mechanism, q), state)
    markers = _complex_step(lambda q: place_markers(mechanism, q).positions, state)
    second = _complex_step(lambda q: evaluate_kinematics(mechanism, q).closure_jacobian, state)
    slope = _complex_step(
        lambda q: evaluate_dynamics(weightless, evaluate_kinematics(mechanism, q)).mass, state
    )
    # Lagrange: d/dt (M qd) - 1/2 d(qd M qd)/dq
    lagrange = np.einsum("ijk,j,k->i", slope, rates, rates) - 0.5 * np.einsum(
        "jki,j,k->i", slope, rates, rates
    )
    compared = (
        ("closure Jacobian", found.closure_jacobian, closures),
        ("Jacobian of bodies and tool", found.of_position, markers),
        ("closure bias", bias, np.einsum("ijk,j,k->i", second, rates, rates)),
        ("inertial forces", inertial, lagrange),
    )
    return [
        compare_bound(f"{what}, relative", _relative(value, right), 1e-12)
        for what, value, right in compared
    ]


def check_inverse_kinematics(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Check the published 16 assemblies of an Exechon, three lengths each, as sets: the printed
    columns are permuted row by row.
    """
    reference = reference_case("exechon-inverse-kinematics")
    for (first, second), delta_a, delta_c in product(ASSEMBLIES, (1, -1), (1, -1)):
        dimensions = ExechonDimensions(
            base=(-0.4434, 0.7798, 0.3455),
            platform=(-0.1523, 0.2523, 0.1324),
            universal_offsets=(0.1023 * delta_a, 0.1523 * delta_c),
            platform_heights=(0.04, 0.023),
            wrist=(0.2828, -0.2),
        )
        lengths = np.sort(
            platform_states(dimensions, np.array([0.02, 0.7, 1.02]), (first, second))[:3]
        )
        signs = "".join("+" if sign > 0 else "-" for sign in (delta_a, first, second, delta_c))
        for place, value in zip(("shortest", "middle", "longest"), lengths, strict=True):
            printed = reference.values[f"{signs} {place}"]
            unit = 1e-4 if printed < 1.0 else 1e-3
            yield compare_value(
                f"{signs} {place} leg", value, Target(printed, "m", unit / printed, "published")
            )


def check_mirror_symmetry(comm: MPI.Comm) -> list[ValidationRow]:
    """Frequencies and stiffness on both sides of the machine's plane of symmetry."""
    tripteor = load_tripteor()
    rng = np.random.default_rng(5)
    points = rng.uniform([-0.35, -0.4, 0.1], [0.35, 0.4, 0.4], (50, 3))
    sides = [
        survey_tool_poses(
            tripteor.scene.mounted, points * [1.0, sign, 1.0], tripteor.scene.tool
        ).states
        for sign in (1.0, -1.0)
    ]
    motions = [linearise_poses(tripteor.model, states) for states in sides]
    left, right = (solve_lumped_modes(motion).frequencies_hz for motion in motions)
    flip = np.diag([1.0, -1.0, 1.0])
    stiff, mirrored = (tool_compliance(tripteor.model, motion)[..., :3, :3] for motion in motions)
    return [
        compare_bound("frequencies in 50 poses, relative", np.abs(left / right - 1.0).max(), 1e-9),
        compare_bound(
            "compliance in 50 poses, relative", _relative(stiff, flip @ mirrored @ flip), 1e-9
        ),
    ]


def check_limits(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Check the nonlinear equations at rest under a small force, and their frequencies by finite
    differences, against the linear model.
    """
    tripteor = load_tripteor()
    model = dataclasses.replace(tripteor.model, gravity=np.zeros(3))
    for name, state in tripteor.poses.items():
        motions = linearise_poses(model, state)
        force = SMALL_FORCE * np.array([1.0, 0.7, -0.4])
        moved = _static_rest(model, state, force)
        linear = tool_compliance(model, motions)[:3, :3] @ force
        yield compare_bound(f"static limit in {name}, relative", _relative(moved, linear), 1e-6)
        frequencies = _swing_frequencies(model, state)
        expected = solve_lumped_modes(motions).frequencies_hz
        yield compare_bound(
            f"modal limit in {name}, relative", _relative(frequencies, expected), 1e-6
        )


def check_three_models(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Reduced ODE, full DAE and absolute coordinates in one violent instant; modes of the first and
    the last.
    """
    tripteor = load_tripteor()
    for name, start in tripteor.poses.items():
        yield from _compare_instant(tripteor, name, start)
    states = plane_states(tripteor, 4).reshape(16, -1)
    chains = solve_lumped_modes(linearise_poses(tripteor.model, states)).frequencies_hz
    absolute = np.array([_absolute_frequencies(tripteor, state) for state in states])
    yield compare_bound(
        "modes over the plane, chains against absolute, relative",
        _relative(absolute, chains),
        1e-8,
    )


def _compare_instant(tripteor: Tripteor, name: str, start: FloatArray) -> list[ValidationRow]:
    model = tripteor.model
    drive, rng = oscillating_drive(start[model.mechanism.driven_slice]), np.random.default_rng(3)
    compliant, rates = 1e-4 * rng.normal(size=6), 1e-2 * rng.normal(size=6)
    reduced = PartitionedMotion(model, drive, steady_force, start)
    for time in np.linspace(0.0, INSTANT, 6):
        motion = reduced.at(float(time), compliant, rates)
    accelerations = reduced.accelerations(INSTANT, compliant, rates)
    force = steady_force(INSTANT)
    drives = driven_forces(model, motion, accelerations, force)
    full = ConstrainedMotion(model, drive, steady_force)
    instant = full.start(INSTANT, motion.state[full.free], motion.rates[full.free])
    system = absolute_tripteor(tripteor, drive)
    state = absolute_state(tripteor, motion.state, motion.rates)
    found = solve_instant(system, INSTANT, state, force)
    pushes = -found.multipliers[
        [row for row, item in enumerate(system.constraints) if item.value(INSTANT)[0] != 0.0]
    ]
    work = (
        0.5
        * model.springs.stiffness_slope(motion.state[model.mechanism.driven_slice])
        * compliant**2
    )
    return [
        compare_bound(
            f"accelerations, DAE against ODE, {name}, relative",
            _relative(instant.acceleration[-6:], accelerations),
            1e-8,
        ),
        compare_bound(
            f"accelerations, absolute against ODE, {name}, relative",
            _relative(found.stretch_acceleration, accelerations),
            1e-8,
        ),
        compare_bound(
            f"drive forces, DAE against ODE, {name}, relative",
            _relative(full.drives(instant), drives),
            1e-8,
        ),
        compare_bound(
            f"drive forces, absolute against ODE, {name}, relative",
            _relative(pushes + work[1::2], drives[:3]),
            1e-8,
        ),
        compare_bound(f"joints open in absolute coordinates, {name} [m]", found.violation, 1e-12),
    ]


def absolute_tripteor(tripteor: Tripteor, drive: DriveLaw) -> AbsoluteSystem:
    """Return the machine in absolute coordinates."""
    springs = tripteor.model.springs
    legs = LegStiffness(
        1.0 / float(springs.constant[0]), float(springs.constant[1]), float(springs.per_length[1])
    )
    bodies = {body.name: body for body in tripteor.model.bodies}
    return absolute_exechon(
        tripteor.scene.mounted.dimensions, bodies, legs, drive, tripteor.model.gravity
    )


def absolute_state(tripteor: Tripteor, coordinates: FloatArray, rates: FloatArray) -> AbsoluteState:
    """Return a state of motion of the lumped mechanism in absolute coordinates, body by body.

    Args:
        tripteor: The lumped mechanism with ``n`` coordinates.
        coordinates: ``(n,)`` with the loops closed [m, rad].
        rates: ``(n,)`` consistent with the closures [m/s, rad/s].
    """
    placement = place_markers(tripteor.model.mechanism, coordinates)
    moving = marker_bias(placement, rates)
    bodies = {body.name: body for body in tripteor.model.bodies}
    markers = [tripteor.model.mechanism.markers.index(bodies[name].marker) for name in BODY_NAMES]
    rotations, spins = placement.rotations[markers], moving.omega[markers]
    arms = np.array(
        [rotations[place] @ bodies[name].center for place, name in enumerate(BODY_NAMES)]
    )
    return AbsoluteState(
        placement.positions[markers] + arms,
        rotations,
        moving.velocity[markers] + cross(spins, arms),
        spins,
    )


def _absolute_frequencies(tripteor: Tripteor, state: FloatArray) -> FloatArray:
    def still(time: float) -> Drive:
        rest = np.zeros(len(tripteor.model.mechanism.driven))
        return Drive(state[tripteor.model.mechanism.driven_slice], rest, rest)

    mass, stiffness = linearise_rest(
        absolute_tripteor(tripteor, still), absolute_state(tripteor, state, np.zeros_like(state))
    )
    return np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True)) / (2.0 * np.pi)


def _at_rest(
    model: CompliantMechanism, state: FloatArray, compliant: FloatArray, force: FloatArray
) -> PartitionedDynamics:
    still = np.zeros(len(model.mechanism.driven))
    closed, kinematics = compose_state(
        model.mechanism, state[model.mechanism.driven_slice], compliant, state
    )
    drive = Drive(closed[model.mechanism.driven_slice], still, still)
    return partition_dynamics(
        model, closed, kinematics, drive, rates=np.zeros_like(compliant), force=force
    )


def _static_rest(model: CompliantMechanism, state: FloatArray, force: FloatArray) -> FloatArray:
    """Displacement of the tool in nonlinear equilibrium, by fixed-point iteration [m]."""
    tool = model.mechanism.markers.index(model.tool)
    compliant: FloatArray = np.zeros(len(model.mechanism.compliant))
    for _ in range(20):
        motion = _at_rest(model, state, compliant, force)
        compliant = motion.load / motion.stiffness
    moved = _at_rest(model, state, compliant, force).dynamics.placement.positions[tool]
    return moved - place_markers(model.mechanism, state).positions[tool]


def _swing_frequencies(model: CompliantMechanism, state: FloatArray) -> FloatArray:
    """Frequencies of the nonlinear equations, from central differences of the accelerations about
    rest [Hz].
    """
    size = len(model.mechanism.compliant)
    columns = []
    for index in range(size):
        ends = []
        for sign in (1.0, -1.0):
            compliant = sign * AMPLITUDE * np.eye(size)[index]
            motion = _at_rest(model, state, compliant, np.zeros(3))
            ends.append(np.linalg.solve(motion.mass, motion.load - motion.stiffness * compliant))
        columns.append((ends[1] - ends[0]) / (2.0 * AMPLITUDE))
    eigenvalues = np.linalg.eigvals(np.stack(columns, axis=1)).real
    return np.sqrt(np.sort(eigenvalues)) / (2.0 * np.pi)


def _complex_step(function: Callable[[FloatArray], FloatArray], state: FloatArray) -> FloatArray:
    columns = []
    for index in range(len(state)):
        moved = state.astype(complex)
        moved[index] += 1j * STEP
        columns.append(np.asarray(function(moved)).imag / STEP)
    return np.stack(columns, axis=-1)


def _relative(value: FloatArray, right: FloatArray) -> float:
    return float(np.abs(value - right).max() / np.abs(right).max())
