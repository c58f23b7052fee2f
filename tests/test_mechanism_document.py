"""The Python of docs/mechanisms.md runs, and prints what the document says."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest

from common import approx

TEXT = (Path(__file__).resolve().parents[1] / "docs" / "mechanisms.md").read_text()


@pytest.fixture(scope="module")
def shown() -> tuple[str, dict[str, object]]:
    code = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    assert len(code) == 1
    names: dict[str, object] = {}
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code[0], "docs/mechanisms.md", "exec"), names)
    return printed.getvalue(), names


def test_the_document_prints_what_it_says(shown: tuple[str, dict[str, object]]) -> None:
    assert re.findall(r"```text\n(.*?)```", TEXT, re.DOTALL) == [shown[0]]


def test_its_stiffness_along_the_axis_is_that_of_three_inclined_springs(
    shown: tuple[str, dict[str, object]],
) -> None:
    # three springs in series with nothing, at the angle of the legs: k_z = 3 k cos^2
    length = np.hypot(1.0, 0.3)
    spring = 1.0 / (1.0 / 80e6 + 1.044 / 400e6)
    height = float(re.findall(r"z = ([\d.]+) m", shown[0])[0])
    assert height == approx(np.sqrt(1.044**2 - 0.3**2), abs=1e-4) and length == approx(
        1.044, abs=1e-3
    )
    along = float(re.findall(r"([\d.]+)\n$", shown[0])[0])
    assert 1e6 * along == approx(3.0 * spring * (height / 1.044) ** 2, rel=1e-3)
