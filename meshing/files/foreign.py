"""Reads finished meshes of Abaqus and Nastran in a worker process: ``python -m
headstock.meshing.files.foreign``.
"""

import sys

from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.errors import MeshError
from headstock.meshing.files.abaqus import read_abaqus
from headstock.meshing.files.cells import guard_reader
from headstock.meshing.files.nastran import read_nastran
from headstock.meshing.process.job import MeshData, MeshJob
from headstock.meshing.process.worker import serve_job


def perform_job(job: MeshJob) -> MeshData:
    """Read an Abaqus or Nastran mesh."""
    if not isinstance(job.solid, MeshFile):
        raise MeshError(f"a {type(job.solid).__name__} is no mesh file")
    path = job.solid.path
    reader = read_abaqus if path.suffix.lower() == ".inp" else read_nastran
    return guard_reader(path, reader, job.solid.solid)


if __name__ == "__main__":
    sys.exit(serve_job(sys.argv[1:], perform_job))
