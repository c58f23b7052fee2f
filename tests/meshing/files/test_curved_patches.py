"""Patches on curved faces of meshes, facet by facet."""

from typing import Literal

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Material, MeshSettings, Patch
from headstock.geometry.parts.solids import Tube
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.regions import split_surface
from headstock.meshing.elements.surface import MeshSurface, extract_surface
from headstock.meshing.errors import MeshError
from headstock.meshing.files.patches import select_facets
from headstock.meshing.process.job import MeshData

pytestmark = pytest.mark.process

STEEL = Material("steel", 210e9, 0.3, 7850.0)
Shaft = tuple[MeshData, MeshSurface, FloatArray, str]


@pytest.fixture(scope="module")
def shaft() -> Shaft:
    """A mesh of a cylinder of 100 x 100 mm, the middles of its facets, and its round face."""
    component = Component("part", Tube(0.1, 0.0, 0.1), STEEL, mesh=MeshSettings(size=0.01))
    mesh = mesh_component(component)
    surface = extract_surface(mesh.cells[:, :4], "tet4")
    owners = split_surface(mesh.points, surface)
    round_face = int(np.argmax(np.bincount(owners)))
    middles = mesh.points[surface.facets].mean(axis=1)
    return MeshData(mesh.points, mesh.cells, mesh.kind), surface, middles, f"face:{round_face}"


@pytest.mark.parametrize(("center", "along"), [((0.05, 0, 0.05), "y"), ((0.03, -0.04, 0.05), "x")])
def test_a_strip_goes_all_around_a_cylinder(
    shaft: Shaft, center: tuple[float, float, float], along: Literal["x", "y"]
) -> None:
    data, surface, middles, face = shaft
    places = middles[select_facets(data, surface, Patch(face, "strip", center, (0.02,), along))]
    assert np.abs(places[:, 2] - 0.05).max() < 0.0101
    angles = np.sort(np.arctan2(places[:, 1], places[:, 0]))
    assert np.diff(angles, append=angles[0] + 2 * np.pi).max() < 0.2


def test_a_band_takes_what_lies_along_the_axis(shaft: Shaft) -> None:
    data, surface, middles, face = shaft
    band = select_facets(data, surface, Patch(face, "band", (0.01, 0.02, 0.05), (0.02,)))
    away = np.abs(middles[:, 2] - 0.05)
    inner, outer = (set(np.flatnonzero(away <= 0.01 + step)) for step in (-3e-4, 3e-4))
    assert len(inner) > 100 and inner <= set(band) <= outer


def test_a_ring_is_a_disk_without_the_disk_inside(shaft: Shaft) -> None:
    data, surface, _, _ = shaft
    disks = [
        select_facets(data, surface, Patch("z+", "disk", (0, 0, 0.1), (size,)))
        for size in (0.08, 0.03)
    ]
    ring = select_facets(data, surface, Patch("z+", "ring", (0, 0, 0.1), (0.08, 0.03)))
    assert len(ring) > 50 and set(ring) == set(disks[0]) - set(disks[1])


def test_a_strip_along_a_cylinder_stays_on_its_side(shaft: Shaft) -> None:
    data, surface, middles, face = shaft
    chosen = select_facets(data, surface, Patch(face, "strip", (0.05, 0, 0), (0.03,), "z"))
    assert middles[chosen, 0].min() > 0.04
    assert np.ptp(middles[chosen, 2]) > 0.09


def test_what_cannot_lie_on_a_face_is_refused(shaft: Shaft) -> None:
    data, surface, _, face = shaft
    with pytest.raises(MeshError, match="wraps around"):
        select_facets(data, surface, Patch(face, "disk", (0.05, 0, 0.05), (0.12,)))
    for where in (face, "z+"):
        along = "x" if where == face else "z"
        with pytest.raises(ValueError, match=f"axis in that face, not '{along}'"):
            select_facets(data, surface, Patch(where, "strip", (0.05, 0, 0.05), (0.02,), along))
