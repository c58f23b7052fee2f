"""the same machine on 1 to 4 ranks, also with a mesh of one cell: nothing is counted twice,
nothing changes its order.
"""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from common import rank_words, run_process
from fixture_machines import stored_scene
from headstock.geometry.frames import FloatArray

pytestmark = pytest.mark.hard("H41")

SCENE = stored_scene("ranks")
PROGRAM = """
import sys
from pathlib import Path
import numpy as np
from mpi4py import MPI
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.runner import run_scene
from headstock.scene.building.loader import load_scene
from headstock.studies.sweeps.runs import SweepJob, gather_sweep, run_sweep, select_analyses

comm, scene, out = MPI.COMM_WORLD, load_scene(Path(sys.argv[1])), Path(sys.argv[2])
results = run_scene(scene, out, comm=comm)
job = SweepJob(select_analyses(scene), scene.sweeps["line"], out)
outcome = run_sweep(job, comm=comm)
if comm.rank == 0:
    swept = gather_sweep(job, outcome)
    curves = find_answers(results.answers, PoseResponse)[0].curves
    np.savez(
        out / "found.npz",
        labels=np.array(results.labels),
        mass=results.components["block"].mass_kg,
        frequencies=results.modal[0].frequencies_hz,
        compliance=results.static["reference"]["tcp"].compliance,
        response_hz=curves.frequencies_hz,
        response=curves.receptance,
        swept=swept.frequencies_hz,
        figures=np.vstack(list(swept.figures.values())),
    )
"""


def solve_on(ranks: int, folder: Path) -> dict[str, FloatArray]:
    scene, out = folder / "scene.toml", folder / f"out{ranks}"
    scene.write_text(SCENE)
    more = {
        "HEADSTOCK_STORE": str(folder / f"store{ranks}"),
        "OMP_NUM_THREADS": "1",
        "HEADSTOCK_SPLIT_DOFS": "0",
    }
    if ranks == 1:  # in this process, which starts none
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("HEADSTOCK_STORE", more["HEADSTOCK_STORE"])
            patch.setattr(sys, "argv", ["", str(scene), str(out)])
            exec(PROGRAM, {})
    else:
        done = run_process(
            [*rank_words(ranks), "-P", "-c", PROGRAM, str(scene), str(out)],
            env=os.environ | more,
            timeout=120,
        )
        assert done.returncode == 0, done.stderr[-3000:]
    with np.load(out / "found.npz") as file:
        return dict(file)


# 2: tests/app/test_ranks.py
@pytest.mark.parametrize("several", [[3], pytest.param([3, 4], marks=pytest.mark.trials)])
def test_ranks_give_one_answer_although_the_mesh_has_one_cell(
    tmp_path: Path, several: list[int]
) -> None:
    alone = solve_on(1, tmp_path)
    assert several and alone["frequencies"].size
    for ranks in several:
        found = solve_on(ranks, tmp_path)
        assert found["labels"].tolist() == alone["labels"].tolist()
        assert abs(found["mass"] / alone["mass"] - 1.0) < 1e-14
        assert np.abs(found["frequencies"] / alone["frequencies"] - 1.0).max() < 1e-10
        assert np.abs(found["swept"] / alone["swept"] - 1.0).max() < 1e-10
        scale = np.abs(alone["compliance"]).max()
        assert np.abs(found["compliance"] - alone["compliance"]).max() < 1e-9 * scale
        # the grid refines itself around the resonances, so it is compared where it does not
        even = np.isclose(alone["response_hz"] % 50.0, 0.0, atol=1e-8)
        response = np.array(
            [
                np.interp(alone["response_hz"][even], found["response_hz"], part)
                for part in _parts(found)
            ]
        )
        wanted = np.array([part[even] for part in _parts(alone)])
        assert np.abs(response - wanted).max() < 1e-8 * np.abs(wanted).max()
        assert np.nanmax(np.abs(found["figures"] / alone["figures"] - 1.0)) < 1e-8


def _parts(found: dict[str, FloatArray]) -> list[FloatArray]:
    """Real and imaginary parts of every response."""
    flat = found["response"].reshape(len(found["response_hz"]), -1).T
    return [*flat.real, *flat.imag]
