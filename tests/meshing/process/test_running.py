import os
from pathlib import Path

import pytest

from common import approx
from faults.small_disks import limited_room
from headstock.geometry.parts.solids import Box
from headstock.meshing.errors import MeshError
from headstock.meshing.process.job import MeshJob
from headstock.meshing.process.running import run_job
from headstock.studies.parameters.runs import _blames_surroundings

pytestmark = [pytest.mark.process, pytest.mark.workers]

BOX = Box((100.0, 40.0, 1000.0))


def test_child_that_needs_more_memory_than_allowed_is_named() -> None:
    job = MeshJob("mesh", BOX, size=6.0, straight=True)
    with pytest.raises(MeshError, match=r"column: .*memory"):
        run_job(job, what="column", time_limit=60.0, memory_bytes=350 << 20)


def test_child_without_room_for_its_mesh_is_named_and_the_mesh_is_not_blamed() -> None:
    job = MeshJob("mesh", BOX, size=50.0, straight=True)
    with limited_room(Path(), (), limited_files=True) as set_room:
        set_room(1000)
        with pytest.raises(MeshError, match=r"column: .*File too large.*make room") as caught:
            run_job(job, what="column", time_limit=60.0)
    assert _blames_surroundings(caught.value)
    assert not _blames_surroundings(MeshError("column: a cell is inverted"))


def test_child_does_not_import_from_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gmsh.py").write_text("raise SystemExit(9)")
    monkeypatch.chdir(tmp_path)
    data = run_job(
        MeshJob("describe", BOX, size=50.0, straight=True), what="column", time_limit=60.0
    )
    assert data.properties is not None
    assert data.properties.volume == approx(4e6)


def test_child_does_not_see_the_mpi_launcher(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "4")
    monkeypatch.setenv("PMIX_NAMESPACE", "nowhere")
    seen: dict[str, str] = {}

    def record(command: list[str], *, env: dict[str, str], **_: object) -> None:
        seen.update(env)
        raise OSError("recorded")

    monkeypatch.setattr("subprocess.Popen", record)
    with pytest.raises(OSError, match="recorded"):
        run_job(MeshJob("describe", BOX), what="column", time_limit=1.0)
    assert not any(name.startswith(("OMPI_", "PMIX_")) for name in seen)
    assert seen["PATH"] == os.environ["PATH"]
