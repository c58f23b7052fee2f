"""The ± of responses under control, over frequency and over time, beside a finer mesh of the same
machine.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.transient import TransientAnswer
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene

SCENE = Path(__file__).parents[2] / "data" / "slide.toml"
DRIVE = (
    '{inertia="2e-3 kg m^2", lead="10 mm", kv="40 1/s", velocity_gain="4e4 N s/m",'
    ' integral_time="20 ms", sampling="250 us"}'
)
RESPONSE = (
    'inputs=["tcp"{command}], from="5 Hz", up_to="400 Hz", points=80, adaptive=false, poses=["left"],'
    ' motors="{motors}"'
)
IN_TIME = (
    'duration="60 ms", up_to="500 Hz", outputs=[["tcp", "x"], ["tcp", "z"]], poses=["left"], motors="{motors}",'
    ' loads={{ hit={{ at=["tcp", "z"], shape="half_sine", size="100 N", time="4 ms" }} }}'
)
COARSE, FINE = "49 mm", "16 mm"
# times the true error, in the median: rims of feet and single hexahedra are judged safely
MOST = 10.0
NEAR = 1.1  # of that, beside the same with motors locked


def respond(size: str, motors: str, folder: Path) -> tuple[PoseResponse, TransientAnswer]:
    command = ', ["X", "command"]' if motors == "controlled" else ""
    overrides = (
        'components.bed.fidelity="elastic"',
        f'components.bed.mesh={{cells="hex", size="{size}"}}',
        f"drives.X={DRIVE}",
        "effects.drive_control=true",
        'effects.damping={modal="3 %"}',
        "analyses.frf={" + RESPONSE.format(motors=motors, command=command) + "}",
        "analyses.transient={" + IN_TIME.format(motors=motors) + "}",
    )
    scene = load_scene(SCENE, overrides=overrides)
    results = run_scene(
        scene, folder / size / motors, comm=MPI.COMM_SELF, store=Store(folder / "store")
    )
    (moved,) = find_answers(results.answers, TransientAnswer)
    return results.frf["left"], moved


def find_errors(coarse: PoseResponse, fine: PoseResponse) -> tuple[FloatArray, FloatArray]:
    """Errors of a coarse mesh as estimated, and as far as a fine one tells them, each line and
    channel by itself.
    """
    error = coarse.curves.error
    assert error is not None and np.isfinite(error).all()
    return error, np.abs(coarse.curves.receptance - fine.curves.receptance)


@pytest.mark.fem
@pytest.mark.process
def test_the_error_of_a_mesh_is_covered_while_loops_are_closed(tmp_path: Path) -> None:
    ratios = []
    for motors in ("locked", "controlled"):
        (coarse, moved), (fine, better_moved) = (
            respond(size, motors, tmp_path) for size in (COARSE, FINE)
        )
        for own, better, error in zip(
            moved.figures, better_moved.figures, moved.errors.values(), strict=True
        ):
            assert error.total is not None
            assert 0.0 < abs(abs(own.peak) - abs(better.peak)) < error.total
        assert coarse.error_left_out == ("rigid model of slide",)
        both = find_errors(coarse, fine)
        estimated, true = (values[..., :3] for values in both)
        assert (true <= estimated).mean() > 0.95
        sizes = np.abs(fine.curves.receptance)
        if motors == "controlled":  # the tool along X, as its set point moves
            given, missed = (values[:, 0, 3] for values in both)
            assert (missed <= given).mean() > 0.95
            assert 1.0 < np.median((given / missed)[missed > 1e-6 * sizes[:, 0, 3]]) < MOST
        seen = true > 1e-3 * sizes[..., :3].max(axis=(1, 2), keepdims=True)
        assert seen.sum() > 200  # the others are at rest by symmetry, or nearly
        ratios.append(float(np.median(estimated[seen] / true[seen])))
        assert 1.0 < ratios[-1] < MOST
        for point, better_point in zip(coarse.figures, fine.figures, strict=True):
            assert (
                point.most_negative_real is not None and better_point.most_negative_real is not None
            )
            total = coarse.errors[coarse.figure_key(point.channel)].total
            away = abs(point.most_negative_real - better_point.most_negative_real)
            assert total is not None and away < total
    assert 1.0 / NEAR < ratios[1] / ratios[0] < NEAR
