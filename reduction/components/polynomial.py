"""A bar or block without a mesh: displacements are polynomials over its whole volume, reduced to the
same boundary and modal dofs as finite elements.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import scipy.linalg
import scipy.sparse

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray, Frame, rigid_transfer
from headstock.geometry.machine.machine import Sensor
from headstock.geometry.parts.components import Component, Load, Patch
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.geometry.parts.patches import Order, PlanarSolid, in_plane_axes, sample_patches
from headstock.geometry.parts.prismatic_bars import PrismaticBar, prismatic_bar
from headstock.geometry.parts.solids import Box, Plate, Tube
from headstock.reduction.components.interface_patches import MeshPatch
from headstock.reduction.components.polynomial_space import (
    PolynomialSpace,
    build_space,
    polynomial_limit,
)
from headstock.reduction.components.rail_fits import RailFit, fit_rail, free_rails
from headstock.reduction.components.rigid import find_density
from headstock.reduction.components.segmented import segment_skin
from headstock.reduction.components.sensors import combine_attachments
from headstock.reduction.rails import CONTROL_POINT_DOFS, ControlPoint, control_point_motion
from headstock.reduction.requests import GRAVITY, ReductionRequest
from headstock.reduction.superelement import (
    ErrorEstimates,
    InterfaceMap,
    Recovery,
    SensorRows,
    StaticLoad,
    Superelement,
    Truncation,
    lowest_participating,
)
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.errors import ModelError

# degrees along the shortest side of a block, and more along a side twice as long
LEAST_DEGREE, DEGREES_PER_OCTAVE, MOST_DEGREE = 3, 1.75, 12
SECTION_DEGREE = 3  # of a round section
DEGREES_BEYOND_RAIL = 6
FACE_DEPENDENCE = 0.1  # of what polynomials can distinguish on a rigid patch, at most
ROW_DEPENDENCE = 1e-3
BODY_NODE = "body"
BREAKS = 3  # of area integrals along the bar
SAFETY = 2.5  # of what one degree less is too stiff by: it covers what more degrees soften
FIRST_SEARCH = 40  # modes
ROUNDING = 1e-11  # what functions of thin sections leave, orthonormal to that


@dataclass(frozen=True, eq=False)
class _Boundary:
    """Values prescribed for the polynomials: ``rows (m, 3 n)`` of their dofs take the values
    ``values (m, n_b)`` per unit of the boundary dofs; ``rows`` are orthonormal.

    ``constraints (k, n_b)`` are combinations of boundary dofs that must vanish.
    """

    rows: FloatArray
    values: FloatArray
    constraints: FloatArray


@dataclass(frozen=True, eq=False)
class _Condensed:
    """Polynomials with their boundary prescribed.

    Attributes:
        reflectors: ``V (3 n, m)`` and ``T (m, m)``: the last f columns of ``1 - V T V^T`` are the
            orthonormal displacements that leave the boundary at rest.
        inner: ``(f, f)`` their stiffness.
        psi: ``(3 n, n_b)`` static shapes of the boundary dofs.
        stiffness: ``(n_b, n_b)``.
        factor: Of the inner stiffness, as ``cho_solve`` takes it.
    """

    reflectors: tuple[FloatArray, FloatArray]
    inner: FloatArray
    factor: tuple[FloatArray, bool]
    psi: FloatArray
    stiffness: FloatArray

    def spread(self, motions: FloatArray) -> FloatArray:
        """Return the displacements ``(3 n, k)`` of motions ``(f, k)`` that leave the boundary at rest."""
        vectors, factors = self.reflectors
        count = len(factors)
        spread = -vectors @ (factors @ (vectors[count:].T @ motions))
        spread[count:] += motions
        return spread

    def gather(self, forces: FloatArray) -> FloatArray:
        """Return the part ``(f, k)`` of forces ``(3 n, k)`` that acts on such motions."""
        vectors, factors = self.reflectors
        count = len(factors)
        gathered: FloatArray = forces[count:] - vectors[count:] @ (factors.T @ (vectors.T @ forces))
        return gathered

    def solve(self, forces: FloatArray) -> FloatArray:
        """Return the displacements ``(3 n, k)`` under forces, the boundary at rest."""
        return self.spread(scipy.linalg.cho_solve(self.factor, self.gather(forces)))


@dataclass(frozen=True, eq=False)
class _Modes:
    """Modes with the boundary at rest.

    Attributes:
        squares: ``(m,)`` of their frequencies [rad^2/s^2].
        shapes: ``(3 n, m)`` mass-normalised.
        reach_hz: None is missing up to here [Hz].
        beyond: Square of the next frequency [rad^2/s^2].
        attached: How many at the end are residual-attachment modes.
    """

    squares: FloatArray
    shapes: FloatArray
    reach_hz: float
    beyond: float
    attached: int = 0


def reduce_polynomial(
    component: Component,
    properties: SolidProperties,
    loads: Sequence[Load] = (),
    sensors: Sequence[Sensor] = (),
    *,
    request: ReductionRequest,
) -> Superelement:
    """Reduce a component of one section to polynomials (Rayleigh-Ritz), with its error by lower
    degrees.

    Stiffness and mass are integrated in closed form. Means over averaging interfaces and rails are
    those of finite elements; on a rigid interface the motion is rigid as far as polynomials of
    these degrees can show. Frequencies come from above, and far above where patches are small
    beside the body.

    Args:
        component: A box, a plate without ribs or a tube.
        properties: Volume, centre, inertia and interface centroids of its solid.
        loads: Body loads and tractions become one unit load per component axis.
        sensors: At positions in the component frame; where one is loaded, an attachment mode is added.

    Raises:
        ModelError: Its solid has not one section, a patch cannot be integrated over, or a load or
            an interface needs a mesh.
        AccuracyError: The superelement fails its own check.

    Source: Ritz (1909); Craig and Bampton (1968) for the reduction; Leissa and Zhang (1983), J. Acoust.
    Soc. Am. 73, 2013, for blocks.
    """
    bar = _as_bar(component)
    density = find_density(component, properties)
    fine, coarse, order = _make_spaces(component, bar)
    areas = {
        name: _measure_area(component, name, interface.patches, bar, order)
        for name, interface in component.interfaces.items()
    }
    frames, maps, rails = _lay_out_dofs(component, areas, properties)
    boundary = _prescribe(component, fine, areas, maps, rails)
    rigid = _rigid_dofs(bar.center, frames, rails)
    whole = _condense(component, fine, boundary, rigid)
    rough = _condense(component, coarse, _prescribe(component, coarse, areas, maps, rails), rigid)
    modes = _find_modes(whole, density, request.modes)
    limit = polynomial_limit(component.solid, component.material)
    modes = dataclasses.replace(modes, reach_hz=min(modes.reach_hz, limit))
    if loaded := [sensor.position for sensor in sensors if sensor.is_loaded]:
        modes = _attach(fine, whole, modes, density, np.array(loaded))
    fields = np.hstack([whole.psi, modes.shapes])
    stiffness = scipy.linalg.block_diag(whole.stiffness, np.diag(modes.squares))
    mass = density * fields.T @ fields
    skin = segment_skin(component)
    superelement = Superelement(
        name=component.name,
        labels=_name_dofs(maps, rails, len(modes.squares)),
        frames=frames,
        interface_maps=maps,
        stiffness=0.5 * (stiffness + stiffness.T),
        mass=0.5 * (mass + mass.T),
        constraints=np.pad(boundary.constraints, ((0, 0), (0, len(modes.squares)))),
        modal_frequencies_hz=np.sqrt(modes.squares) / (2.0 * math.pi),
        cutoff_hz=modes.reach_hz,
        full_dofs=3 * fine.count,
        mass_kg=density * properties.volume,
        center_of_mass=np.asarray(properties.center, dtype=float),
        inertia=density * 0.5 * (properties.inertia + properties.inertia.T),
        recovery=Recovery(fine.move(skin.points, fields), skin.points),
        loads={
            name: _reduce_load(fine, whole, modes, force, skin.points)
            for name, force in _list_forces(component, fine, bar, loads, request, density).items()
        },
        sensors={
            sensor.name: SensorRows(fine.move(np.array([sensor.position]), fields))
            for sensor in sensors
        },
        control_points=tuple(
            ControlPoint(point, rail.axis) for rail in rails for point in rail.points
        ),
        rails=free_rails(rails, 6 * len(frames), len(stiffness)),
        errors=ErrorEstimates(
            None if request.modes is None else _measure_truncation(whole, modes, density),
            _missing_energy(whole, rough, modes, density),
            SAFETY,
            # the solid itself is integrated over
            np.zeros_like(stiffness),
            np.zeros_like(stiffness),
        ),
    )
    check_superelement(superelement, rounding=ROUNDING)
    return superelement


def _as_bar(component: Component) -> PrismaticBar:
    try:
        bar = prismatic_bar(component.solid)
    except ValueError as error:
        raise _refusal(component, str(error)) from error
    flexible = [name for name, item in component.interfaces.items() if item.flexible]
    if flexible:
        raise _refusal(component, f"interface {flexible[0]} is flexible")
    return bar


def _refusal(component: Component, why: str) -> ModelError:
    return ModelError(
        f'component {component.name!r} cannot be polynomials: {why}; write fidelity = "elastic"'
    )


def _make_spaces(
    component: Component, bar: PrismaticBar
) -> tuple[PolynomialSpace, PolynomialSpace, tuple[int, int]]:
    """Return the polynomials of a body, those of a degree less, and the orders along and across that
    integrate them over its areas.
    """
    across, along = _choose_degrees(component, bar)
    fine = _make_space(component, bar, across, along)
    # a round section of two degrees lacks what shear needs, and would show that alone
    less = 0 if isinstance(component.solid, Tube) else 1
    coarse = _make_space(component, bar, [degree - less for degree in across], along - 1)
    return fine, coarse, (along + 2, max(across) + 2)


def _choose_degrees(component: Component, bar: PrismaticBar) -> tuple[list[int], int]:
    """Return the degrees along both sides of the section and along the bar: as fine in space along
    long sides as pays, and finer than the control points of rails.
    """
    sides = _sides(component, bar)
    degrees = [
        min(MOST_DEGREE, round(LEAST_DEGREE + DEGREES_PER_OCTAVE * math.log2(side / min(sides))))
        for side in sides
    ]
    for interface in component.interfaces.values():
        if interface.rail is not None:
            axis = "xyz".index(interface.rail.along)
            degrees[axis] = max(degrees[axis], interface.rail.control_points + DEGREES_BEYOND_RAIL)
    across = [degrees[axis] for axis in in_plane_axes(bar.axis)]
    if isinstance(component.solid, Tube):
        across = [SECTION_DEGREE, SECTION_DEGREE]
    return across, degrees[bar.axis]


def _sides(component: Component, bar: PrismaticBar) -> list[float]:
    solid = component.solid
    if isinstance(solid, Tube):
        sides = [solid.outer_diameter] * 3
        sides[bar.axis] = bar.length
        return sides
    return list(cast(Box | Plate, solid).size)


def _make_space(
    component: Component, bar: PrismaticBar, across: Sequence[int], along: int
) -> PolynomialSpace:
    sides = _sides(component, bar)
    half = 0.5 * np.array([sides[axis] for axis in in_plane_axes(bar.axis)])
    tube = component.solid if isinstance(component.solid, Tube) else None
    return build_space(bar, tube, half, component.material, across=across, along=along)


def _measure_area(
    component: Component, name: str, patches: Sequence[Patch], bar: PrismaticBar, order: Order
) -> MeshPatch:
    # the splines of rails are smooth between their knots only
    breaks = [float(coordinate) for coordinate in np.linspace(bar.low, bar.high, BREAKS + 1)]
    try:
        samples = sample_patches(
            cast(PlanarSolid | Tube, component.solid), patches, bar.axis, breaks, order=order
        )
    except ValueError as error:
        raise _refusal(component, str(error)) from error
    area = float(samples.areas.sum())
    return MeshPatch(
        name,
        np.arange(len(samples.points)),
        samples.points,
        scipy.sparse.diags(samples.areas, format="csr"),
        0.0 * samples.points,
        area,
        np.asarray(samples.areas @ samples.points / area, dtype=float),
        len(samples.points),
    )


def _lay_out_dofs(
    component: Component, areas: dict[str, MeshPatch], properties: SolidProperties
) -> tuple[tuple[Frame, ...], dict[str, InterfaceMap], list[RailFit]]:
    """Return the boundary nodes and interfaces, one each, or one for the whole body where there are
    none; rails.
    """
    fixed = {name: item for name, item in component.interfaces.items() if item.rail is None}
    rails = [
        fit_rail(component.name, item, areas[name])
        for name, item in component.interfaces.items()
        if item.rail is not None
    ]
    frames = [Frame(areas[name].centroid) for name in fixed]
    maps = {name: InterfaceMap(node, frames[node]) for node, name in enumerate(fixed)}
    if not fixed and not rails:
        frames = [Frame(np.asarray(properties.center, dtype=float))]
        maps = {BODY_NODE: InterfaceMap(0, frames[0])}
    return tuple(frames), maps, rails


def _prescribe(
    component: Component,
    space: PolynomialSpace,
    areas: dict[str, MeshPatch],
    maps: dict[str, InterfaceMap],
    rails: Sequence[RailFit],
) -> _Boundary:
    size = 6 * len(maps) + CONTROL_POINT_DOFS * sum(len(rail.points) for rail in rails)
    rows, values = [], []

    def add(some: FloatArray, first: int, target: FloatArray) -> None:
        lengths = np.linalg.norm(some, axis=1)[:, None]
        rows.append(some / lengths)
        wide = np.zeros((len(some), size))
        wide[:, first : first + target.shape[1]] = target / lengths
        values.append(wide)

    for name, dof_rows in maps.items():
        first = 6 * dof_rows.node
        if name == BODY_NODE:
            # the rigid motion that fits the whole body best
            rigid = space.rigid_motion(dof_rows.frame.origin)
            add(np.asarray(np.linalg.solve(rigid.T @ rigid, rigid.T)), first, np.eye(6))
        elif component.interfaces[name].coupling == "rigid":
            add(*_follow_rigidly(space, areas[name], first))
        else:
            means = space.pull(areas[name].points, areas[name].average_operator())
            add(means.T, first, np.eye(6))
    first = 6 * len(maps)
    for rail in rails:
        count = rail.operator.shape[1]
        add(space.pull(rail.patch.points, rail.operator).T, first, np.eye(count))
        first += count
    left, sizes, right = np.linalg.svd(np.vstack(rows), full_matrices=False)
    prescribed = left.T @ np.vstack(values)
    kept = sizes > ROW_DEPENDENCE * sizes[0]
    _, lengths, combinations = np.linalg.svd(prescribed[~kept], full_matrices=False)
    return _Boundary(
        right[kept],
        prescribed[kept] / sizes[kept, None],
        combinations[lengths > ROW_DEPENDENCE * np.linalg.norm(prescribed, ord=2)],
    )


def _follow_rigidly(
    space: PolynomialSpace, area: MeshPatch, first: int
) -> tuple[FloatArray, int, FloatArray]:
    """Return the rows ``(3 m, 3 n)`` of what polynomials can distinguish on a patch, where its
    first dof is, and what a rigid motion makes of them ``(3 m, 6)``.
    """
    weights = np.sqrt(area.weights.diagonal())
    left, sizes, right = np.linalg.svd(
        weights[:, None] * space.values(area.points), full_matrices=False
    )
    kept = sizes > FACE_DEPENDENCE * sizes[0]
    rows = np.kron(right[kept], np.eye(3))
    rigid = area.rigid_displacements().reshape(len(weights), 3, 6)
    target = np.einsum("km,kiq->miq", left[:, kept] * weights[:, None], rigid)
    return rows, first, (target / sizes[kept, None, None]).reshape(len(rows), 6)


def _rigid_dofs(
    center: FloatArray, frames: Sequence[Frame], rails: Sequence[RailFit]
) -> FloatArray:
    """Return the boundary dofs ``(n_b, 6)`` in the rigid motions about a point."""
    nodes = [rigid_transfer(center, frame.origin) for frame in frames]
    return np.vstack(
        nodes
        + [
            control_point_motion(point, rail.axis, center)
            for rail in rails
            for point in rail.points
        ]
    )


def _condense(
    component: Component, space: PolynomialSpace, boundary: _Boundary, rigid: FloatArray
) -> _Condensed:
    vectors, factors = _reflect(boundary.rows)
    count, stiffness = len(factors), space.stiffness
    # (1 - V T V^T)^T K (1 - V T V^T) = K - V W^T - W V^T
    moved = stiffness @ vectors @ factors
    moved -= 0.5 * vectors @ (factors.T @ (vectors.T @ moved))
    change = moved[count:] @ vectors[count:].T
    inner = stiffness[count:, count:] - change - change.T
    try:
        factor = scipy.linalg.cho_factor(inner)
    except scipy.linalg.LinAlgError as error:
        raise ModelError(
            f"component {component.name!r}: its interfaces leave a motion of its polynomials free"
        ) from error
    # rigid motions are known: only the rest is solved for, or slender bars would lose mass to rounding
    inverse = np.linalg.pinv(rigid)
    rest = np.eye(len(rigid)) - rigid @ inverse
    if len(rigid) == rigid.shape[1]:
        # one interface moves as a rigid body only: nothing but rounding is left of its stiffness
        rest = np.zeros_like(rest)
    part = boundary.rows.T @ (boundary.values @ rest)
    condensed = _Condensed((vectors, factors), inner, factor, part, np.zeros((0, 0)))
    bent = part - condensed.solve(stiffness @ part)
    psi = space.rigid_motion(space.bar.center) @ inverse + bent
    return dataclasses.replace(condensed, psi=psi, stiffness=bent.T @ stiffness @ bent)


def _reflect(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return V and T of the reflections ``1 - V T V^T`` that turn independent rows ``(m, n)`` into the
    first m axes.

    Source: Puglisi (1992), Modification of the Householder method based on the compact WY
    representation.
    """
    (vectors, lengths), _ = scipy.linalg.qr(rows.T, mode="raw")
    vectors = np.tril(vectors, -1)
    np.fill_diagonal(vectors, 1.0)
    # rows that are axes already are not reflected
    vectors[:, lengths == 0.0] = 0.0
    products = np.triu(vectors.T @ vectors, 1)
    np.fill_diagonal(products, 1.0 / np.where(lengths == 0.0, 1.0, lengths))
    return vectors, scipy.linalg.solve_triangular(products, np.eye(len(products)))


def _find_modes(whole: _Condensed, density: float, target: ModeTarget | None) -> _Modes:
    """Find the modes with the boundary at rest; none without a target."""
    if target is None:
        return _Modes(np.zeros(0), np.zeros((len(whole.psi), 0)), 0.0, np.inf)
    total, asked = len(whole.inner), FIRST_SEARCH
    while True:
        asked = min(asked, total)
        squares, vectors = scipy.linalg.eigh(whole.inner, subset_by_index=[0, asked - 1])
        squares = squares / density
        frequencies = np.sqrt(squares) / (2.0 * math.pi)
        count = target.count_wanted(frequencies)
        if count < asked or asked == total:
            break
        asked *= 2
    reach, beyond = (frequencies[count], squares[count]) if count < total else (np.inf, np.inf)
    shapes = whole.spread(vectors[:, :count] / math.sqrt(density))
    return _Modes(squares[:count], shapes, float(reach), float(beyond))


def _attach(
    space: PolynomialSpace, whole: _Condensed, modes: _Modes, density: float, places: FloatArray
) -> _Modes:
    """Return the modes with residual-attachment modes of forces at places ``(s, 3)`` behind them, see
    ``fixed_interface_modes.add_attachment_modes``.
    """
    forces = whole.gather(space.pull(places, np.eye(places.size)))
    kept = math.sqrt(density) * whole.gather(modes.shapes)
    responses = scipy.linalg.cho_solve(whole.factor, forces)
    rest = responses - kept @ ((kept.T @ forces) / (density * modes.squares)[:, None])
    combinations, squares = combine_attachments(
        rest.T @ whole.inner @ rest,
        density * rest.T @ rest,
        flexibility=np.einsum("ij,ij->j", forces, responses),
        stiffness_scale=float(whole.inner.diagonal().max()),
    )
    return dataclasses.replace(
        modes,
        squares=np.concatenate([modes.squares, squares]),
        shapes=np.hstack([modes.shapes, whole.spread(rest @ combinations)]),
        attached=len(squares),
    )


def _missing_energy(
    whole: _Condensed, rough: _Condensed, modes: _Modes, density: float
) -> FloatArray:
    """Return what polynomials of fewer degrees are too stiff by ``(n, n)``: about what these
    are.
    """
    boundary = rough.stiffness - whole.stiffness
    values, vectors = np.linalg.eigh(0.5 * (boundary + boundary.T))
    boundary = vectors * np.maximum(values, 0.0) @ vectors.T
    count = min(len(modes.squares), len(rough.inner))
    modal = np.zeros(len(modes.squares))
    if count:
        coarse = scipy.linalg.eigh(rough.inner, eigvals_only=True, subset_by_index=[0, count - 1])
        modal[:count] = np.maximum(coarse / density - modes.squares[:count], 0.0)
    return scipy.linalg.block_diag(boundary, np.diag(modal))


def _measure_truncation(whole: _Condensed, modes: _Modes, density: float) -> Truncation:
    """Return the moments of the modes left out, see ``fixed_interface_modes.measure_truncation``."""
    boundary, every = whole.gather(whole.psi), math.sqrt(density) * whole.gather(modes.shapes)
    kept, attached = np.split(every, [len(modes.squares) - modes.attached], axis=1)
    for _ in range(2):
        boundary = boundary - kept @ (kept.T @ boundary)
    once = scipy.linalg.cho_solve(whole.factor, boundary)
    if modes.attached:
        stiffness = density * modes.squares[-modes.attached :, None]
        once = once - attached @ (attached.T @ boundary / stiffness)
    first, second = density**2 * boundary.T @ once, density**3 * once.T @ once
    return Truncation(first, second, min(modes.beyond, lowest_participating(first, second)))


def _list_forces(
    component: Component,
    space: PolynomialSpace,
    bar: PrismaticBar,
    loads: Sequence[Load],
    request: ReductionRequest,
    density: float,
) -> dict[str, FloatArray]:
    """Return the forces ``(3 n,)`` on the polynomials per unit of each load and axis."""
    forces: dict[str, FloatArray] = {}
    uniform = density * space.rigid_motion(bar.center)[:, :3]
    if request.gravity:
        forces |= {f"{GRAVITY}:{axis}": uniform[:, i] for i, axis in enumerate(DIRECTIONS)}
    for load in loads:
        if load.component != component.name or load.kind == "force":
            continue
        if load.kind == "body":
            unit = uniform
        elif load.kind == "traction":
            order = space.along + 2, int(space.degrees.max()) + 2
            area = _measure_area(component, load.name, load.patches, bar, order)
            unit = np.kron(area.weights.diagonal() @ space.values(area.points), np.eye(3)).T
        else:
            raise _refusal(component, f"load {load.name} is a {load.kind}")
        forces |= {f"{load.name}:{axis}": unit[:, i] for i, axis in enumerate(DIRECTIONS)}
    return forces


def _reduce_load(
    space: PolynomialSpace,
    whole: _Condensed,
    modes: _Modes,
    force: FloatArray,
    points: FloatArray,
) -> StaticLoad:
    """Return a force on the reduced dofs, and what remains of its displacement with those at zero."""
    modal = modes.shapes.T @ force
    rest = whole.solve(force[:, None])[:, 0] - modes.shapes @ (modal / modes.squares)
    return StaticLoad(
        np.concatenate([whole.psi.T @ force, modal]), space.move(points, rest[:, None])[:, 0]
    )


def _name_dofs(
    maps: dict[str, InterfaceMap], rails: Sequence[RailFit], modes: int
) -> tuple[tuple[str, str], ...]:
    return (
        *((name, dof) for name in maps for dof in DOF_NAMES),
        *(
            (f"{rail.name}[{number}]", dof)
            for rail in rails
            for number in range(len(rail.points))
            for dof in (*DIRECTIONS, DOF_NAMES[3 + rail.axis])
        ),
        *(("mode", str(number + 1)) for number in range(modes)),
    )
