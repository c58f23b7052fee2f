"""Superelements from matrices of other programs, checked: rigid motions, mass, symmetry, units and
order.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import scipy.linalg

from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame, rigid_map
from headstock.meshing.component_mesh import IntArray
from headstock.pipeline.exchange.matrices import MOST_DOFS, BodyMatrices, ExchangeError
from headstock.reduction.superelement import InterfaceMap, Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.errors import AccuracyError

PRINTED = 1e-8  # relative rounding of matrices that were printed with ten digits
RIGID_LIMIT = 1e-6  # of K times a rigid motion, over the largest row of K that it moves
SCALES = {"mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "m": 1e3}  # what points may be in instead
LIGHTEST, HEAVIEST = 1e-6, 1e7  # plausible masses of a part of a machine [kg]
LARGEST = 100.0  # plausible extent [m]


def make_superelement(body: BodyMatrices, *, supported: bool = False) -> Superelement:
    """Return the superelement of a body of other programs; every node is an interface ``node_NUMBER``.

    Rotations that a node lacks follow the rigid motion nearest to those of all nodes.

    Args:
        supported: The body is held, and no rigid motion is free of force.

    Raises:
        ExchangeError: A node has no place, or the matrices are not those of such a body; says what
            would be right where units, order or axes explain it.
    """
    numbers = _list_placed_nodes(body)
    size = len(DOF_NAMES) * len(numbers)
    if not supported:
        _require_rigid_motions(body)
    _require_extent(body, numbers)
    places = _place_rows(body, numbers)
    full = {letter: _spread(matrix, places, size) for letter, matrix in body.matrices.items()}
    mass, center, inertia = _find_mass(body, supported=supported)
    frames = tuple(Frame(np.array(body.points[number]), np.eye(3)) for number in numbers)
    scalars = len(body.scalar_nodes)
    superelement = Superelement(
        name=body.name,
        labels=(
            *((str(number), dof) for number in numbers for dof in DOF_NAMES),
            *(("mode", str(number)) for number in range(1, scalars + 1)),
        ),
        frames=frames,
        interface_maps={
            f"node_{number}": InterfaceMap(node, frames[node])
            for node, number in enumerate(numbers)
        },
        stiffness=full["K"],
        mass=full["M"],
        damping=full.get("C"),
        constraints=_bind_missing(body, places, size, size + scalars, supported=supported),
        modal_frequencies_hz=(frequencies := _find_modal_frequencies(body)),
        cutoff_hz=float(frequencies[-1]) if scalars else np.inf,
        full_dofs=len(body.nodes),
        mass_kg=mass,
        center_of_mass=center,
        inertia=inertia,
        supported=supported,
    )
    try:
        check_superelement(superelement, rounding=PRINTED)
    except AccuracyError as error:
        raise ExchangeError(
            f"{body.name}: {error}; check that all matrices are of one body and one set of units"
        ) from error
    return superelement


def _list_placed_nodes(body: BodyMatrices) -> list[int]:
    """Return the numbers of the nodes that have dofs.

    Raises:
        ExchangeError: There is none, one has no place, or there are too many.
    """
    numbers = sorted({int(node) for node, dof in body.nodes if dof > 0})
    if not numbers:
        raise ExchangeError(
            f"{body.name}: no row is the dof of a node, so nothing could be attached; add the list of dofs NAME.dof, "
            'or write points = "NAME.bdf", bulk data with cards GRID'
        )
    for number in numbers:
        if number not in body.points:
            raise ExchangeError(
                f'{body.name}: node {number} has dofs but no place; write points = "NAME.bdf", '
                "bulk data with its GRID card, or a deck (.inp) with its line below *NODE"
            )
        if not np.isfinite(body.points[number]).all():
            raise ExchangeError(f"{body.name}: the place of node {number} is no number")
    if len(DOF_NAMES) * len(numbers) + len(body.scalar_nodes) > MOST_DOFS:
        raise ExchangeError(
            f"{body.name}: {len(numbers)} nodes with six dofs each are more than {MOST_DOFS}; reduce the model further"
        )
    return numbers


def _require_extent(body: BodyMatrices, numbers: list[int]) -> None:
    """Refuse a body that is larger than any part of a machine."""
    extent = float(np.ptp([body.points[number] for number in numbers], axis=0).max())
    if extent > LARGEST:
        raise ExchangeError(
            f"{body.name}: its nodes lie up to {extent:.4g} m apart; matrices in mm, N and t become those in SI "
            "by 1000 times the translations' stiffness and mass, 1 of mixed and 0.001 of rotations"
        )


def _place_rows(body: BodyMatrices, numbers: list[int]) -> IntArray:
    """Return the row of each dof in a superelement: nodes in their order, then scalar dofs."""
    count = itertools.count(len(DOF_NAMES) * len(numbers))
    order = {number: row for row, number in enumerate(numbers)}
    return np.array(
        [
            next(count) if dof == 0 else len(DOF_NAMES) * order[int(node)] + int(dof) - 1
            for node, dof in body.nodes
        ],
        dtype=np.int64,
    )


def _spread(matrix: FloatArray, places: IntArray, size: int) -> FloatArray:
    result = np.zeros((max(size, int(places.max(initial=-1)) + 1),) * 2)
    result[np.ix_(places, places)] = matrix
    return result


def _bind_missing(
    body: BodyMatrices, places: IntArray, size: int, count: int, *, supported: bool
) -> FloatArray:
    """Return the constraints ``(m, count)`` by which dofs that nodes lack follow the body; translations
    that those of a supported body lack are held.

    Raises:
        ExchangeError: Its nodes are too few to say how it turns.
    """
    missing = np.setdiff1d(np.arange(size), places)
    rows = np.zeros((len(missing), count))
    if not len(missing):
        return rows
    points = {number: np.array(point) for number, point in body.points.items()}
    numbers = sorted({int(node) for node, dof in body.nodes if dof > 0})
    center = np.mean([points[number] for number in numbers], axis=0)
    extent = max(float(np.abs(points[number] - center).max()) for number in numbers) or 1.0
    scale = np.repeat([1.0, 1.0 / extent], 3)
    around = {number: points[number] - center for number in numbers}
    motions = _list_rigid_motions(body, around) * scale
    if np.linalg.matrix_rank(motions, tol=1e-9) < motions.shape[1]:
        raise ExchangeError(
            f"{body.name}: its nodes lack rotations and lie on a line; give them six dofs, or name more nodes"
        )
    fit = scale[:, None] * np.linalg.pinv(motions)
    whole = {
        number: np.block(
            [[rigid_map(around[number][None], np.zeros(3))], [np.zeros((3, 3)), np.eye(3)]]
        )
        for number in numbers
    }
    for row, dof in enumerate(missing):
        number, own = numbers[dof // len(DOF_NAMES)], dof % len(DOF_NAMES)
        if not (supported and own < 3):
            rows[row, places] -= whole[number][own] @ fit
        rows[row, dof] += 1.0
    return rows


def _list_rigid_motions(body: BodyMatrices, points: Mapping[int, FloatArray]) -> FloatArray:
    """Return the dofs ``(n, 6)`` of the rigid motions about the origin; scalar dofs rest."""
    motions = np.zeros((len(body.nodes), 6))
    for row, (node, dof) in enumerate(body.nodes):
        if 1 <= dof <= 3:
            motions[row] = rigid_map(points[int(node)][None], np.zeros(3))[dof - 1]
        elif dof > 3:
            motions[row, dof - 1] = 1.0
    return motions


def _rigid_rest(body: BodyMatrices) -> float:
    """Return the largest force of a rigid motion over the largest of the forces that cancel in it."""
    motions = _list_rigid_motions(
        body, {number: np.array(point) for number, point in body.points.items()}
    )
    forces = np.abs(body.stiffness @ motions)
    parts = np.abs(body.stiffness) @ np.abs(motions)
    return float((forces / np.maximum(parts.max(axis=0), np.finfo(float).tiny)).max(initial=0.0))


def _require_rigid_motions(body: BodyMatrices) -> None:
    """Refuse a body that rigid motions strain, and say which unit, axes or order would be right."""
    rest = _rigid_rest(body)
    if rest <= RIGID_LIMIT:
        return
    remedy = next(
        (words for words, other in _list_slips(body) if _rigid_rest(other) <= RIGID_LIMIT),
        "if it is held to ground, say so (supported); otherwise check units, order of dofs and axes",
    )
    raise ExchangeError(
        f"{body.name}: moved as a rigid body it answers with {rest:.1e} of its largest forces, which should be zero; {remedy}"
    )


def _list_slips(body: BodyMatrices) -> Iterator[tuple[str, BodyMatrices]]:
    """Yield what may have gone wrong, and the body as it would be without it."""
    for unit, scale in SCALES.items():
        points = {n: (scale * x, scale * y, scale * z) for n, (x, y, z) in body.points.items()}
        words = f"with points in {unit} it is zero: their unit is {unit}"
        yield words, replace(body, points=points)
    for first, second, third in itertools.permutations(range(3)):
        points = {n: (p[first], p[second], p[third]) for n, p in body.points.items()}
        order = " ".join("xyz"[axis] for axis in (first, second, third))
        words = f"with the coordinates of its points in the order {order} it is zero: axes are exchanged"
        yield words, replace(body, points=points)
    node, dof = body.nodes.T
    placed = dof > 0
    by_dof = np.lexsort((node, dof, ~placed))
    orders = {
        "by dof, x of all nodes first": body.nodes[by_dof],
        "rotations before translations": np.column_stack(
            [node, np.where(placed, (dof + 2) % 6 + 1, 0)]
        ),
        "scalar dofs first": np.vstack([body.nodes[~placed], body.nodes[placed]]),
    }
    for order, nodes in orders.items():
        yield f"with rows in another order it is zero: {order}", replace(body, nodes=nodes)


def _find_mass(body: BodyMatrices, *, supported: bool) -> tuple[float, FloatArray, FloatArray]:
    """Return mass [kg], centre ``(3,)`` and inertia ``(3, 3)`` about it; of a supported body what moves
    along the direction with most.

    Raises:
        ExchangeError: The mass differs between directions, or is none of a part of a machine.
    """
    points = {number: np.array(point) for number, point in body.points.items()}
    motions = _list_rigid_motions(body, points)
    rigid = motions.T @ body.mass @ motions
    mass = float(rigid.diagonal()[:3].max() if supported else np.trace(rigid[:3, :3]) / 3.0)
    if mass == 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    uneven = np.abs(rigid[:3, :3] - mass * np.eye(3)).max() > RIGID_LIMIT * abs(mass)
    if uneven and not supported:
        raise ExchangeError(
            f"{body.name}: its mass is {rigid[0, 0]:.4g}, {rigid[1, 1]:.4g}, {rigid[2, 2]:.4g} along x, y, z; check the order of its dofs"
        )
    if not LIGHTEST <= mass <= HEAVIEST:
        raise ExchangeError(
            f"{body.name}: its mass is {mass:.3g} kg; matrices in N, mm and t have forces per m 1000 times and masses 1000 times larger in SI"
        )
    moment = rigid[:3, 3:] / mass  # minus the cross product matrix of the centre
    center = (
        np.array(
            [moment[1, 2] - moment[2, 1], moment[2, 0] - moment[0, 2], moment[0, 1] - moment[1, 0]]
        )
        / 2.0
    )
    offset = rigid_map(-center[None], np.zeros(3))
    inertia = rigid[3:, 3:] - mass * offset[:, 3:].T @ offset[:, 3:]
    return mass, center, 0.5 * (inertia + inertia.T)


def _find_modal_frequencies(body: BodyMatrices) -> FloatArray:
    scalar = np.flatnonzero(body.nodes[:, 1] == 0)
    if not len(scalar):
        return np.zeros(0)
    part = np.ix_(scalar, scalar)
    try:
        squares = scipy.linalg.eigh(body.stiffness[part], body.mass[part], eigvals_only=True)
    except np.linalg.LinAlgError as error:
        raise ExchangeError(
            f"{body.name}: the mass of its scalar dofs is not positive; leave out scalar points without mass"
        ) from error
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi))
