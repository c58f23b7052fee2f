"""Bodies made of boxes that are cut into parts and joined again by flexible interfaces, against the
body as one mesh.
"""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.parts.components import Component, Interface, Patch
from headstock.geometry.parts.patches import in_plane_axes
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.mpi import MPI
from headstock.validation.parts.closed_form_cases import STEEL
from headstock.validation.parts.structured_meshes import (
    integrate_over_cells,
    lattice_mesh,
    lattice_sides,
    refine_lattice,
)
from headstock.validation.references.rows import ValidationRow, compare_bound, show

Form = Literal["strong", "weak"]
FORMS: tuple[Form, ...] = ("strong", "weak")
KINDS: dict[Form, Literal["rigid", "average"]] = {"strong": "rigid", "weak": "average"}
EVERY_DIRECTION = (0, 1, 2, 3, 4, 5)
RIGID_MOTIONS = 6
ON_PLANE = 1e-9  # [m]

WATCHED = 10
GOAL = 2e-3
# what modes left out may disturb the order of two bases by, over a frequency
DISTURBED = 1e-4
SHAPES = (0, 3, 12, 24, 30)
MANY_SHAPES = 200
MODES, SMOKE_MODES = 160, 40  # of each part

BEAM, PLATE, BLOCK = (0.4, 0.04, 0.03), (0.3, 0.2, 0.01), (0.2, 0.15, 0.24)
SHAFT = (0.1, 0.1, 0.24)


@dataclass(frozen=True)
class _Bar:
    """A box between two corners ``(3,)`` [m]."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @property
    def size(self) -> tuple[float, float, float]:
        """Edge lengths ``(3,)`` [m]."""
        return _triple([high - low for low, high in zip(self.low, self.high, strict=True)])

    def clip(self, points: tuple[float, ...], axis: int) -> tuple[float, ...]:
        """Return those of rising coordinates along an axis that lie within the box."""
        low, high = self.low[axis] - ON_PLANE, self.high[axis] + ON_PLANE
        return tuple(value for value in points if low < value < high)


@dataclass(frozen=True)
class _SplitBody:
    """A free body of boxes that meet in planes, each box a part.

    Attributes:
        grid: Corners of the elements along x, y and z [m]; all faces of the boxes are among them.
        bars: The parts; each meets the next one across ``axis``.
        axis: Across which they meet, 0..2.
        finer: Parts with one more element along each side of their joints, so that meshes do not
            match.
        round: The section across the axis, a square from 0 on, is bent to the disk in it.
    """

    name: str
    grid: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
    bars: tuple[_Bar, ...]
    axis: int
    finer: tuple[int, ...] = ()
    round: bool = False

    def find_patch(self, number: int) -> _Bar:
        """Return the rectangle in which a part meets the next one, as a box without thickness."""
        one, next_one = self.bars[number], self.bars[number + 1]
        low = [max(pair) for pair in zip(one.low, next_one.low, strict=True)]
        high = [min(pair) for pair in zip(one.high, next_one.high, strict=True)]
        return _Bar(_triple(low), _triple(high))

    def bend(self, lattice: FloatArray) -> FloatArray:
        """Return where points ``(..., 3)`` of the boxes lie in the body: a square becomes a disk."""
        if not self.round:
            return lattice
        first, second = in_plane_axes(self.axis)
        radius = 0.5 * self.grid[first][-1]
        x, y = lattice[..., first] / radius - 1.0, lattice[..., second] / radius - 1.0
        bent = lattice.copy()
        bent[..., first] = radius * (1.0 + x * np.sqrt(1.0 - 0.5 * y**2))
        bent[..., second] = radius * (1.0 + y * np.sqrt(1.0 - 0.5 * x**2))
        return bent


def divide(length: float, count: int) -> tuple[float, ...]:
    """Corners of so many equal elements over a length [m]."""
    return tuple(length * step / count for step in range(count + 1))


def _cut_box(
    name: str,
    size: tuple[float, float, float],
    counts: tuple[int, int, int],
    *,
    axis: int,
    parts: int,
    finer: tuple[int, ...] = (),
    round_section: bool = False,
) -> _SplitBody:
    """Cut a box of equal elements into equal parts across an axis.

    Args:
        size: Edge lengths [m].
        counts: Elements along each; along the axis a multiple of ``parts``.
        axis: Which the cuts are across, 0..2.
        finer: Parts with a mesh of their own.
        round_section: The box is bent to a shaft.
    """
    corners = divide(size[axis], parts)
    bars = []
    for start, end in itertools.pairwise(corners):
        low, high = [0.0, 0.0, 0.0], list(size)
        low[axis], high[axis] = start, end
        bars.append(_Bar(_triple(low), _triple(high)))
    x, y, z = (divide(length, count) for length, count in zip(size, counts, strict=True))
    return _SplitBody(name, (x, y, z), tuple(bars), axis, finer, round_section)


def _find_whole_frequencies(body: _SplitBody, count: int) -> FloatArray:
    """Elastic natural frequencies [Hz] ``(count,)`` of the body as one mesh."""
    mesh = lattice_mesh(body.bend(_lattice(body.grid)), "hex27", straight=not body.round)
    centers = mesh.points[mesh.cells[:, :8]].mean(axis=1)
    within = [((centers > bar.low) & (centers < bar.high)).all(axis=1) for bar in body.bars]
    cells = mesh.cells[np.any(within, axis=0)]
    used, numbers = np.unique(cells, return_inverse=True)
    points, cells = mesh.points[used], numbers.reshape(cells.shape).astype(np.int64)
    volume = integrate_over_cells(points, cells, mesh.kind, lambda x: np.ones(len(x)))
    quality = dataclasses.replace(mesh.quality, volume=volume)
    one = dataclasses.replace(mesh, points=points, cells=cells, quality=quality)
    component = Component("whole", Box(tuple(points.max(axis=0).tolist())), STEEL, free=True)
    return _reduce(component, one, ModeTarget(count=count)).modal_frequencies_hz[:count]


def _join_parts(body: _SplitBody, form: Form, flexible: int, modes: int) -> CoupledMachine:
    """Join parts to a body with rigid joints between their interfaces.

    Args:
        flexible: Most shapes of each; with 0 they move as rigid bodies or in the mean.
        modes: Fixed-interface modes kept of each part.
    """
    made = [_make_part(body, number, form, flexible, modes) for number in range(len(body.bars))]
    joints = {
        f"joint{i}": Joint(
            f"joint{i}",
            (JointEnd(f"part{i}", "end"), JointEnd(f"part{i + 1}", "start")),
            "rigid",
            fixed=EVERY_DIRECTION,
        )
        for i in range(len(made) - 1)
    }
    machine = Machine(body.name, {part.name: part for part, _ in made}, joints)
    return couple({element.name: element for _, element in made}, machine, Pose("home"))


def _find_joined_frequencies(coupled: CoupledMachine, count: int) -> FloatArray:
    """Return the first elastic natural frequencies [Hz] ``(count,)``; infinite where none."""
    found = solve_modal(coupled.system, count=RIGID_MOTIONS + count).frequencies_hz
    return np.pad(found, (0, RIGID_MOTIONS + count), constant_values=np.inf)[RIGID_MOTIONS:][:count]


def _count_shapes(coupled: CoupledMachine) -> int:
    """Return the most shapes that an interface of a machine keeps."""
    maps = [
        entry
        for part in coupled.layout.superelements.values()
        for entry in part.interface_maps.values()
    ]
    return max((entry.shapes.count for entry in maps if entry.shapes is not None), default=0)


def _make_part(
    body: _SplitBody, number: int, form: Form, flexible: int, modes: int
) -> tuple[Component, Superelement]:
    bar = body.bars[number]
    sides = {"end": body.find_patch(number)} if number + 1 < len(body.bars) else {}
    sides |= {"start": body.find_patch(number - 1)} if number else {}
    axes = [list(bar.clip(body.grid[axis], axis)) for axis in range(3)]
    if number in body.finer:
        for axis in in_plane_axes(body.axis):
            axes[axis] = _add_element(axes[axis], list(sides.values()), axis)
    lattice = body.bend(_lattice(axes)) - np.array(bar.low)
    mesh = lattice_mesh(lattice, "hex27", straight=not body.round)
    facets = np.concatenate(list(lattice_sides(lattice.shape[:3]).values()))
    centers = mesh.points[facets[:, :4]].mean(axis=1) + np.array(bar.low)
    patches, interfaces = {}, {}
    for name, patch in sides.items():
        low, high = np.array(patch.low) - ON_PLANE, np.array(patch.high) + ON_PLANE
        patches[name] = facets[((centers > low) & (centers < high)).all(axis=1)]
        middle = 0.5 * (low + high) - np.array(bar.low)
        face = f"{'xyz'[body.axis]}{'+' if middle[body.axis] > ON_PLANE else '-'}"
        lengths = np.delete(patch.size, body.axis)
        shape: Literal["disk", "rect"] = "disk" if body.round else "rect"
        size = tuple(lengths[:1] if body.round else lengths)
        interfaces[name] = Interface(
            name,
            (Patch(face, shape, tuple(middle), size),),
            KINDS[form],
            flexible=flexible,
        )
    component = Component(
        f"part{number}",
        Box(bar.size),
        STEEL,
        Frame(np.array(bar.low)),
        interfaces,
        free=True,
    )
    mesh = dataclasses.replace(mesh, patches=patches)
    return component, _reduce(component, mesh, ModeTarget(count=modes))


def _add_element(corners: list[float], patches: Sequence[_Bar], axis: int) -> list[float]:
    """Corners of one more element between the outermost ones within the patches, evenly."""
    low = min(patch.low[axis] for patch in patches) - ON_PLANE
    high = max(patch.high[axis] for patch in patches) + ON_PLANE
    outer = [value for value in corners if value < low or value > high]
    inner = [value for value in corners if low < value < high]
    step = (inner[-1] - inner[0]) / len(inner)
    return sorted([*outer, *(inner[0] + step * number for number in range(len(inner) + 1))])


def _triple(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z


def _lattice(axes: Sequence[Sequence[float]]) -> FloatArray:
    return refine_lattice(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))


def _reduce(component: Component, mesh: ComponentMesh, modes: ModeTarget) -> Superelement:
    request = ReductionRequest(modes=modes, recovery=False, errors=False)
    return reduce_elastic(component, mesh, (), (), request=request, comm=MPI.COMM_SELF)


# parts meet over a whole section: stresses there are those of a smooth body
CUTS = (
    _cut_box("beam, 2 parts", BEAM, (20, 4, 4), axis=0, parts=2),
    _cut_box("beam, 5 parts, other meshes", BEAM, (20, 4, 4), axis=0, parts=5, finer=(1, 3)),
    _cut_box("plate across, 2 parts", PLATE, (16, 12, 2), axis=0, parts=2),
    _cut_box(
        "plate across, 4 parts, other meshes", PLATE, (16, 12, 2), axis=0, parts=4, finer=(1,)
    ),
    _cut_box("block, 2 parts", BLOCK, (6, 5, 8), axis=2, parts=2),
    _cut_box("block, 2 parts, other meshes", BLOCK, (6, 5, 8), axis=2, parts=2, finer=(1,)),
    _cut_box("block, 4 parts", BLOCK, (6, 5, 8), axis=2, parts=4),
    _cut_box("shaft, 2 parts", SHAFT, (4, 4, 10), axis=2, parts=2, round_section=True),
    _cut_box(
        "shaft, 3 parts, other meshes",
        SHAFT,
        (4, 4, 12),
        axis=2,
        parts=3,
        finer=(1,),
        round_section=True,
    ),
)
# one part ends on the face of the other: stresses grow without limit along the rim of the joint
STEPS = (
    _SplitBody(
        "plates overlapping",
        (divide(0.36, 18), divide(0.12, 6), divide(0.04, 4)),
        (_Bar((0.0, 0.0, 0.0), (0.24, 0.12, 0.02)), _Bar((0.12, 0.0, 0.02), (0.36, 0.12, 0.04))),
        2,
    ),
    _SplitBody(
        "post on a plate",
        (divide(0.3, 12), divide(0.2, 10), divide(0.18, 9)),
        (_Bar((0.0, 0.0, 0.0), (0.3, 0.2, 0.04)), _Bar((0.1, 0.06, 0.04), (0.2, 0.14, 0.18))),
        2,
    ),
)
SMOKE_BEAM = _cut_box("beam, 2 parts", BEAM, (14, 3, 3), axis=0, parts=2)
LAYERS = _cut_box("plate of 2 layers", (0.3, 0.2, 0.02), (16, 12, 4), axis=2, parts=2)


def check_flexible_interfaces() -> Iterator[ValidationRow]:
    """Ten frequencies of cut bodies in both forms with more and more shapes."""
    for body in CUTS:
        yield from _evaluate(body, "weak", SHAPES)
    for body in STEPS:
        yield from _evaluate(body, None, SHAPES)
    yield from _evaluate(LAYERS, None, (*SHAPES, MANY_SHAPES))


def check_flexible_smoke() -> Iterator[ValidationRow]:
    """Check a beam in the same way."""
    return _evaluate(SMOKE_BEAM, "weak", (0, 12, 30), modes=SMOKE_MODES)


def _evaluate(
    body: _SplitBody,
    required: Form | None,
    shapes: tuple[int, ...],
    *,
    modes: int = MODES,
) -> Iterator[ValidationRow]:
    """Compare a body cut and joined with the whole one; one form of it has to reach the goal."""
    whole = _find_whole_frequencies(body, WATCHED)
    finest = {}
    for form in FORMS:
        found, counts = _series(body, form, shapes, modes)
        errors = found / whole - 1.0
        finest[form] = errors[-1]
        furthest = np.abs(errors).max(axis=1)
        note = "; ".join(
            f"{count} shapes: {100.0 * error:.2g} %"
            if np.isfinite(error)
            else f"{count} shapes: modes are missing"
            for count, error in zip(counts, furthest, strict=True)
        )
        quantity = f"{body.name}, {form}, {counts[-1]} shapes: furthest of ten frequencies"
        yield (
            compare_bound(quantity, furthest[-1], GOAL, note)
            if form == required
            else show(quantity, furthest[-1], "-", note)
        )
        yield compare_bound(
            f"{body.name}, {form}: largest step in the wrong direction",
            _find_wrong_step(errors, form),
            DISTURBED,
            "frequencies fall with more shapes" if form == "strong" else "frequencies rise",
        )
    if not body.finer:
        yield compare_bound(
            f"{body.name}: by how much one part lies above the strong form",
            max(0.0, -finest["strong"].min()),
            DISTURBED,
        )


def _series(
    body: _SplitBody, form: Form, shapes: tuple[int, ...], modes: int
) -> tuple[FloatArray, list[int]]:
    """Frequencies ``(k, 10)`` [Hz] with so many shapes, and how many there are of them."""
    machines = [_join_parts(body, form, most, modes) for most in shapes]
    found = [_find_joined_frequencies(machine, WATCHED) for machine in machines]
    return np.array(found), [_count_shapes(machine) for machine in machines]


def _find_wrong_step(errors: FloatArray, form: Form) -> float:
    """By how much a frequency rises in the strong form or falls in the weak one at most."""
    known = errors[np.isfinite(errors).all(axis=1)]
    steps = np.diff(known, axis=0)
    return float(max(0.0, (steps if form == "strong" else -steps).max(initial=0.0)))
