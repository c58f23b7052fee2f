"""over-constrained mechanisms: the rank is found, no freedom is lost, and joint forces are
called not unique.

Ranks depend on where a loop is cut. Bricard's six hinges: 6 closures of rank 5 with all six angles,
5 of rank 4 when cut at a hinge whose angle is no coordinate. The Exechon: 12 loop equations of rank
10 in 13 joints, 9 of rank 9 with the common axis shared and the redundant ones left out. One
freedom, and three, either way.
"""

import numpy as np
import pytest

from headstock.geometry.errors import SingularPoseError
from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import closure_residual, find_mobility
from headstock.geometry.mechanisms.exechon import (
    ExechonDimensions,
    exechon_mechanism,
    platform_states,
)
from headstock.geometry.mechanisms.mechanism import (
    ChainItem,
    Marker,
    Mechanism,
    OrientationConstraint,
    PointConstraint,
    prismatic,
    revolute,
)
from headstock.solvers.mechanisms.dynamics import CompliantMechanism, LumpedSprings, MechanismBody
from headstock.solvers.mechanisms.partitioning import Drive
from headstock.validation.mechanisms.motion import ConstrainedMotion

pytestmark = pytest.mark.hard("H38")

QUARTER = 0.5 * np.pi
EXECHON = ExechonDimensions((-0.57, 0.57, 0.73), (-0.22, 0.22, 0.20), wrist=(0.0, 0.33))


def bricard() -> Mechanism:
    """Six bars of 1 m along the edges of a cube, each hinge square to both bars (Bricard 1897), cut
    open at its last hinge.
    """
    chain = (
        revolute("z", "t1"), prismatic("x", 1.0), revolute("x", QUARTER), revolute("z", "t2"), prismatic("x", 1.0),
        revolute("x", -QUARTER), revolute("z", "t3"),
        prismatic("x", 1.0), revolute("x", QUARTER), revolute("z", "t4"), prismatic("x", 1.0), revolute("x", -QUARTER), revolute("z", "t5"),
        prismatic("x", 1.0),
        revolute("x", QUARTER), revolute("z", "t6"), prismatic("x", 1.0), revolute("x", -QUARTER), Marker("end"),
    )  # fmt: skip
    start = (Marker("start"),)
    return Mechanism(
        "Bricard",
        (chain, start),
        (PointConstraint("end", "start"), OrientationConstraint("end", "start")),
        (),
    )


def close_bricard() -> FloatArray:
    """Angles of the threefold form: equal at every other hinge, with ``cos a + cos b + cos a cos b
    = 0`` of the closed loop.
    """
    mechanism = bricard()
    rng, best = np.random.default_rng(0), None
    for _ in range(200):
        angles = rng.uniform(-np.pi, np.pi, 2)
        for _ in range(60):

            def residual(pair: FloatArray) -> FloatArray:
                return np.asarray(closure_residual(mechanism, np.tile(pair, 3)))

            value = residual(angles)
            slope = np.stack(
                [(residual(angles + 1e-7 * e) - value) / 1e-7 for e in np.eye(2)], axis=1
            )
            angles = angles - np.linalg.lstsq(slope, value, rcond=1e-8)[0]
        if np.abs(residual(angles)).max() < 1e-13 and np.abs(np.sin(angles)).min() > 0.2:
            best = np.tile(angles, 3)
            break
    assert best is not None
    return best


def test_bricard_moves_although_six_closures_meet_six_hinges() -> None:
    mobility = find_mobility(bricard(), close_bricard())
    assert (mobility.closures, mobility.rank, mobility.freedom, mobility.redundant) == (6, 5, 1, 1)


def test_bricard_cut_open_at_a_hinge_has_rank_four_of_five() -> None:
    # without the angle of the last hinge: five closures of that hinge on the other five angles
    chain, _ = bricard().chains
    cut = next(place for place, item in enumerate(chain) if item == revolute("z", "t6"))
    back = (revolute("x", QUARTER), prismatic("x", -1.0), Marker("start"))
    mechanism = Mechanism(
        "Bricard, cut at a hinge",
        ((*chain[:cut], Marker("end")), back),
        (PointConstraint("end", "start"), OrientationConstraint("start", "end", ("x", "y"))),
        (),
    )
    angles = close_bricard()[:5]
    assert np.abs(closure_residual(mechanism, angles)).max() < 1e-12
    mobility = find_mobility(mechanism, angles)
    assert (mobility.closures, mobility.rank, mobility.freedom, mobility.redundant) == (5, 4, 1, 1)


def test_an_exechon_with_all_twelve_loop_equations_has_two_too_many() -> None:
    base, platform = EXECHON.base, EXECHON.platform

    def leg(number: int) -> tuple[ChainItem, ...]:
        return (
            revolute("y", f"phi{number}"), prismatic("y", base[number - 1]), revolute("x", f"th{number}"), prismatic("z", f"q{number}"),
            revolute("x", f"ps{number}"), prismatic("y", -platform[number - 1]), Marker(f"platform_{number}"),
        )  # fmt: skip

    third = (
        prismatic("x", base[2]), revolute("x", "a1"), revolute("y", "a2"), revolute("z", "a3"), prismatic("z", "q3"), revolute("y", "ps3"),
        prismatic("x", -platform[2]), Marker("platform_3"),
    )  # fmt: skip
    closures = tuple(
        kind("platform_1", f"platform_{leg}")
        for leg in (2, 3)
        for kind in (PointConstraint, OrientationConstraint)
    )
    mechanism = Mechanism(
        "Exechon, every joint", (leg(1), leg(2), third), closures, ("q1", "q2", "q3")
    )
    solved = platform_states(EXECHON, np.array([-0.2, 0.1, 1.1]))
    known = dict(zip(exechon_mechanism(EXECHON).coordinates, solved, strict=True))
    state = np.array(
        [known["phi"] if name.startswith("phi") else known[name] for name in mechanism.coordinates]
    )
    assert np.abs(closure_residual(mechanism, state)).max() < 1e-14
    mobility = find_mobility(mechanism, state)
    # 13 joints, 12 loop equations of rank 10: three freedoms, over-constrained twice, as published
    assert (len(state), mobility.closures, mobility.rank, mobility.freedom, mobility.redundant) == (
        13,
        12,
        10,
        3,
        2,
    )


def parallelogram(*, flexible: bool) -> CompliantMechanism:
    """A coupler on three equal parallel cranks: the third crank is one too many, unless it can
    stretch.
    """
    chains = []
    for number, place in enumerate((0.0, 0.5, 1.0), 1):
        give = (prismatic("y", f"d{number}"),) if flexible else ()
        chains.append(
            (
                prismatic("x", "u"),
                prismatic("x", place),
                revolute("z", f"t{number}"),
                prismatic("y", 0.4),
                *give,
                revolute("z", f"s{number}"),
                prismatic("x", -place),
                Marker(f"c{number}"),
            )
        )
    closures = tuple(
        kind(f"c{number}") for number in (2, 3) for kind in (
            lambda other: PointConstraint("c1", other, ("x", "y")),
            lambda other: OrientationConstraint("c1", other, ("z",)),
        )
    )  # fmt: skip
    compliant = ("d1", "d2", "d3") if flexible else ()
    mechanism = Mechanism("three cranks", tuple(chains), closures, ("u",), compliant)
    count = len(compliant)
    springs = LumpedSprings(
        np.full(count, 1e-7), np.zeros(count), np.zeros(count, dtype=np.intp), compliant
    )
    body = MechanismBody("coupler", "c1", 10.0, np.array([0.5, 0.0, 0.0]), np.diag([0.0, 0.0, 1.0]))
    return CompliantMechanism(
        mechanism, (body,), springs, tool="c1", gravity=np.array([0.0, -9.81, 0.0])
    )


def no_drive(time: float) -> Drive:
    return Drive(np.zeros(1), np.zeros(1), np.zeros(1))


def test_rigid_parallel_cranks_keep_their_freedom_and_their_forces_are_called_not_unique() -> None:
    model = parallelogram(flexible=False)
    state = np.array(
        [
            0.0 if name == "u" else 0.3 if name.startswith("t") else -0.3
            for name in model.mechanism.coordinates
        ]
    )
    mobility = find_mobility(model.mechanism, state)
    # the crank and the driven slide
    assert (mobility.freedom, mobility.redundant) == (2, 1)
    problem = ConstrainedMotion(model, no_drive, lambda time: np.zeros(3))
    with pytest.raises(SingularPoseError, match="not unique"):
        problem.start(0.0, state[problem.free], np.zeros(len(state) - 1))


def test_cranks_that_stretch_share_the_load_in_one_way_only() -> None:
    model = parallelogram(flexible=True)
    state = np.array(
        [
            0.3 if name.startswith("t") else -0.3 if name.startswith("s") else -1e-4
            for name in model.mechanism.coordinates
        ]
    )
    problem = ConstrainedMotion(model, no_drive, lambda time: np.zeros(3))
    start = problem.start(0.0, state[problem.free], np.zeros(len(state) - 1))
    dynamics, _, _ = problem.evaluate(start)
    assert (
        np.linalg.matrix_rank(dynamics.closure_jacobian[:, problem.free])
        == len(start.multipliers)
        == 6
    )
    assert np.isfinite(start.multipliers).all() and np.abs(start.multipliers).max() > 1.0
