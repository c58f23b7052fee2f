"""Names of modes say what bends, what moves and on what."""

from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI

from cases import cases
from common import make_box, make_component, present
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine, Pose
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.mode_naming import (
    NamedModes,
    _is_ball,
    _name_around,
    _name_on_ball,
    _round_axis,
    name_modes,
)
from headstock.reduction.motions.part_names import join_names
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

HOME = Pose("home")


def named(parts: tuple[dict[str, Superelement], Machine], count: int = 6) -> NamedModes:
    coupled = couple(*parts, HOME)
    return name_modes(coupled, solve_modal(coupled.system, count=count))


def block_on_air(top_bolt: float) -> tuple[dict[str, Superelement], Machine]:
    corners = {
        f"c{i}": (x, y, 0.0)
        for i, (x, y) in enumerate([(-0.5, -0.4), (0.5, -0.4), (0.5, 0.4), (-0.5, 0.4)], start=1)
    }
    base = rigid_body("base", 230.0, corners, inertia=(14.0, 21.0, 31.4))
    top = rigid_body("top", 20.0, {"foot": (0, 0, 0)}, inertia=(1.0, 1.0, 1.0))
    joints = [
        joint_between(f"air_{i}", "ground", f"base.c{i}", stiffness=(1.2e4, 1.3e4, 1.8e4, 0, 0, 0))
        for i in range(1, 5)
    ]
    bolt = joint_between(
        "bolt", "base.c1", "top.foot", stiffness=np.full(6, top_bolt), point=(0.0, 0.0, 0.0)
    )
    return lumped_machine([base, top], [*joints, bolt])


def test_modes_on_mounts_move_the_whole_machine_on_all_four() -> None:
    names = named(block_on_air(1e9)).names
    motions = ("moves X", "moves Y", "moves Z", "turns A", "turns B", "turns C")
    assert sorted(names) == sorted(f"whole machine {motion} on air_1..4" for motion in motions)


def test_a_body_that_moves_on_one_joint_is_named_with_it() -> None:
    bed = rigid_body("bed", 1e6, {"foot": (0, 0, 0)}, inertia=(1e6, 1e6, 1e6))
    slider = rigid_body("slider", 20.0, {"guide": (0, 0, 0)})
    joints = [
        joint_between("mount", "ground", "bed.foot", stiffness=np.full(6, 1e12)),
        joint_between(
            "x_guide", "bed.foot", "slider.guide", stiffness=(1e6, 4e8, 5e8, 6e7, 7e7, 8e7)
        ),
    ]
    assert (
        named(lumped_machine([bed, slider], joints)).names[0]
        == "X translation of slider on x_guide"
    )


@pytest.mark.parametrize(
    ("soft", "expected"), [(0, "column bends X"), (1, "column bends Y"), (2, "column stretches Z")]
)
def test_a_component_that_deforms_is_named_with_its_direction(soft: int, expected: str) -> None:
    stiffness = np.full(6, 1e9)
    stiffness[soft] = 1e6
    column = two_node_body("column", 40.0, 0.5, stiffness)
    result = named(
        lumped_machine([column], [joint_between("foot", "ground", "column.foot", fixed=range(6))]),
        count=1,
    )
    assert result.names[0].startswith(expected)
    assert result.strain_shares[0]["column"] > 0.9


def test_a_stout_column_bends_twists_and_stretches() -> None:
    column = make_component(
        {"foot": "rigid", "tip": "average"}, modes=12, name="column", size=(0.4, 0.36, 0.9)
    )
    mesh = make_box((2, 2, 4), (0.4, 0.36, 0.9), {"foot": "z-", "tip": "z+"}, kind="hex27")
    superelement = reduce_elastic(column, mesh, comm=MPI.COMM_SELF)
    names = named(
        lumped_machine(
            [(column, superelement)],
            [joint_between("foot", "ground", "column.foot", fixed=range(6))],
        ),
        count=6,
    ).names
    assert names[:3] == ("column bends Y", "column bends X", "column twists C")
    assert names.count("column stretches Z") == 1


def test_names_do_not_change_from_run_to_run() -> None:
    assert named(block_on_air(1e6)).names == named(block_on_air(1e6)).names


def test_numbered_names_are_joined() -> None:
    assert join_names(["pad_3", "pad_1", "pad_2", "screw"]) == "pad_1..3 + screw"
    assert join_names(["pad_1", "pad_4"]) == "pad_1,4"
    assert join_names(["a", "b", "c", "d", "e"]) == "a + b + c + d ..."


def ring_points(
    radius: float, height: float, count: int = 600
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places on a wall of a radius and height, or in a disc where the height is nearly none."""
    random = np.random.default_rng(0)
    angles, heights = (
        random.uniform(0.0, 2.0 * np.pi, count),
        random.uniform(-0.5, 0.5, count) * height,
    )
    radii = radius * (
        np.sqrt(random.uniform(0.0, 1.0, count)) if height < radius / 5 else np.ones(count)
    )
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles), heights]), angles, radii


TUBE_FIELDS: dict[
    str, Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
] = {
    "breathe": lambda a, z: (np.ones_like(a), 0.0 * a, -0.3 * z),
    "twist C": lambda a, z: (0.0 * a, z, 0.0 * a),
    "stretch Z": lambda a, z: (0.05 * np.ones_like(a), 0.0 * a, z),
    "ovalize": lambda a, z: (np.cos(2 * a + 0.4), -0.5 * np.sin(2 * a + 0.4), 0.02 * z),
    "deform in 3 lobes": lambda a, z: (np.cos(3 * a), -np.sin(3 * a) / 3, 0.0 * a),
    "None": lambda a, z: (z**2 * np.cos(a), -(z**2) * np.sin(a), -0.1 * z * np.cos(a)),
}


@pytest.mark.parametrize("expected", list(TUBE_FIELDS))
def test_a_tube_is_named_by_the_waves_around_its_axis(expected: str) -> None:
    places, angles, _ = ring_points(0.1, 1.0)
    radial, around, along = TUBE_FIELDS[expected](angles, places[:, 2] * 10.0)
    field = np.column_stack(
        [
            radial * np.cos(angles) - around * np.sin(angles),
            radial * np.sin(angles) + around * np.cos(angles),
            along,
        ]
    )
    named = _name_around(np.array([0.0, 0.0, 1.0]), places, field, 2, slender=True)
    assert (str(named) if named is None else " ".join(named).strip()) == expected


@cases
def test_a_disc_is_named_by_its_nodal_diameters(waves: int, expected: str) -> None:
    places, angles, radii = ring_points(0.1, 0.005)
    field = np.column_stack([np.zeros((600, 2)), (radii / 0.1) ** 2 * np.cos(waves * angles + 0.3)])
    assert (
        " ".join(present(_name_around(np.array([0.0, 0.0, 1.0]), places, field, 2, slender=False)))
        == expected
    )


def test_a_ball_breathes_twists_or_deforms_and_has_no_direction() -> None:
    places = np.random.default_rng(1).standard_normal((600, 3))
    assert _name_on_ball(places, 0.1 * places) == ("breathe", "")
    assert _name_on_ball(places, np.cross([0.0, 0.0, 1.0], places) * places[:, 2:]) == ("twist", "")
    assert _name_on_ball(places, places * [1.0, -1.0, 0.0]) == ("deform", "")


def test_a_square_bar_is_not_round_and_a_cube_is_no_ball_though_their_moments_are_alike() -> None:
    cube = np.random.default_rng(2).uniform(-1.0, 1.0, (2000, 3))
    ball = cube[np.linalg.norm(cube, axis=1) < 1.0]
    tube, _, _ = ring_points(0.1, 1.0)
    bar, alike = cube * [0.1, 0.1, 1.0], np.array([1.0, 1.0, 1.001])
    assert _is_ball(alike, ball) and not _is_ball(alike, cube)
    # axes of rising moments: the long one first
    long_first, moments = np.eye(3)[:, [2, 0, 1]], np.array([0.1, 2.0, 2.0])
    assert present(_round_axis(moments, long_first, tube)).tolist() == [0.0, 0.0, 1.0]
    assert _round_axis(moments, long_first, bar) is None
    assert _round_axis(np.array([1.0, 1.5, 2.0]), long_first, tube) is None
    # boundary nodes alone do not tell
    assert _round_axis(moments, long_first, tube[:4]) is None
