"""Walls of single tetrahedra that lock in bending: by how much, and where that is foreseeable before
anything is meshed.
"""

import math

from headstock.geometry.parts.components import Component, Material
from headstock.geometry.parts.solids import Box, MeshFile, ParametricSolid
from headstock.meshing.components.mesh_request import element_size
from headstock.meshing.sizing import largest_extent, thinnest_feature
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.scene import Scene

# Share by which single tet10 across a wall raise a frequency, over (L / wavelength)^4 (L / t)^2: 15
# to 60 in square plates of 1:200 and 1:1000 with hinged and clamped edges
LOCKING = 30.0
LOCKED = 0.03
MANY_TIMES = 0.5


def locking_share(
    material: Material, flatness: float, highest_hz: float, *, extent: float, thickness: float
) -> float:
    """Return the share by which single tetrahedra across walls raise a frequency.

    Second-order tets bend without shear only as far as piecewise quadratics without kinks do, of
    which irregular meshes have few.

    Args:
        flatness: Mean of ``L^6 / t^4`` over the mesh, ``MeshQuality.flatness`` [m^2].
        highest_hz: Highest frequency of interest [Hz]; of a static answer alone 0: then waves as
            long as the part count.
        extent: Longest side of the part [m].
        thickness: Of its walls [m].
    """
    if highest_hz > 0.0:
        stiffness = material.youngs_modulus / (12.0 * (1.0 - material.poisson_ratio**2))
        # wavelength^4 over t^2 of bending waves
        waves = (2.0 * math.pi / highest_hz) ** 2 * stiffness / material.density
    else:
        waves = extent**4 / thickness**2
    return LOCKING * flatness / waves


def describe_locking(component: Component, share: float, *, size: float, thickness: float) -> str:
    """Return the warning of walls that lock, with a mesh that does not.

    Args:
        share: By which frequencies are too high.
        size: Length of the tetrahedra [m].
        thickness: Of the walls that they fill [m].
    """
    smaller = float(f"{size * (0.01 / share) ** (1.0 / 6.0):.2g}")
    amount = f"about {float(f'{100.0 * share:.1g}'):g} %" if share < MANY_TIMES else "many times"
    mesh = component.mesh
    plain = mesh.growth is None and mesh.smallest is None and mesh.sizes is None
    cure = ', or cells = "hex"' if isinstance(component.solid, Box) and plain else ""
    finer = write_finer_mesh(component, smaller)
    return (
        f"component {component.name!r}: single tetrahedra of {1e3 * size:.3g} mm across walls of"
        f" {1e3 * thickness:.3g} mm lock in bending, so frequencies may be {amount} too high;"
        f" {finer}{cure}"
    )


def write_finer_mesh(component: Component, size: float) -> str:
    """Return how a user gets a mesh with smaller elements [m], every other setting as it is."""
    if isinstance(component.solid, MeshFile):
        return f"mesh {component.solid.path.name} with elements of {1e3 * size:g} mm"
    return f"write {component.mesh.resize(size)}"


def foresee_locking(scene: Scene) -> list[str]:
    """Warnings of parametric solids whose element size makes frequencies many times too high; less is
    left to the run, which knows the tetrahedra (``L^6 / t^4`` was 0.2 to 10 times that of size and
    thinnest wall on castings) and how walls are loaded. None where sizes are chosen for an accuracy.
    """
    modal, frf = scene.analyses.get(ModalRequest), scene.analyses.get(FrfRequest)
    highest_hz = max(
        0.0 if modal is None or modal.up_to_hz is None else modal.up_to_hz,
        0.0 if frf is None else frf.to_hz,
    )
    warnings = []
    chosen = scene.accuracy is not None or scene.is_lumped
    for component in () if chosen else scene.machine.components.values():
        solid, mesh = component.solid, component.mesh
        if (
            component.fidelity != "elastic"
            or not isinstance(solid, ParametricSolid)
            or (mesh.cells, mesh.order) != ("tet", 2)
            or not component.material.density > 0.0
        ):
            continue
        size, thickness = element_size(component), thinnest_feature(solid)
        share = (
            locking_share(
                component.material,
                size**6 / thickness**4,
                highest_hz,
                extent=largest_extent(solid),
                thickness=thickness,
            )
            if size > thickness
            else 0.0
        )
        if share > MANY_TIMES:
            warnings.append(describe_locking(component, share, size=size, thickness=thickness))
    return warnings
