"""A ball screw is as stiff as nut, shaft, bearings and coupling together, wherever the nut
stands.
"""

import dataclasses
import math
from functools import partial

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Axis, JointEnd, ScrewShaft
from headstock.geometry.machine.machine import Machine, Pose
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.static_response import solve_static
from lumped_machines import joint_between, lumped_machine, rigid_body

NUT, BEARING, FAR_BEARING, COUPLING = 5e8, 8e8, 6e8, 2e4
DIAMETER, LEAD, LENGTH = 0.028, 0.010, 0.9
AXIAL, TORSIONAL = 210e9 * math.pi * DIAMETER**2 / 4.0, 80e9 * math.pi * DIAMETER**4 / 32.0
ALL = tuple(range(6))
TWISTING = ScrewShaft(AXIAL, TORSIONAL, LEAD, BEARING, COUPLING)
FIXED_AT_BOTH_ENDS = ScrewShaft(
    AXIAL,
    TORSIONAL,
    bearing=BEARING,
    second_end=JointEnd("end_2", "far"),
    second_bearing=FAR_BEARING,
    length=LENGTH,
)


def screw_machine(
    shaft: ScrewShaft, *, soft: float = 0.0
) -> tuple[dict[str, Superelement], Machine]:
    """A slide on a screw along x, its bearings at x = 0 and x = 0.9 m; they stand on springs where
    ``soft`` is not zero.
    """
    bodies = [
        rigid_body("end_1", 2.0, {"near": (0.0, 0.0, 0.0)}),
        rigid_body("end_2", 2.0, {"far": (LENGTH, 0.0, 0.0)}, center=(LENGTH, 0.0, 0.0)),
        rigid_body("slide", 5.0, {"nut": (0.1, 0.0, 0.0)}, center=(0.1, 0.0, 0.0)),
    ]
    fixed = (1, 2, 3, 4, 5)
    stand = (
        partial(joint_between, stiffness=(soft, 0.0, 0.0, 0.0, 0.0, 0.0), fixed=fixed)
        if soft
        else partial(joint_between, fixed=ALL)
    )
    joints = [
        stand("stand_1", "end_1.near", "ground"),
        stand("stand_2", "end_2.far", "ground"),
        joint_between("guide", "slide.nut", "ground", fixed=fixed),
        dataclasses.replace(
            joint_between("screw", "slide.nut", "end_1.near", stiffness=(NUT, 0, 0, 0, 0, 0)),
            screw=shaft,
        ),
    ]
    parts, machine = lumped_machine(
        bodies, joints, {"tcp": ("slide.nut", "ground"), "near": ("end_1.near", "ground")}
    )
    axis = Axis("X", ("guide", "screw"), ("slide",), np.array([1.0, 0.0, 0.0]))
    return parts, dataclasses.replace(machine, axes={"X": axis})


def axial_compliance(parts: dict[str, Superelement], machine: Machine, place: float) -> FloatArray:
    """Compliance between the nut and the near bearing along x [m/N], the nut at a place from the
    near bearing [m].
    """
    system = couple(parts, machine, Pose("p", {"X": place - 0.1})).system
    channels = np.column_stack([system.inputs[point, "x"] for point in ("tcp", "near")])
    return np.asarray(channels.T @ solve_static(system, channels).displacements)


@pytest.mark.parametrize("place", [0.05, 0.3, 0.85])
def test_nut_shaft_bearing_and_twist_are_in_series(place: float) -> None:
    pitch = LEAD / (2.0 * math.pi)
    expected = (
        1.0 / NUT + 1.0 / BEARING + place / AXIAL + pitch**2 * (place / TORSIONAL + 1.0 / COUPLING)
    )
    assert axial_compliance(*screw_machine(TWISTING), place)[0, 0] == approx(expected, rel=1e-10)


@pytest.mark.parametrize("place", [0.05, 0.45, 0.7])
def test_between_rigid_bearings_the_shaft_is_the_standard_s(place: float) -> None:
    """ISO 3408-4: R = E A l / (a (l - a)) for a shaft fixed at both ends."""
    shaft = ScrewShaft(AXIAL, TORSIONAL, second_end=JointEnd("end_2", "far"), length=LENGTH)
    expected = 1.0 / NUT + place * (LENGTH - place) / (AXIAL * LENGTH)
    assert axial_compliance(*screw_machine(shaft), place)[0, 0] == approx(expected, rel=1e-10)


@pytest.mark.parametrize("place", [0.05, 0.45, 0.7])
def test_two_bearings_on_soft_stands_share_the_force_like_springs_that_meet_in_a_body_of_their_own(
    place: float,
) -> None:
    parts, machine = screw_machine(FIXED_AT_BOTH_ENDS, soft=3e8)
    tie = joint_between(
        "tie",
        "end_1.near",
        "end_2.far",
        stiffness=(1.0 / (1.0 / BEARING + 1.0 / FAR_BEARING + LENGTH / AXIAL), 0, 0, 0, 0, 0),
    )
    found = axial_compliance(
        parts, dataclasses.replace(machine, joints=machine.joints | {"tie": tie}), place
    )

    near, far = (
        1.0 / (1.0 / BEARING + place / AXIAL),
        1.0 / (1.0 / FAR_BEARING + (LENGTH - place) / AXIAL),
    )
    stiffness = np.array(
        [
            [NUT, -NUT, 0.0, 0.0],
            [-NUT, NUT + near + far, -near, -far],
            [0.0, -near, near + 3e8, 0.0],
            [0.0, -far, 0.0, far + 3e8],
        ]
    )
    np.testing.assert_allclose(found, np.linalg.inv(stiffness)[np.ix_([0, 2], [0, 2])], rtol=1e-10)


def test_a_nut_that_turns_along_its_thread_meets_no_force() -> None:
    parts, machine = screw_machine(TWISTING)
    free = dataclasses.replace(machine.joints["guide"], fixed=(1, 2, 4, 5))
    coupled = couple(
        parts,
        dataclasses.replace(machine, joints=machine.joints | {"guide": free}),
        Pose("p", {"X": 0.2}),
    )
    stiffness = coupled.system.stiffness
    x, turn = (coupled.system.outputs["tcp", dof] for dof in ("x", "rx"))
    along = np.linalg.solve(np.vstack([x, turn]), [LEAD / (2.0 * math.pi), 1.0])
    across = np.linalg.solve(np.vstack([x, turn]), [LEAD / (2.0 * math.pi), -1.0])
    assert along @ stiffness @ along < 1e-12 * (across @ stiffness @ across)


def test_the_nut_s_own_torsion_is_in_series_with_the_shaft_s() -> None:
    parts, machine = screw_machine(ScrewShaft(AXIAL, TORSIONAL))
    stiff = np.array(machine.joints["screw"].stiffness)
    stiff[3, 3] = 4e4
    joints = machine.joints | {
        "screw": dataclasses.replace(machine.joints["screw"], stiffness=stiff),
        "guide": dataclasses.replace(machine.joints["guide"], fixed=(1, 2, 4, 5)),
    }
    system = couple(
        parts, dataclasses.replace(machine, joints=joints), Pose("p", {"X": 0.3})
    ).system
    moment = system.inputs["tcp", "rx"]
    assert moment @ solve_static(system, moment).displacements == approx(
        1.0 / 4e4 + 0.4 / TORSIONAL, rel=1e-10
    )


def test_a_nut_that_leaves_its_screw_is_named() -> None:
    parts, machine = screw_machine(FIXED_AT_BOTH_ENDS)
    with pytest.raises(ModelError, match=r"joint 'screw'.* nut .*950 mm"):
        couple(parts, machine, Pose("far", {"X": 0.85}))
    with pytest.raises(ModelError, match=r"the nut stands at its bearing"):
        couple(parts, machine, Pose("near", {"X": -0.1}))
