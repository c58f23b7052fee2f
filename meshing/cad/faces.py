"""Lists and triangulates the faces of a CAD shape (runs in the worker process)."""

import dataclasses

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import CadFace, FaceKind, Vector, fit_cylinder
from headstock.meshing.cad.meshing import TRIANGLE, open_kernel, require_shape, shape_bounds
from headstock.meshing.cad.shapes import boundary_faces, build_shape, read_nodes
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.process.job import MeshData, MeshJob

KINDS: dict[str, FaceKind] = {
    "Plane": "plane",
    "Cylinder": "cylinder",
    "Cone": "cone",
    "Sphere": "sphere",
    "Torus": "torus",
}
COARSEST, FINEST, TURNS = 12.0, 120.0, 12.0
# of lengths of edges over element sizes; gmsh's 1e-9 asks splines for their curvature for a minute
LENGTH_PRECISION = 1e-3


def survey_shape(job: MeshJob) -> MeshData:
    """List the faces of a shape and triangulate them as for a picture.

    Returns:
        Points, one facet group ``face:N`` per face (outward; empty where a face could not be
        meshed) and ``faces``.
    """
    with open_kernel():
        volume = build_shape(require_shape(job))
        low, high = shape_bounds(volume)
        extent = float((high - low).max())
        gmsh.option.setNumber("Mesh.LcIntegrationPrecision", LENGTH_PRECISION)
        # a picture needs no even triangles, which take splines two fifths of the time
        gmsh.option.setNumber("Mesh.Smoothing", 0)
        for name, value in (
            ("Max", extent / COARSEST),
            ("Min", extent / FINEST),
            ("FromCurvature", TURNS),
        ):
            gmsh.option.setNumber(f"Mesh.MeshSize{name}", value)
        try:
            gmsh.model.mesh.generate(2)
        except (
            Exception
        ) as error:  # gmsh raises the bare class; faces that did mesh can still be shown
            gmsh.logger.write(str(error), "warning")
        points, row = read_nodes()
        facets: dict[str, IntArray] = {}
        faces: list[CadFace] = []
        for number, tag in enumerate(boundary_faces(volume), 1):
            _, nodes = gmsh.model.mesh.getElementsByType(TRIANGLE[1], tag)
            facets[f"face:{number}"] = row[nodes].reshape(-1, 3)
            faces.append(_describe_face(number, tag, points, facets[f"face:{number}"]))
        return MeshData(points, np.zeros((0, 4), dtype=np.int64), None, facets, faces=faces)


def _describe_face(number: int, tag: int, points: FloatArray, facets: IntArray) -> CadFace:
    box = np.array(gmsh.model.occ.getBoundingBox(2, tag))
    kind = KINDS.get(gmsh.model.getType(2, tag), "freeform")
    # the kernel integrates splines slowly
    drawn = kind == "freeform" and len(facets)
    center = _find_middle(points[facets]) if drawn else gmsh.model.occ.getCenterOfMass(2, tag)
    face = CadFace(
        number=number,
        kind=kind,
        area=float(gmsh.model.occ.getMass(2, tag)),
        center=_vector(np.array(center)),
        normal=(0.0, 0.0, 0.0),
        low=_vector(box[:3]),
        high=_vector(box[3:]),
    )
    if not len(facets):
        return face
    corners = points[facets]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(crosses, axis=1)
    sound = lengths > 1e-9 * lengths.max()
    normals = crosses[sound] / lengths[sound, None]
    largest = int(np.argmax(lengths[sound]))
    face = dataclasses.replace(face, normal=_vector(normals[largest]))
    if face.kind != "cylinder":
        return face
    _, _, parameters = gmsh.model.mesh.getNodes(
        2, tag, includeBoundary=True, returnParametricCoord=True
    )
    exact = np.array(gmsh.model.getNormal(tag, parameters)).reshape(-1, 3)  # either way round
    axis, on_axis, radius = fit_cylinder(points[np.unique(facets)], exact)
    outwards = corners[sound][largest].mean(axis=0) - on_axis
    along = points[np.unique(facets)] @ axis
    return dataclasses.replace(
        face,
        radius=radius,
        axis=_vector(axis),
        axis_point=_vector(on_axis),
        span=(float(along.min()), float(along.max())),
        hollow=bool(outwards @ normals[largest] < 0.0),
    )


def _find_middle(corners: FloatArray) -> FloatArray:
    """Return the centroid ``(3,)`` of triangles with corners ``(n, 3, 3)``."""
    sides = corners[:, 1:] - corners[:, :1]
    sizes = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return np.asarray(sizes @ corners.mean(axis=1) / sizes.sum())


def _vector(values: FloatArray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
