"""How strongly a surface is strained, computed from its displacement alone, is what elasticity says of
the material below it.
"""

import numpy as np

from common import STEEL, make_faced
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import (
    MeshSettings,
    Patch,
    Support,
)
from headstock.geometry.parts.skins import box_skin, split_skin
from headstock.geometry.parts.solids import Box
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.components.skins import mesh_skin
from headstock.pipeline.results.views import SurfaceGauges, _skin_recovery
from reduced_parts import reduce_mesh


def strained(gradient: FloatArray) -> FloatArray:
    skin = split_skin(box_skin(np.zeros(3), np.array([1.0, 2.0, 3.0])))
    gauges = SurfaceGauges(skin.points, skin.triangles)
    return gauges.energy_density(skin.points @ gradient.T, STEEL)


def test_a_pulled_bar_holds_stress_squared_over_twice_the_modulus_on_its_free_faces() -> None:
    stress = 5e6
    sideways = -STEEL.poisson_ratio * stress / STEEL.youngs_modulus
    strain = np.diag(np.array([sideways, sideways, stress / STEEL.youngs_modulus]))
    density = strained(strain)
    skin = split_skin(box_skin(np.zeros(3), np.array([1.0, 2.0, 3.0])))
    free = (skin.points[:, 2] > 0.1) & (skin.points[:, 2] < 2.9)
    assert free.sum() > 5
    np.testing.assert_allclose(density[free], stress**2 / (2.0 * STEEL.youngs_modulus), rtol=1e-12)


def test_a_small_turn_strains_nothing() -> None:
    turn = np.array([[0.0, -3.0, 2.0], [3.0, 0.0, -1.0], [-2.0, 1.0, 0.0]])
    assert strained(turn).max() < 1e-20 * STEEL.youngs_modulus


def test_single_precision_and_triangles_without_area_do_no_harm() -> None:
    skin = box_skin(np.zeros(3), np.ones(3))
    triangles = np.vstack([skin.triangles, [[0, 0, 1], [2, 2, 2]]])
    shift = (skin.points * 1e-6).astype(np.float32)
    density = SurfaceGauges(skin.points, triangles).energy_density(shift, STEEL)
    np.testing.assert_allclose(
        density, 1e-12 * STEEL.youngs_modulus / (1.0 - STEEL.poisson_ratio), rtol=1e-5
    )


def test_a_bent_cantilever_is_strained_as_beam_theory_says() -> None:
    width, length, force = 0.04, 0.6, 1000.0
    solid, mesh_size = Box((width, width, length)), MeshSettings(size=0.01)
    component = make_faced("bar", solid, {"tip": "z+"}, mesh=mesh_size)
    supports = (Support("foot", "bar", (Patch("z-"),), ("x", "y", "z")),)
    mesh = mesh_component(component, supports, ())
    bar = reduce_mesh(component, mesh, supports)
    skin = mesh_skin(mesh)
    loads = np.zeros(len(bar.labels))
    loads[[label[-1] for label in bar.labels].index("x")] = force
    shift = (_skin_recovery(bar, skin) @ np.linalg.solve(bar.stiffness, loads)).reshape(-1, 3)
    density = SurfaceGauges(skin.points, skin.triangles).energy_density(shift, STEEL)
    x, y, z = skin.points.T
    inside = (
        (np.abs(x) > 0.499 * width)
        & (np.abs(y) < 0.3 * width)
        & (np.abs(z - 0.5 * length) < 0.3 * length)
    )
    assert inside.sum() > 50
    stress = force * (length - z) * 0.5 * width / (width**4 / 12.0)
    np.testing.assert_allclose(
        density[inside], (stress**2 / (2.0 * STEEL.youngs_modulus))[inside], rtol=0.03
    )
