"""The worker process that runs gmsh: ``python -m headstock.meshing.cad.worker``."""

import sys

from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.cad.faces import survey_shape
from headstock.meshing.cad.meshing import mesh_shape
from headstock.meshing.files.cells import guard_reader
from headstock.meshing.files.gmsh import read_gmsh
from headstock.meshing.process.job import MeshData, MeshJob
from headstock.meshing.process.worker import serve_job


def perform_job(job: MeshJob) -> MeshData:
    """Mesh, describe or survey a CAD shape, or read a gmsh mesh."""
    if isinstance(job.solid, MeshFile):
        return guard_reader(job.solid.path, read_gmsh, job.solid.solid)
    if job.task == "faces":
        return survey_shape(job)
    return mesh_shape(job)


if __name__ == "__main__":
    sys.exit(serve_job(sys.argv[1:], perform_job))
