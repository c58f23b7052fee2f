"""The elastic side gives the same answers on 1, 2 and 4 ranks, also with more ranks than cells."""

from pathlib import Path

import numpy as np
import pytest

import rank_program
from common import run_on_ranks
from headstock.geometry.frames import FloatArray

PROGRAM = Path(rank_program.__file__)
START = f"import runpy, sys; sys.path.append({str(PROGRAM.parent)!r}); runpy.run_path({str(PROGRAM)!r}, run_name='__main__')"
TOLERANCES = {
    "frequencies": 1e-9,
    "missing energy": 1e-4,  # in single precision
    "shape stiffness": 1e-4,
    "shape mass": 1e-8,
    "compliance": 1e-8,
    "mass": 1e-12,
    "plane": 1e-6,
    "displacement": 1e-8,
    "count": 0.0,
}


def run_on(ranks: int, folder: Path, *, iterative: bool) -> dict[str, FloatArray]:
    path = folder / "found.npz"
    more = ["iterative"] if iterative else []
    done = run_on_ranks(ranks, folder, "-c", START, str(path), *more)
    assert done.returncode == 0, done.stderr[-3000:]
    with np.load(path) as file:
        return dict(file)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, FloatArray]:
    path = tmp_path_factory.mktemp("ranks") / "one.npz"
    rank_program.main(path, iterative=True)
    with np.load(path) as file:
        return dict(file)


@pytest.mark.trials
@pytest.mark.parametrize(("ranks", "iterative"), [(2, True), (4, False), (4, True)])
def test_every_answer_is_that_of_one_rank(
    alone: dict[str, FloatArray], tmp_path: Path, ranks: int, iterative: bool
) -> None:
    found = run_on(ranks, tmp_path, iterative=iterative)
    compared = {name for name in alone if iterative or not name.startswith("iterative.")}
    assert found.keys() == compared
    for name in sorted(compared):
        exact = alone[name]
        kind = name.rsplit(".", 1)[1]
        tolerance = TOLERANCES.get(kind, 1e-8)
        if name.startswith("iterative."):
            # ends where a bound is fulfilled, which rounding decides
            tolerance = max(tolerance, 1e-6)
        if kind in ("frequencies", "count"):
            np.testing.assert_allclose(found[name], exact, rtol=tolerance, err_msg=name)
            continue
        scale = np.abs(exact).max()
        if kind == "compliance":
            scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
        assert (np.abs(found[name] - exact) / scale).max() < tolerance, name


def test_the_program_has_reached_every_kind_of_answer(alone: dict[str, FloatArray]) -> None:
    kinds = {name.rsplit(".", 1)[1] for name in alone}
    moved = {"moved by oil", "moved by gravity:z", "displacement"}
    wanted = {"frequencies", "compliance", "mass", "plane", "count", "missing energy"}
    assert kinds >= wanted | moved | {"shape stiffness"}
    assert alone["free.count"][0] == 8
