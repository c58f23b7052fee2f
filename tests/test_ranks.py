"""The elastic side gives the same answers on 1, 2 and 4 ranks, also with more ranks than cells."""

import os
from pathlib import Path

import numpy as np
import pytest

import rank_program
from common import rank_words, run_process
from headstock.geometry.frames import FloatArray

PROGRAM = Path(rank_program.__file__)
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


def run_on(ranks: int, path: Path, *, iterative: bool = True) -> dict[str, FloatArray]:
    # what this process knows of a launcher of its own must not reach the new one
    inherited = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("PMI_", "PMIX_", "PRTE_", "OMPI_COMM_"))
    }
    folder = str(PROGRAM.parent.parent / ".typing")
    paths = os.pathsep.join([folder, *filter(None, [inherited.get("PYTHONPATH")])])
    more = {
        "OMP_NUM_THREADS": "1",
        "OMPI_MCA_mpi_yield_when_idle": "1",  # as the launcher has it
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "PYTHONPATH": paths,
    }
    command = [*rank_words(ranks), str(PROGRAM), str(path), *(["iterative"] if iterative else [])]
    done = run_process(command, env=inherited | more, timeout=300)
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
    found = run_on(ranks, tmp_path / "found.npz", iterative=iterative)
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
        scale = (
            np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
            if kind == "compliance"
            else np.abs(exact).max()
        )
        assert (np.abs(found[name] - exact) / scale).max() < tolerance, name


def test_the_program_has_reached_every_kind_of_answer(alone: dict[str, FloatArray]) -> None:
    kinds = {name.rsplit(".", 1)[1] for name in alone}
    assert kinds >= {
        "frequencies",
        "compliance",
        "mass",
        "plane",
        "displacement",
        "count",
        "missing energy",
        "shape stiffness",
        "moved by oil",
        "moved by gravity:z",
    }
    assert alone["free.count"][0] == 8
