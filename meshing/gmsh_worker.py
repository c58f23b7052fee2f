"""The child process that runs gmsh: ``python -m headstock.meshing.gmsh_worker``."""

import sys
from pathlib import Path

from headstock.meshing.cad_meshing import mesh_shape
from headstock.meshing.face_survey import survey_shape
from headstock.meshing.foreign_cells import guard_reader
from headstock.meshing.gmsh_meshes import read_gmsh_mesh
from headstock.meshing.mesh_job import MeshData, MeshJob
from headstock.meshing.mesh_worker import serve_job


def perform_job(job: MeshJob) -> MeshData:
    """Mesh, describe or survey a CAD shape, or read a gmsh mesh."""
    if job.task == "file":
        return guard_reader(Path(job.solid["path"]), read_gmsh_mesh)
    if job.task == "faces":
        return survey_shape(job)
    return mesh_shape(job)


if __name__ == "__main__":
    sys.exit(serve_job(sys.argv[1:], perform_job))
