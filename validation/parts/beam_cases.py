"""The beams of the reference study by second-order elements, against converged 3D values and beam
theories; kinds of motion of their modes.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import Component, MeshSettings
from headstock.meshing.component_mesh import CellKind
from headstock.solvers.mpi import MPI
from headstock.validation.parts.closed_form_cases import (
    CANTILEVER,
    FIXED_BEAM,
    clamp,
    column,
    face_interface,
    fixed_beam,
    mesh_settings,
)
from headstock.validation.parts.component_models import (
    fixed_by,
    full_model,
    full_modes,
    interface_compliance,
    shared_mesh,
)
from headstock.validation.references.beam_theory import (
    EndConditions,
    cantilever_shear_deflection,
    cantilever_twist,
    clamped_clamped_torsion,
    clamped_free_torsion,
    euler_bernoulli_frequencies,
    fixed_beam_deflection,
    fixed_beam_twist,
    timoshenko_frequencies,
    torsional_frequencies,
    turn_section,
)
from headstock.validation.references.rows import (
    SHOWN_ONLY,
    ReferenceCase,
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    compare_values,
    named_after,
    observe_order,
    reference_case,
    show,
)

_SLICES = 12
COUNT = 6
COLUMN_SIZES: dict[CellKind, tuple[float, float, float]] = {
    "tet10": (0.05, 0.025, 0.0125),
    "hex27": (0.05, 0.025, 0.0125),
}
FIXED_SIZES: dict[CellKind, tuple[float, float, float]] = {
    "tet10": (0.05, 0.025, 0.0125),
    "hex27": (0.08, 0.04, 0.02),
}
COLUMN_ORDER = ["x", "y", "x", "torsion", "y", "x"]
FIXED_ORDER = ["x", "torsion", "x", "torsion", "z", "x"]
INDENTATION_TOLERANCE = 1e-2
SLENDER = "theory is off: no shear, no rotary inertia"
WARPING = "theory is off: the clamped ends restrain warping, Saint-Venant lets it go"
WIDE = "theory is off: a section this wide bends like a plate, and the clamp stops its sideways contraction"
BOTH = "theory is off both ways: plate-like bending makes it stiffer, shear softer; here they nearly cancel"
THIN_WALLED = "theory is off: Vlasov over-corrects, its warping constant is that of a thin strip"
DEEP = "theory is off: the clamp also stops the sideways contraction that beam theory allows"
Theory = tuple[str, int, float, str]


def _beam_mode_kinds(points: FloatArray, shapes: FloatArray, axis: int) -> list[str]:
    """Return the dominating motion of the cross-sections in each mode.

    Sections are slices of the mesh; the rigid motion that fits a slice best tells its displacement
    and twist, which is made comparable by the radius of gyration of the section.

    Args:
        points: ``(n, 3)`` mesh points.
        shapes: ``(3 n, m)`` mode shapes.
        axis: Direction of the beam's axis, 0..2.

    Returns:
        ``x``, ``y`` or ``z`` for motion along that axis (extension along ``axis``) or ``torsion``,
        for each mode.
    """
    place = points[:, axis]
    low, high = float(place.min()), float(place.max())
    slices = np.minimum(((place - low) / (high - low) * _SLICES).astype(int), _SLICES - 1)
    sizes = np.zeros((4, shapes.shape[1]))
    for number in range(_SLICES):
        rows = np.flatnonzero(slices == number)
        center = points[rows].mean(axis=0)
        motions = rigid_map(points[rows], center)
        fit = np.linalg.lstsq(
            motions, shapes.reshape(len(points), 3, -1)[rows].reshape(3 * len(rows), -1), rcond=None
        )[0]
        arms = np.delete(points[rows] - center, axis, axis=1)
        sizes[:3] += fit[:3] ** 2
        sizes[3] += (arms**2).sum(axis=1).mean() * fit[3 + axis] ** 2
    names = ["x", "y", "z", "torsion"]
    return [names[k] for k in np.argmax(sizes, axis=0)]


def check_cantilever_modes(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Six natural frequencies of the column of Kono et al. with tet10 and hex27, and what beam theories
    make of them.
    """
    ends: EndConditions = "clamped-free"
    along_x, along_y = CANTILEVER, turn_section(CANTILEVER)
    theories = [
        *_theory(
            "Euler-Bernoulli",
            (0, 2, 5),
            euler_bernoulli_frequencies(along_x, ends, 3),
            WIDE,
            SLENDER,
            SLENDER,
        ),
        *_theory("Euler-Bernoulli", (1, 4), euler_bernoulli_frequencies(along_y, ends, 2), SLENDER),
        *_theory("Timoshenko", (0, 2, 5), timoshenko_frequencies(along_x, ends, 3), DEEP),
        *_theory("Timoshenko", (1, 4), timoshenko_frequencies(along_y, ends, 2), DEEP),
        *_theory("Saint-Venant", (3,), torsional_frequencies(along_x, ends, 1), WARPING),
        *_theory("Vlasov", (3,), clamped_free_torsion(along_x, 1), THIN_WALLED),
    ]
    reference = reference_case("kono-cantilever")
    yield from _modal_rows(reference, column, ("z-",), COLUMN_SIZES, COLUMN_ORDER, theories, comm)


def check_fixed_beam_modes(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Six natural frequencies of the fixed beam of Kono et al. with tet10 and hex27, and what beam theories
    make of them.
    """
    ends: EndConditions = "clamped-clamped"
    flat, upright = FIXED_BEAM, turn_section(FIXED_BEAM)
    theories = [
        *_theory(
            "Euler-Bernoulli",
            (0, 2, 5),
            euler_bernoulli_frequencies(flat, ends, 3),
            WIDE,
            BOTH,
            SLENDER,
        ),
        *_theory("Euler-Bernoulli", (4,), euler_bernoulli_frequencies(upright, ends, 1), SLENDER),
        *_theory("Timoshenko", (4,), timoshenko_frequencies(upright, ends, 1), DEEP),
        *_theory("Saint-Venant", (1, 3), torsional_frequencies(flat, ends, 2), WARPING),
        *_theory("Vlasov", (1, 3), clamped_clamped_torsion(flat, 2), THIN_WALLED),
    ]
    reference = reference_case("kono-fixed-beam")
    yield from _modal_rows(
        reference, fixed_beam, ("y-", "y+"), FIXED_SIZES, FIXED_ORDER, theories, comm
    )


def _theory(name: str, numbers: Sequence[int], values: FloatArray, *notes: str) -> list[Theory]:
    """Return what a theory says of some numbers of a reference, with a remark for each or for all."""
    remarks = notes if len(notes) > 1 else notes * len(numbers)
    return [
        (name, number, float(value), note)
        for number, value, note in zip(numbers, values, remarks, strict=True)
    ]


def check_cantilever_statics(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Compliances of the column's top face, moved and loaded as a mean, by superelement."""
    reference, half = reference_case("kono-cantilever-static"), CANTILEVER.width / 2.0
    finest: FloatArray = np.zeros(COUNT)
    for kind, sizes in COLUMN_SIZES.items():
        component = column(
            mesh_settings(kind, sizes[-1]), {"tip": face_interface("tip", "z+", "average")}
        )
        supports = clamp(component.name, "z-")
        mesh = shared_mesh(component, supports, comm=comm)
        c = interface_compliance(component, mesh, supports, comm=comm)["tip", "tip"]
        finest = 1e6 * np.abs(
            [1e3 * c[0, 0], 1e3 * c[1, 1], 1e3 * c[2, 2], c[1, 3], c[0, 4], half * c[5, 5]]
        )
        yield from named_after(kind, compare_values(reference, finest))
    theories = [
        ("Timoshenko", 0, 1e6 * cantilever_shear_deflection(CANTILEVER, 1e3), DEEP),
        ("Timoshenko", 1, 1e6 * cantilever_shear_deflection(turn_section(CANTILEVER), 1e3), DEEP),
        ("Saint-Venant", 5, 1e6 * cantilever_twist(CANTILEVER, 1.0) * half, WARPING),
    ]
    yield from _theory_rows(reference, finest, theories)


def check_fixed_beam_statics(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Deflection of the fixed beam under 1 kN on a small patch, at mid-height and above it."""
    reference = reference_case("kono-fixed-beam-static")
    finest: FloatArray = np.zeros(len(reference.values))
    for kind, sizes in FIXED_SIZES.items():
        values = []
        for height in (0.0, 0.1):
            component = fixed_beam(mesh_settings(kind, sizes[-1]), height)
            supports = clamp(component.name, "y-", "y+")
            mesh = shared_mesh(component, supports, comm=comm)
            compliance = interface_compliance(component, mesh, supports, comm=comm)
            front, back = compliance["front", "front"], compliance["back", "front"]
            values += [front[0, 0], back[0, 0]]
        finest = 1e9 * np.array([*values, abs(front[2, 0])])
        yield from named_after(
            kind, [_indentation(row) for row in compare_values(reference, finest)]
        )
    bending, twist = fixed_beam_deflection(FIXED_BEAM, 1e3), fixed_beam_twist(FIXED_BEAM, 100.0)
    theories = [
        ("Euler-Bernoulli", 1, 1e6 * bending, WIDE),
        ("Euler-Bernoulli and Saint-Venant", 3, 1e6 * (bending + 0.1 * twist), WARPING),
        ("Saint-Venant", 4, 1e6 * twist * FIXED_BEAM.depth / 2.0, WARPING),
    ]
    yield from _theory_rows(reference, finest, theories)


def _indentation(row: ValidationRow) -> ValidationRow:
    """Return a row of a mean over the loaded patch, whose local indentation converges slowly, with
    its wider tolerance.
    """
    if "patch average" not in row.quantity:
        return row
    target = Target(row.reference, row.unit, INDENTATION_TOLERANCE, row.kind)
    return compare_value(
        row.quantity, row.value, target, "with the local indentation of the loaded patch"
    )


def _modal_rows(
    reference: ReferenceCase,
    build: Callable[[MeshSettings], Component],
    faces: Sequence[str],
    sizes: Mapping[CellKind, tuple[float, float, float]],
    order: Sequence[str],
    theories: Sequence[Theory],
    comm: MPI.Comm,
) -> Iterator[ValidationRow]:
    finest: FloatArray = np.zeros(COUNT)
    for kind, steps in sizes.items():
        meshes = [
            clamped_modes(build(mesh_settings(kind, size)), faces, COUNT, comm) for size in steps
        ]
        finest, order_found = meshes[-1].frequencies_hz[:COUNT], meshes[-1].kinds[:COUNT]
        remarks = [f"{meshes[-1].dofs} dofs"] * COUNT
        yield from named_after(kind, compare_values(reference, finest, notes=remarks))
        misplaced = sum(left != right for left, right in zip(order_found, order, strict=True))
        yield compare_bound(f"{kind} modes out of the order {' '.join(order)}", misplaced, 0.0)
        # from three meshes, each twice as fine as the one before
        coarse, fine = -np.diff([modes.frequencies_hz[:COUNT] for modes in meshes], axis=0)
        note = "not gated: below 2 p = 4, as the clamped edge is singular"
        for number in (0, 3):
            observed = observe_order(coarse[number], fine[number])
            yield show(f"{kind} observed order of f{number + 1}", observed, "-", note)
    yield from _theory_rows(reference, finest, theories)


class _ClampedModes(NamedTuple):
    """Frequencies ``(m,)`` [Hz], how each mode moves, and the dofs of the model."""

    frequencies_hz: FloatArray
    kinds: list[str]
    dofs: int


def clamped_modes(
    component: Component, faces: Sequence[str], count: int, comm: MPI.Comm
) -> _ClampedModes:
    """Return the lowest modes of a bar.

    Args:
        faces: Its clamped end or ends, such as ``z-``.
        count: How many at least.
    """
    supports = clamp(component.name, *faces)
    mesh = shared_mesh(component, supports, comm=comm)
    model = full_model(mesh, component.material, comm=comm, fixed=fixed_by(mesh, supports))
    modes = full_modes(model, count)
    shapes = model.everywhere(modes.shapes).reshape(3 * len(mesh.points), -1)
    kinds = _beam_mode_kinds(mesh.points, shapes, "xyz".index(faces[0][0]))
    return _ClampedModes(modes.frequencies_hz, kinds, 3 * len(mesh.points))


def _theory_rows(
    reference: ReferenceCase, finest: FloatArray, theories: Sequence[Theory]
) -> list[ValidationRow]:
    """Show what theories say, against the finest 3D value: shown, never gated."""
    names = list(reference.values)
    return [
        compare_value(
            f"{theory}: {names[number]}",
            value,
            Target(float(finest[number]), reference.unit, np.nan, SHOWN_ONLY),
            note,
        )
        for theory, number, value, note in theories
    ]
