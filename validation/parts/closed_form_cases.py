"""Bodies of the benchmarks, and cases that compare closed forms with their tabled values: no finite
elements.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import (
    Component,
    Interface,
    Material,
    MeshSettings,
    Patch,
    ReductionSettings,
    Support,
)
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import CellKind
from headstock.solvers.mpi import MPI
from headstock.validation.references.beam_theory import (
    PrismaticBeam,
    axial_extension,
    axial_frequencies,
    cantilever_force_deflection,
    cantilever_moment_deflection,
    cantilever_shear_deflection,
    cantilever_twist,
    clamped_clamped_torsion,
    clamped_free_torsion,
    euler_bernoulli_frequencies,
    fixed_beam_deflection,
    fixed_beam_twist,
    strip_frequencies,
    timoshenko_frequencies,
    torsion_constant,
    torsional_frequencies,
    turn_section,
)
from headstock.validation.references.rows import ValidationRow, compare_values, reference_case

STEEL = Material("steel", 210e9, 0.3, 7850.0)
CANTILEVER = PrismaticBeam(0.5, 0.1, 0.038, STEEL)
FIXED_BEAM = PrismaticBeam(0.75, 0.25, 0.032, STEEL)
DEEP_BEAM = PrismaticBeam(10.0, 2.0, 2.0, Material("nafems", 200e9, 0.3, 8000.0))
SLENDER_BEAM = PrismaticBeam(0.5, 0.05, 0.005, Material("sdll02", 210e9, 0.3, 7800.0))
ROD = PrismaticBeam(1.0, 0.05, 0.05, Material("nu0", 210e9, 0.0, 7850.0))
AXES = ("x", "y", "z")
COLUMN_SIZE = (0.038, 0.100, 0.500)
FIXED_SIZE = (0.032, 0.750, 0.250)
PATCH = 0.010
OFFSET = 0.100


@dataclass(frozen=True)
class _SprungBlock:
    """A homogeneous rigid block on four corner springs.

    Attributes:
        size: Edge lengths x, y, z [m].
        mass: Mass [kg].
        spring: Stiffness of each corner spring along x, y and z [N/m].
    """

    size: tuple[float, float, float]
    mass: float
    spring: tuple[float, float, float]


def _block_frequencies(block: _SprungBlock) -> FloatArray:
    """Return the six natural frequencies ``(6,)`` [Hz] of a block on four corner springs, rising.

    Heave and yaw stand alone; swaying along x couples with rocking about y, swaying along y with
    rocking about x.

    Source: Newton-Euler equations about the centre of mass (Rivin (2003), section 1.3).
    """
    a, b, h = (0.5 * edge for edge in block.size)
    kx, ky, kz = (4.0 * stiffness for stiffness in block.spring)
    ix, iy, iz = (block.mass * (p**2 + q**2) / 3.0 for p, q in ((b, h), (a, h), (a, b)))
    eigenvalues = [kz / block.mass, (kx * b**2 + ky * a**2) / iz]
    eigenvalues += _sway_rock_pair(kx, block.mass, kz * a**2, iy, h)
    eigenvalues += _sway_rock_pair(ky, block.mass, kz * b**2, ix, h)
    return np.sqrt(np.sort(eigenvalues)) / (2.0 * math.pi)


def _sway_rock_pair(
    low_frequency: float, mass: float, rock: float, inertia: float, height: float
) -> list[float]:
    """Squared angular frequencies [rad^2/s^2] of swaying and rocking when the springs act
    ``height`` below the centre.
    """
    k11, k22 = low_frequency / mass, (rock + low_frequency * height**2) / inertia
    k12 = low_frequency * height / math.sqrt(mass * inertia)
    mean, radius = 0.5 * (k11 + k22), math.hypot(0.5 * (k11 - k22), k12)
    return [mean - radius, mean + radius]


BLOCK = _SprungBlock((1.0, 0.8, 0.3), 230.0, (1.2e4, 1.2e4, 1.8e4))


def check_cantilever_theory(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Frequencies and compliances of the column of Kono et al. by beam theories."""
    along_x, along_y = CANTILEVER, turn_section(CANTILEVER)
    frequencies = [
        *euler_bernoulli_frequencies(along_x, "clamped-free", 3),
        *euler_bernoulli_frequencies(along_y, "clamped-free", 2),
        *timoshenko_frequencies(along_x, "clamped-free", 3),
        *timoshenko_frequencies(along_y, "clamped-free", 2),
        *torsional_frequencies(along_x, "clamped-free", 1),
        *clamped_free_torsion(along_x, 1),
        *axial_frequencies(along_x, "clamped-free", 1),
    ]
    deflections = [
        cantilever_force_deflection(along_x, 1e3),
        cantilever_shear_deflection(along_x, 1e3),
        cantilever_force_deflection(along_y, 1e3),
        cantilever_shear_deflection(along_y, 1e3),
        axial_extension(along_x, 1e3),
        cantilever_moment_deflection(along_y, 1.0),
        cantilever_moment_deflection(along_x, 1.0),
        cantilever_twist(along_x, 1.0) * along_x.width / 2.0,
    ]
    yield from compare_values(reference_case("kono-cantilever-theory"), frequencies)
    yield from compare_values(
        reference_case("kono-cantilever-static-theory"), 1e6 * np.array(deflections)
    )


def check_fixed_beam_theory(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Frequencies and deflections of the fixed beam of Kono et al. by beam theories."""
    flat, upright = FIXED_BEAM, turn_section(FIXED_BEAM)
    frequencies = [
        *euler_bernoulli_frequencies(flat, "clamped-clamped", 3),
        *torsional_frequencies(flat, "clamped-clamped", 1),
        *clamped_clamped_torsion(flat, 2),
        *strip_frequencies(flat, "clamped-clamped", 1),
        *euler_bernoulli_frequencies(upright, "clamped-clamped", 1),
        *timoshenko_frequencies(upright, "clamped-clamped", 1),
    ]
    bending = fixed_beam_deflection(flat, 1e3)
    offset = 0.1
    deflections = [bending, bending + offset * fixed_beam_twist(flat, 1e3 * offset)]
    yield from compare_values(reference_case("kono-fixed-beam-theory"), frequencies)
    yield from compare_values(
        reference_case("kono-fixed-beam-static-theory"), 1e6 * np.array(deflections)
    )


def check_torsion_constants(comm: MPI.Comm) -> list[ValidationRow]:
    """Saint-Venant's torsion constant of three rectangles."""
    values = [torsion_constant(ratio, 1.0) / ratio for ratio in (1.0, 2.631579, 7.8125)]
    return compare_values(reference_case("torsion-constant"), values)


def check_deep_beam_theory(comm: MPI.Comm) -> list[ValidationRow]:
    """FV5 by Timoshenko's and Saint-Venant's theory."""
    values = [
        *timoshenko_frequencies(DEEP_BEAM, "supported-supported", 3),
        *torsional_frequencies(DEEP_BEAM, "clamped-free", 2),
        *axial_frequencies(DEEP_BEAM, "clamped-free", 1),
        *euler_bernoulli_frequencies(DEEP_BEAM, "supported-supported", 1),
    ]
    return compare_values(reference_case("fv5-theory"), values)


def check_slender_beam_theory(comm: MPI.Comm) -> list[ValidationRow]:
    """SDLL02 by Euler and Bernoulli's theory."""
    values = euler_bernoulli_frequencies(SLENDER_BEAM, "clamped-free", 5)
    return compare_values(reference_case("slender-cantilever"), values, tolerance=1e-5)


def check_rod_theory(comm: MPI.Comm) -> list[ValidationRow]:
    """Axial frequencies of the rod without lateral contraction."""
    return compare_values(
        reference_case("rod"), axial_frequencies(ROD, "clamped-free", 3), tolerance=1e-8
    )


def check_block_theory(comm: MPI.Comm) -> list[ValidationRow]:
    """Check the block on four air springs in closed form."""
    return compare_values(reference_case("block"), _block_frequencies(BLOCK))


def mesh_settings(kind: CellKind, size: float) -> MeshSettings:
    """Settings that give a cell kind."""
    return MeshSettings(
        size=size,
        order=2 if kind in ("tet10", "hex27") else 1,
        cells="tet" if kind.startswith("tet") else "hex",
    )


def column(mesh: MeshSettings, interfaces: dict[str, Interface] | None = None) -> Component:
    """Return the column of Kono et al., standing on its foot."""
    return Component(
        "column",
        Box(COLUMN_SIZE),
        STEEL,
        interfaces=interfaces or {},
        mesh=mesh,
        reduction=ReductionSettings(modes=6),
    )


def clamp(component: str, *faces: str) -> tuple[Support, ...]:
    """Whole faces fixed in every direction."""
    return tuple(
        Support(f"clamp{number}", component, (Patch(face),), AXES)
        for number, face in enumerate(faces)
    )


def face_interface(name: str, face: str, coupling: str) -> Interface:
    """Return a whole face as an interface.

    Args:
        face: Face of a box, such as ``z+``.
        coupling: ``average`` or ``rigid``.
    """
    return Interface(name, (Patch(face),), "average" if coupling == "average" else "rigid")


def fixed_beam(mesh: MeshSettings, height: float | None = None) -> Component:
    """Return the seed's fixed beam, lying along y; with a loaded patch at a height above mid-height
    [m], and one behind it.

    The patches are squares of 10 mm on the two faces normal to x.
    """
    interfaces = {}
    if height is not None:
        center = (0.0, 0.0, FIXED_SIZE[2] / 2.0 + height)
        for name, face in (("front", "x+"), ("back", "x-")):
            patch = Patch(face, "rect", center, (PATCH, PATCH))
            interfaces[name] = Interface(name, (patch,), "average")
    return Component(
        "beam",
        Box(FIXED_SIZE),
        STEEL,
        interfaces=interfaces,
        mesh=mesh,
        reduction=ReductionSettings(modes=6),
    )
