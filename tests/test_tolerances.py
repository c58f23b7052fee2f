"""A comparison of small numbers can fail: no absolute tolerance stands beside a relative one unless
it is written.
"""

import ast
from pathlib import Path

from common import approx

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = (
    "geometry",
    "meshing",
    "solvers",
    "reduction",
    "pipeline",
    "validation",
    "app",
    "benchmarks",
    "tests",
)


def compares_unawares(node: ast.Call) -> bool:
    """Whether a call is one of numpy's ``allclose`` or ``isclose`` with their own absolute
    tolerance of 1e-8.
    """
    return ast.unparse(node.func) in ("np.allclose", "np.isclose") and "atol" not in {
        word.arg for word in node.keywords
    }


def test_numbers_below_pytest_s_own_absolute_tolerance_are_told_apart() -> None:
    assert approx(1.1e-13, rel=1e-3) != 1.0e-13
    assert approx(1.0001e-13, rel=1e-3) == 1.0e-13
    assert approx([1.1e-13], rel=1e-3) != [1.0e-13]


def test_no_test_compares_with_pytest_s_own_absolute_tolerance() -> None:
    files = sorted((ROOT / "tests").rglob("*.py"))
    ways = {f"{path.name}" for path in files if "pytest" + ".approx(" in path.read_text()}
    assert ways == {"common.py"}


def test_every_numpy_comparison_states_its_absolute_tolerance() -> None:
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    calls = {
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in files
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and compares_unawares(node)
    }
    assert len(files) > 400 and calls == set()
