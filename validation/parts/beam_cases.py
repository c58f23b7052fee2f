"""The beams of the reference study by second-order elements, against converged 3D values and beam
theories; kinds of motion of their modes.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import Component, MeshSettings, Support
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
from headstock.validation.references.bending import (
    cantilever_shear_deflection,
    euler_bernoulli_frequencies,
    fixed_beam_deflection,
    timoshenko_frequencies,
)
from headstock.validation.references.prismatic_beams import turn_section
from headstock.validation.references.rows import (
    SHOWN_ONLY,
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    compare_values,
    named_after,
    show,
)
from headstock.validation.references.torsion import (
    cantilever_twist,
    clamped_clamped_torsion,
    clamped_free_torsion,
    fixed_beam_twist,
    torsional_frequencies,
)
from headstock.validation.references.values import ReferenceCase, reference_case

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


def beam_mode_kinds(points: FloatArray, shapes: FloatArray, axis: int) -> list[str]:
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


def check_cantilever_modes(comm: MPI.Comm) -> list[ValidationRow]:
    """Six natural frequencies of the column of Kono et al. with tet10 and hex27, and what beam theories
    make of them.
    """
    along_x, along_y = CANTILEVER, turn_section(CANTILEVER)
    slender_x = euler_bernoulli_frequencies(along_x, "clamped-free", 3)
    slender_y = euler_bernoulli_frequencies(along_y, "clamped-free", 2)
    deep_x = timoshenko_frequencies(along_x, "clamped-free", 3)
    deep_y = timoshenko_frequencies(along_y, "clamped-free", 2)
    slender_notes = (WIDE, SLENDER, SLENDER)
    theories = [
        ("Euler-Bernoulli", number, float(slender_x[k]), slender_notes[k])
        for k, number in enumerate((0, 2, 5))
    ]
    theories += [
        ("Euler-Bernoulli", number, float(slender_y[k]), SLENDER) for k, number in enumerate((1, 4))
    ]
    theories += [
        ("Timoshenko", number, float(deep_x[k]), DEEP) for k, number in enumerate((0, 2, 5))
    ]
    theories += [("Timoshenko", number, float(deep_y[k]), DEEP) for k, number in enumerate((1, 4))]
    theories += [
        ("Saint-Venant", 3, float(torsional_frequencies(along_x, "clamped-free", 1)[0]), WARPING),
        ("Vlasov", 3, float(clamped_free_torsion(along_x, 1)[0]), THIN_WALLED),
    ]
    return _modal_rows(
        "kono-cantilever",
        column,
        ("z-",),
        sizes=COLUMN_SIZES,
        order=COLUMN_ORDER,
        theories=theories,
        comm=comm,
    )


def check_fixed_beam_modes(comm: MPI.Comm) -> list[ValidationRow]:
    """Six natural frequencies of the fixed beam of Kono et al. with tet10 and hex27, and what beam theories
    make of them.
    """
    flat, upright = FIXED_BEAM, turn_section(FIXED_BEAM)
    slender = euler_bernoulli_frequencies(flat, "clamped-clamped", 3)
    twist = torsional_frequencies(flat, "clamped-clamped", 2)
    warped = clamped_clamped_torsion(flat, 2)
    slender_notes = (WIDE, BOTH, SLENDER)
    theories = [
        ("Euler-Bernoulli", number, float(slender[k]), slender_notes[k])
        for k, number in enumerate((0, 2, 5))
    ]
    theories += [
        (
            "Euler-Bernoulli",
            4,
            float(euler_bernoulli_frequencies(upright, "clamped-clamped", 1)[0]),
            SLENDER,
        )
    ]
    theories += [
        ("Timoshenko", 4, float(timoshenko_frequencies(upright, "clamped-clamped", 1)[0]), DEEP)
    ]
    theories += [
        ("Saint-Venant", number, float(twist[k]), WARPING) for k, number in enumerate((1, 3))
    ]
    theories += [
        ("Vlasov", number, float(warped[k]), THIN_WALLED) for k, number in enumerate((1, 3))
    ]
    return _modal_rows(
        "kono-fixed-beam",
        fixed_beam,
        ("y-", "y+"),
        sizes=FIXED_SIZES,
        order=FIXED_ORDER,
        theories=theories,
        comm=comm,
    )


def check_cantilever_statics(comm: MPI.Comm) -> list[ValidationRow]:
    """Compliances of the column's top face, moved and loaded as a mean, by the static
    superelement.
    """
    case, reference = "kono-cantilever-static", reference_case("kono-cantilever-static")
    rows: list[ValidationRow] = []
    finest: FloatArray = np.zeros(COUNT)
    for kind, sizes in COLUMN_SIZES.items():
        component = column(
            mesh_settings(kind, sizes[-1]), {"tip": face_interface("tip", "z+", "average")}
        )
        supports = clamp(component.name, "z-")
        mesh = shared_mesh(component, supports, comm=comm)
        c = interface_compliance(component, mesh, supports, comm=comm)["tip", "tip"]
        half = CANTILEVER.width / 2.0
        finest = 1e6 * np.abs(
            [1e3 * c[0, 0], 1e3 * c[1, 1], 1e3 * c[2, 2], c[1, 3], c[0, 4], half * c[5, 5]]
        )
        rows += named_after(kind, compare_values(case, reference, finest))
    theories = [
        ("Timoshenko", 0, 1e6 * cantilever_shear_deflection(CANTILEVER, 1e3), DEEP),
        ("Timoshenko", 1, 1e6 * cantilever_shear_deflection(turn_section(CANTILEVER), 1e3), DEEP),
        (
            "Saint-Venant",
            5,
            1e6 * cantilever_twist(CANTILEVER, 1.0) * CANTILEVER.width / 2.0,
            WARPING,
        ),
    ]
    return rows + _theory_rows(case, reference, finest, theories)


def check_fixed_beam_statics(comm: MPI.Comm) -> list[ValidationRow]:
    """Deflection of the fixed beam under 1 kN on a small patch, at mid-height and above it."""
    case, reference = "kono-fixed-beam-static", reference_case("kono-fixed-beam-static")
    rows: list[ValidationRow] = []
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
        rows += named_after(
            kind, [_indentation(row) for row in compare_values(case, reference, finest)]
        )
    bending = fixed_beam_deflection(FIXED_BEAM, 1e3)
    offset = bending + 0.1 * fixed_beam_twist(FIXED_BEAM, 100.0)
    theories = [
        ("Euler-Bernoulli", 1, 1e6 * bending, WIDE),
        ("Euler-Bernoulli and Saint-Venant", 3, 1e6 * offset, WARPING),
        (
            "Saint-Venant",
            4,
            1e6 * fixed_beam_twist(FIXED_BEAM, 100.0) * FIXED_BEAM.depth / 2.0,
            WARPING,
        ),
    ]
    return rows + _theory_rows(case, reference, finest, theories)


def _indentation(row: ValidationRow) -> ValidationRow:
    """Return a row of a mean over the loaded patch, whose local indentation converges slowly, with
    its wider tolerance.
    """
    if "patch average" not in row.quantity:
        return row
    target = Target(row.reference, row.unit, INDENTATION_TOLERANCE, row.kind)
    return compare_value(
        row.case, row.quantity, row.value, target, "with the local indentation of the loaded patch"
    )


def _modal_rows(
    case: str,
    build: Callable[[MeshSettings], Component],
    faces: Sequence[str],
    *,
    sizes: Mapping[CellKind, tuple[float, float, float]],
    order: Sequence[str],
    theories: Sequence[Theory],
    comm: MPI.Comm,
) -> list[ValidationRow]:
    reference = reference_case(case)
    rows: list[ValidationRow] = []
    finest: FloatArray = np.zeros(COUNT)
    for kind, steps in sizes.items():
        found = []
        for size in steps:
            component = build(mesh_settings(kind, size))
            modes = _clamped_modes(
                component, clamp(component.name, *faces), comm, 1 if len(faces) == 2 else 2
            )
            found.append(modes.frequencies_hz)
        finest = found[-1]
        remark = f"{modes.dofs} dofs"
        rows += named_after(kind, compare_values(case, reference, finest, notes=[remark] * COUNT))
        misplaced = sum(left != right for left, right in zip(modes.kinds, order, strict=True))
        rows.append(
            compare_bound(case, f"{kind} modes out of the order {' '.join(order)}", misplaced, 0.0)
        )
        rows += _observed_orders(case, kind, np.array(found))
    return rows + _theory_rows(case, reference, finest, theories)


class _ClampedModes(NamedTuple):
    """Frequencies ``(m,)`` [Hz], how each mode moves, and the dofs of the model."""

    frequencies_hz: FloatArray
    kinds: list[str]
    dofs: int


def _clamped_modes(
    component: Component, supports: Sequence[Support], comm: MPI.Comm, axis: int
) -> _ClampedModes:
    mesh = shared_mesh(component, supports, comm=comm)
    model = full_model(mesh, component.material, comm=comm, fixed=fixed_by(mesh, supports))
    modes = full_modes(model, COUNT)
    shapes = model.everywhere(modes.shapes[:, :COUNT]).reshape(-1, COUNT)
    return _ClampedModes(
        modes.frequencies_hz[:COUNT],
        beam_mode_kinds(mesh.points, shapes, axis),
        3 * len(mesh.points),
    )


def _observed_orders(case: str, kind: str, found: FloatArray) -> list[ValidationRow]:
    """Orders from three meshes, each twice as fine as the one before; the clamped edges are
    singular, so they are shown only.
    """
    coarse, fine = found[0] - found[1], found[1] - found[2]
    note = "not gated: below 2 p = 4, as the clamped edge is singular"
    return [
        show(
            case,
            f"{kind} observed order of f{number + 1}",
            float(np.log2(abs(coarse[number] / fine[number]))),
            "-",
            note,
        )
        for number in (0, 3)
    ]


def _theory_rows(
    case: str, reference: ReferenceCase, finest: FloatArray, theories: Sequence[Theory]
) -> list[ValidationRow]:
    """Show what theories say, against the finest 3D value: shown, never gated."""
    names = list(reference.values)
    return [
        compare_value(
            case,
            f"{theory}: {names[number]}",
            value,
            Target(float(finest[number]), reference.unit, np.nan, SHOWN_ONLY),
            note,
        )
        for theory, number, value, note in theories
    ]
