"""Files of measured receptances: every fault is named with its line."""

from pathlib import Path

import numpy as np
import pytest

from built_uff import SPECTRUM, text_58
from cases import cases
from common import approx
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.tool_receptances import read_tool
from headstock.solvers.milling.tool_dynamics import couple_assembly


def test_columns_become_complex_and_their_order_is_free(tmp_path: Path) -> None:
    path = tmp_path / "tool.csv"
    path.write_text(
        "base_im,frequency,tip_re,tip_im,cross_re,cross_im,base_re\n6,10,1,2,3,4,5\n0,20,1,1,1,1,1\n"
    )
    found = read_tool(path, (0.0, 0.0, 1.0))
    assert found.tip[0], found.cross[0] == (1 + 2j, 3 + 4j)
    assert found.base[0] == 5 + 6j
    np.testing.assert_allclose(found.across.T @ [0.0, 0.0, 1.0], 0.0, atol=1e-15)
    tip, _, _ = found.at(2.0 * np.pi * np.array([15.0]))
    assert tip[0] == approx(1 + 1.5j)


def test_a_universal_file_gives_the_same_receptances_whatever_the_signs(tmp_path: Path) -> None:
    pytest.importorskip("pyuff")
    ends = [((1, 1), (1, 1), 1.0), ((7, -1), (1, 1), -1.0), ((7, 1), (7, 1), 1.0)]
    path = tmp_path / "tool.uff"
    path.write_bytes(
        b"".join(
            text_58(sign * (number + 1) * SPECTRUM, motion=motion, force=force, kinds=(8, 13))
            for number, (motion, force, sign) in enumerate(ends)
        )
    )
    tool = read_tool(path, (0.0, 0.0, 1.0))
    for part, factor in ((tool.tip, 1), (tool.cross, 2), (tool.base, 3)):
        np.testing.assert_allclose(part, factor * SPECTRUM, rtol=1e-11)


def test_one_receptance_alone_is_that_of_the_mounted_tool(tmp_path: Path) -> None:
    path = tmp_path / "tool.frf"
    path.write_text("Hz re im\n10 1e-6 -2e-6\n20 3e-6 -4e-6\n")
    tool = read_tool(path, (0.0, 0.0, 1.0))
    omega = 2.0 * np.pi * np.array([10.0, 20.0])
    machine = 1e-7 * np.stack([np.eye(3)] * 2) + 0j
    coupled = couple_assembly(machine, omega, tool)
    np.testing.assert_allclose(coupled[:, 0, 0], [1e-6 - 2e-6j, 3e-6 - 4e-6j])
    np.testing.assert_allclose(coupled[:, 2, 2], 1e-7)


@cases
def test_a_fault_is_named_with_its_line(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "tool.csv"
    path.write_text(content)
    with pytest.raises(MeasurementError, match=words):
        read_tool(path, (0.0, 0.0, 1.0))
