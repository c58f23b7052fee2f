"""Files of measured receptances: every fault is named with its line."""

from pathlib import Path

import numpy as np
import pytest

from cases import cases
from common import approx
from headstock.scene.reading.csv_files import CsvError, read_receptances


def test_columns_become_complex_and_their_order_is_free(tmp_path: Path) -> None:
    path = tmp_path / "tool.csv"
    path.write_text(
        "base_im,frequency,tip_re,tip_im,cross_re,cross_im,base_re\n6,10,1,2,3,4,5\n0,20,1,1,1,1,1\n"
    )
    found = read_receptances(path, (0.0, 0.0, 1.0))
    assert found.tip[0], found.cross[0] == (1 + 2j, 3 + 4j)
    assert found.base[0] == 5 + 6j
    np.testing.assert_allclose(found.across.T @ [0.0, 0.0, 1.0], 0.0, atol=1e-15)
    tip, _, _ = found.at(2.0 * np.pi * np.array([15.0]))
    assert tip[0] == approx(1 + 1.5j)


@cases
def test_a_fault_is_named_with_its_line(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "tool.csv"
    path.write_text(content)
    with pytest.raises(CsvError, match=words):
        read_receptances(path, (0.0, 0.0, 1.0))
