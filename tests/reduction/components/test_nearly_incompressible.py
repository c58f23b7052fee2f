"""Poisson's ratio near one half: no volumetric locking up to 0.499 with second-order
elements.
"""

import dataclasses

import numpy as np
import pytest

from common import make_component, present, tag_patches
from headstock.geometry.parts.components import Load, Patch, Support
from headstock.meshing.component_mesh import CellKind, ComponentMesh
from headstock.validation.parts.structured_meshes import (
    integrate_over_cells,
    lattice_mesh,
    straight_lattice,
)
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H09")

INNER, OUTER, HEIGHT = 0.1, 0.2, 0.02
PRESSURE = 1e6


def cylinder(kind: CellKind) -> ComponentMesh:
    """A quarter of a thick cylinder in plane strain, curved second-order elements."""
    lattice = straight_lattice((5, 6, 1), (1.0, 1.0, HEIGHT))
    radius, angle = INNER + (OUTER - INNER) * lattice[..., 0], 0.5 * np.pi * lattice[..., 1]
    curved = np.stack([radius * np.cos(angle), radius * np.sin(angle), lattice[..., 2]], axis=-1)
    mesh = lattice_mesh(lattice, kind, straight=False)
    points = curved.reshape(-1, 3)
    # patches are chosen on the flat lattice, where its sides are planes
    groups = {
        "load:oil": "x-",
        "support:y_plane": "y-",
        "support:x_plane": "y+",
        "support:low": "z-",
        "support:high": "z+",
    }
    tagged = tag_patches(mesh, groups)
    volume = float(integrate_over_cells(points, mesh.cells, kind, lambda x: np.ones(len(x))))
    return dataclasses.replace(
        tagged, points=points, quality=dataclasses.replace(mesh.quality, volume=volume)
    )


def radial_displacement(young: float, poisson: float) -> float:
    """Of the inner wall in plane strain.

    Source: Lame (1852).
    """
    ratio = (OUTER / INNER) ** 2
    return (
        (1.0 + poisson) * PRESSURE * INNER / (young * (ratio - 1.0)) * (1.0 - 2.0 * poisson + ratio)
    )


@pytest.mark.parametrize("kind", ["hex27", "tet10"])
@pytest.mark.parametrize(("poisson", "tolerance"), [(0.3, 1e-3), (0.49, 0.005), (0.499, 0.02)])
def test_a_thick_cylinder_under_pressure_widens_as_lame_says(
    kind: CellKind, poisson: float, tolerance: float
) -> None:
    mesh = cylinder(kind)
    material = dataclasses.replace(make_component().material, poisson_ratio=poisson)
    component = make_component(material=material)
    supports = (
        Support("y_plane", "body", (Patch("y-"),), ("y",)),
        Support("x_plane", "body", (Patch("x-"),), ("x",)),
        Support("low", "body", (Patch("z-"),), ("z",)),
        Support("high", "body", (Patch("z+"),), ("z",)),
    )
    load = Load("oil", "body", "pressure", (Patch("inner"),), magnitude=PRESSURE)
    element = reduce_mesh(component, mesh, supports, (load,))
    moved = present(element.loads["oil"].particular).reshape(-1, 3)
    radii = np.linalg.norm(mesh.points[:, :2], axis=1)
    inside = np.abs(radii - INNER) < 1e-9
    radial = np.einsum("ij,ij->i", moved[inside, :2], mesh.points[inside, :2]) / radii[inside]
    exact = radial_displacement(material.youngs_modulus, poisson)
    assert np.abs(radial / exact - 1.0).max() < tolerance
