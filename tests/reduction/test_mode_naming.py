"""Names of modes say what bends, what moves and on what."""

import numpy as np
import pytest
from mpi4py import MPI

from headstock.geometry.machines import Pose
from headstock.reduction.body_motions import join_names
from headstock.reduction.coupling import couple
from headstock.reduction.elastic_reduction import reduce_elastic
from headstock.reduction.mode_naming import name_modes
from headstock.solvers.modal_analysis import solve_modal
from headstock.validation.lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

HOME = Pose("home")


def named(parts, count=6):
    coupled = couple(*parts, HOME)
    return name_modes(coupled, solve_modal(coupled.system, count=count))


def block_on_air(top_bolt):
    corners = {f"c{i}": (x, y, 0.0) for i, (x, y) in enumerate([(-0.5, -0.4), (0.5, -0.4), (0.5, 0.4), (-0.5, 0.4)], start=1)}
    base = rigid_body("base", 230.0, corners, inertia=(14.0, 21.0, 31.4))
    top = rigid_body("top", 20.0, {"foot": (0, 0, 0)}, inertia=(1.0, 1.0, 1.0))
    joints = [joint_between(f"air_{i}", "ground", f"base.c{i}", stiffness=(1.2e4, 1.3e4, 1.8e4, 0, 0, 0)) for i in range(1, 5)]
    bolt = joint_between("bolt", "base.c1", "top.foot", stiffness=np.full(6, top_bolt), point=(0.0, 0.0, 0.0))
    return lumped_machine([base, top], [*joints, bolt])


def test_modes_on_mounts_move_the_whole_machine_on_all_four():
    names = named(block_on_air(1e9)).names
    motions = ("moves X", "moves Y", "moves Z", "turns A", "turns B", "turns C")
    assert sorted(names) == sorted(f"whole machine {motion} on air_1..4" for motion in motions)


def test_a_body_that_moves_on_one_joint_is_named_with_it():
    bed = rigid_body("bed", 1e6, {"foot": (0, 0, 0)}, inertia=(1e6, 1e6, 1e6))
    slider = rigid_body("slider", 20.0, {"guide": (0, 0, 0)})
    joints = [
        joint_between("mount", "ground", "bed.foot", stiffness=np.full(6, 1e12)),
        joint_between("x_guide", "bed.foot", "slider.guide", stiffness=(1e6, 4e8, 5e8, 6e7, 7e7, 8e7)),
    ]
    assert named(lumped_machine([bed, slider], joints)).names[0] == "X translation of slider on x_guide"


@pytest.mark.parametrize(("soft", "expected"), [(0, "column bends X"), (1, "column bends Y"), (2, "column stretches Z")])
def test_a_component_that_deforms_is_named_with_its_direction(soft, expected):
    stiffness = np.full(6, 1e9)
    stiffness[soft] = 1e6
    column = two_node_body("column", 40.0, 0.5, stiffness)
    result = named(lumped_machine([column], [joint_between("foot", "ground", "column.foot", held=range(6))]), count=1)
    assert result.names[0].startswith(expected)
    assert result.strain_shares[0]["column"] > 0.9


def test_a_stout_column_bends_twists_and_stretches(make_box, make_component):
    column = make_component({"foot": "rigid", "tip": "average"}, modes=12, name="column", size=(0.4, 0.36, 0.9))
    mesh = make_box((2, 2, 4), (0.4, 0.36, 0.9), {"foot": "z-", "tip": "z+"}, kind="hex27")
    superelement = reduce_elastic(column, mesh, comm=MPI.COMM_SELF)
    names = named(
        lumped_machine([(column, superelement)], [joint_between("foot", "ground", "column.foot", held=range(6))]), count=6
    ).names
    assert names[:3] == ("column bends Y", "column bends X", "column twists C")
    assert names.count("column stretches Z") == 1


def test_names_do_not_change_from_run_to_run():
    assert named(block_on_air(1e6)).names == named(block_on_air(1e6)).names


def test_numbered_names_are_joined():
    assert join_names(["pad_3", "pad_1", "pad_2", "screw"]) == "pad_1..3 + screw"
    assert join_names(["pad_1", "pad_4"]) == "pad_1,4"
    assert join_names(["a", "b", "c", "d", "e"]) == "a + b + c + d ..."
