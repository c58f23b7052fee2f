"""A coupling that remembers the last pose gives, bit by bit, what one that remembers nothing
gives.
"""

from pathlib import Path

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.reduction.coupling import elimination
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.scene.building.loader import load_scene
from scene_runs import reduce_parts

SCENE = Path(__file__).parents[2] / "data" / "slide.toml"
MACHINE = Path(__file__).parents[3] / "machines" / "three_axis.toml"


@pytest.mark.parametrize("fixed", [False, True])
def test_every_matrix_is_that_of_a_coupling_without_a_memo(fixed: bool) -> None:
    overrides = (
        ['joints.carriage.stiffness.roll="rigid"', 'joints.foot_2.stiffness.x="1 MN/um"']
        if fixed
        else []
    )
    machine = load_scene(SCENE, overrides=overrides).machine
    parts = reduce_parts(machine.components)
    memo = CouplingMemo({"tcp"})
    assert machine.axes.keys() == {"X"}
    for place in (0.0, 0.1, 0.1, -0.2, 0.0):
        pose = Pose("p", {"X": place})
        quick, plain = couple(parts, machine, pose, memo=memo), couple(parts, machine, pose)
        for name in ("mass", "stiffness"):
            assert getattr(quick.system, name).tobytes() == getattr(plain.system, name).tobytes()
        assert set(quick.system.inputs) == {
            ("tcp", dof) for dof in ("x", "y", "z", "rx", "ry", "rz")
        }
        for channel, row in quick.system.inputs.items():
            assert np.array_equal(row, plain.system.inputs[channel])
        assert quick.system.labels == plain.system.labels


def test_what_components_alone_decide_is_split_once_for_all_poses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = load_scene(MACHINE, variant="segmented").machine
    parts = reduce_parts(machine.components)
    memo, sizes = CouplingMemo({"tcp"}), list[list[int]]()
    original = elimination._split_space

    def count(rows: FloatArray, null: FloatArray) -> object:
        sizes[-1].append(null.shape[1])
        return original(rows, null)

    monkeypatch.setattr(elimination, "_split_space", count)
    for place in (0.0, 0.03, 0.06):
        sizes.append([])
        couple(parts, machine, Pose("p", {"X": place}), memo=memo)
    assert max(sizes[0]) > 50
    assert max([*sizes[1], *sizes[2]], default=0) < 30
