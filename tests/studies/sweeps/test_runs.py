"""Sweeps: each pose gives what a run of it gives, nothing finished is lost, nothing is mixed, a
failed pose is seen.
"""

from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI

import headstock.studies.sweeps.runs
from common import approx, present
from faults.small_disks import limited_room
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.outputs import OutputError
from headstock.scene.building.loader import load_scene
from headstock.scene.studies import describe_positions
from headstock.studies.sweeps.files import SWEEP_FILE, write_sweep
from headstock.studies.sweeps.journals import (
    FOLDER,
    PoseResult,
    _decode_result,
    encode_result,
    open_journal,
    read_journals,
)
from headstock.studies.sweeps.poses import _MachinePoses, solve_machine_pose
from headstock.studies.sweeps.results import SweepResults
from headstock.studies.sweeps.runs import (
    Part,
    SweepJob,
    SweepOutcome,
    gather_sweep,
    run_sweep,
    select_analyses,
)

SCENE = Path(__file__).parents[2] / "data" / "slide.toml"
COMM = MPI.COMM_SELF


def make_job(
    folder: Path,
    name: str = "line",
    overrides: tuple[str, ...] = (),
    *,
    part: Part | None = None,
    retry: bool = False,
) -> SweepJob:
    folder.mkdir(exist_ok=True)
    scene = load_scene(SCENE, overrides=overrides)
    return SweepJob(select_analyses(scene), scene.sweeps[name], folder, part or Part(), retry=retry)


def publish(
    folder: Path, name: str = "line", overrides: tuple[str, ...] = (), *, retry: bool = False
) -> tuple[SweepOutcome, SweepResults]:
    job = make_job(folder, name, overrides, retry=retry)
    outcome = run_sweep(job, comm=COMM)
    results = gather_sweep(job, outcome)
    write_sweep(job.folder, results)
    return outcome, results


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("whole")
    publish(folder)
    return (folder / SWEEP_FILE).read_bytes()


def test_every_pose_gives_what_a_run_of_it_gives(tmp_path: Path) -> None:
    _, results = publish(tmp_path, "named")
    alone = run_scene(load_scene(SCENE), tmp_path / "run", comm=COMM)
    assert [pose.pose.name for pose in alone.modal] == ["left", "right"]
    frequencies, tcp = present(results.modes).frequencies_hz, results.points["tcp"]
    for number, modes in enumerate(alone.modal):
        np.testing.assert_allclose(frequencies[number, :5], modes.frequencies_hz, rtol=1e-10)
        point = alone.static[modes.pose.name]["tcp"]
        wanted = point.compliance[:3, :3]
        np.testing.assert_allclose(tcp.compliance[number], wanted, rtol=1e-8, atol=1e-16)
        for place, direction in enumerate("xyz"):
            shares, link = point.budget[direction], tcp.links[number][place]
            assert shares[link] == approx(tcp.link_shares[number, place], rel=1e-9)
            assert shares[link] == max(shares.values())


def test_the_largest_compliance_is_that_of_the_worst_direction(tmp_path: Path) -> None:
    point = publish(tmp_path, "named")[1].points["tcp"]
    assert len(point.compliance)
    points = zip(point.compliance, point.largest, point.direction, strict=True)
    for matrix, largest, direction in points:
        tried = np.random.default_rng(1).normal(size=(2000, 3))
        tried /= np.linalg.norm(tried, axis=1, keepdims=True)
        motions = np.einsum("ni,ij,nj->n", tried, matrix, tried)
        assert np.einsum("i,ij,j->", direction, matrix, direction) == approx(largest, rel=1e-12)
        assert 0.98 * largest < motions.max() <= largest * (1.0 + 1e-12)


def test_a_path_has_a_pose_every_step_and_at_every_corner(tmp_path: Path) -> None:
    sweep = make_job(tmp_path, "way").sweep
    places = sweep.positions[:, 0]
    assert len(places) == 1 + 8 + 2
    assert {-0.1, 0.2, 0.15} <= {round(float(place), 12) for place in places}
    assert np.abs(np.diff(places)).max() <= 0.04
    assert describe_positions(sweep, 0) == "X -100 mm"


def test_a_second_sweep_computes_nothing_and_writes_the_same_file(
    whole: bytes, tmp_path: Path
) -> None:
    assert publish(tmp_path)[0].computed == 9
    assert publish(tmp_path)[0].computed == 0
    assert (tmp_path / SWEEP_FILE).read_bytes() == whole


@pytest.mark.parametrize("cut", [0, 1, 700, 2000, 7001, None])
def test_a_journal_that_ends_anywhere_or_has_a_flipped_bit_loses_no_whole_pose(
    whole: bytes, tmp_path: Path, cut: int | None
) -> None:
    key = publish(tmp_path)[0].key
    (path,) = (tmp_path / FOLDER).iterdir()
    content = bytearray(path.read_bytes())
    if cut is None:
        content[len(content) // 2] ^= 4
    path.write_bytes(content[: len(content) - (cut or 0)])
    kept = len(read_journals(tmp_path, key))
    assert 0 < kept < 9 or not cut
    (tmp_path / SWEEP_FILE).unlink()
    assert publish(tmp_path)[0].computed == 9 - kept
    assert (tmp_path / SWEEP_FILE).read_bytes() == whole


@pytest.mark.parametrize("room", [0, 30])
def test_a_journal_that_has_no_room_for_its_head_is_left_empty(
    room: int, whole: bytes, tmp_path: Path
) -> None:
    job = make_job(tmp_path)
    with limited_room(tmp_path, (), limited_files=True) as set_room:
        set_room(room)
        full = r"journal cannot be written: .*(disk is full|too large)"
        with pytest.raises(OutputError, match=full):
            run_sweep(job, comm=COMM)
        set_room(None)
        (path,) = (tmp_path / FOLDER).iterdir()
        assert path.read_bytes() == b""
    assert publish(tmp_path)[0].computed == 9
    assert (tmp_path / SWEEP_FILE).read_bytes() == whole


def test_parts_together_are_the_whole(whole: bytes, tmp_path: Path) -> None:
    first = run_sweep(make_job(tmp_path, part=Part(1, 2)), comm=COMM)
    with pytest.raises(OutputError, match="4 of 9 poses are not computed"):
        first.complete()
    assert first.computed == 5
    assert run_sweep(make_job(tmp_path, part=Part(2, 2)), comm=COMM).computed == 4
    assert publish(tmp_path)[0].computed == 0
    assert (tmp_path / SWEEP_FILE).read_bytes() == whole


def test_a_changed_scene_takes_no_pose_of_the_old_one(tmp_path: Path) -> None:
    first = publish(tmp_path)[1]
    softer = ('joints.drive.stiffness.axial="40 N/um"',)
    outcome, second = publish(tmp_path, overrides=softer)
    assert outcome.computed == 9
    stiff, soft = (each.points["tcp"].compliance[:, 0, 0] for each in (first, second))
    assert (soft > 1.2 * stiff).all()
    assert publish(tmp_path)[0].computed == 0


def test_a_finer_grid_takes_the_poses_it_shares_with_the_coarse_one(tmp_path: Path) -> None:
    publish(tmp_path)
    finer = ('sweeps.line.axes={ X = ["-200 mm", "200 mm", 17] }',)
    assert run_sweep(make_job(tmp_path, overrides=finer), comm=COMM).computed == 8


def test_a_pose_that_fails_is_named_and_the_others_are_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail_in_one(
        shared: _MachinePoses, pose: Pose, positions: FloatArray, feed: FloatArray
    ) -> PoseResult:
        if pose.positions["X"] == 0.0:
            return PoseResult(positions, "failed", "coupling: the machine fell apart")
        return solve_machine_pose(shared, pose, positions, feed)

    with monkeypatch.context() as patch:
        patch.setattr(headstock.studies.sweeps.runs, "solve_machine_pose", fail_in_one)
        outcome, results = publish(tmp_path)
    assert outcome.computed == 9
    assert results.failed == (4,)
    assert "fell apart" in results.errors[4]
    assert np.isfinite(results.frequencies_hz[[0, 1, 2, 3, 5, 6, 7, 8]]).all()
    assert np.isnan(results.frequencies_hz[4]).all()
    with h5py.File(tmp_path / SWEEP_FILE) as file:
        assert file["states"][4] == b"failed"
    assert publish(tmp_path)[0].computed == 0
    again, mended = publish(tmp_path, retry=True)
    assert again.computed == 1
    assert mended.failed == ()


def test_a_result_survives_its_bytes() -> None:
    result = PoseResult(
        np.array([0.1, -2.0]),
        "failed",
        'why "so" – µm',
        np.array([1.0, 2.0]),
        1,
        0,
        np.ones((4, 2), dtype=np.float32),
        links=("a", "b", ""),
        figures=np.array([[np.nan, 1.0]]),
    )
    back = _decode_result(encode_result(result))
    np.testing.assert_equal(vars(back), vars(result))
    kinds = [
        {name: getattr(v, "dtype", type(v)) for name, v in vars(x).items()} for x in (back, result)
    ]
    assert kinds[0] == kinds[1]
    for length in range(len(encode_result(result))):
        with pytest.raises(ValueError, match=r".*"):
            _decode_result(encode_result(result)[:length])


def test_two_writers_of_one_journal_are_refused(tmp_path: Path) -> None:
    refused = pytest.raises(OutputError, match="another process writes")
    with open_journal(tmp_path, "k" * 64, "a"), refused:
        open_journal(tmp_path, "k" * 64, "a")
