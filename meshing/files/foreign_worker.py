"""The child process that runs foreign readers: ``python -m headstock.meshing.files.foreign_worker``."""

import sys
from pathlib import Path

from headstock.meshing.files.cells import guard_reader
from headstock.meshing.files.foreign import read_abaqus_mesh, read_nastran_mesh
from headstock.meshing.process.job import MeshData, MeshJob
from headstock.meshing.process.worker import serve_job


def perform_job(job: MeshJob) -> MeshData:
    """Read an Abaqus or Nastran mesh."""
    path = Path(job.solid["path"])
    return guard_reader(path, read_abaqus_mesh if path.suffix.lower() == ".inp" else read_nastran_mesh)


if __name__ == "__main__":
    sys.exit(serve_job(sys.argv[1:], perform_job))
