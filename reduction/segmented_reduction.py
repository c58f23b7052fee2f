"""A bar as rigid segments in a row, coupled by six-dof beam springs: the elastic body of the Axis Construction Kit."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.components import Component, Load
from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame, rigid_map, rigid_transfer
from headstock.geometry.mass_properties import SolidProperties
from headstock.geometry.patches import in_plane_axes
from headstock.geometry.prismatic_solids import PrismaticBar, interface_span, prismatic_bar
from headstock.reduction.segment_springs import segment_mass, spring_stiffness
from headstock.reduction.superelement import Attachment, StaticLoad, Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.errors import ModelError

END_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class SegmentRow:
    """Nodes of a segmented bar: the segments' centres first, then massless nodes.

    Attributes:
        bar: The bar.
        count: Number of segments.
        places: ``(n, 3)`` node places [m]: centres, end faces that carry an interface, averaging interfaces.
        names: A name per node.
        attachments: Interface to node and frame.
        constraints: ``(m, 6 n)`` rows that tie segments under a rigid interface or define an averaging one.
    """

    bar: PrismaticBar
    count: int
    places: FloatArray
    names: tuple[str, ...]
    attachments: dict[str, Attachment]
    constraints: FloatArray


def reduce_segmented(component: Component, properties: SolidProperties, loads: Sequence[Load] = ()) -> Superelement:
    """A component as a row of rigid segments with six dofs each.

    Neighbours are coupled by the exact stiffness of the beam between their centres, an interface on an end face by that of half
    a segment. Other interfaces act on the segment that holds their centre; one that spans several segments ties them together
    where its coupling is rigid and moves with their mean (weighed by the length it covers) where it averages.

    Args:
        component: Its solid must be a bar of one section; ``mass`` scales its density when given.
        properties: Volume, centre and interface centroids of its solid.
        loads: Body loads and tractions become one unit load per component axis, as in ``reduce_rigid``.

    Raises:
        ModelError: The solid is no bar of one section, or a load cannot act on segments.
        AccuracyError: The superelement fails its own check.

    Source: Kono, Lorenzer, Weikert and Wegener, section 2.2 (segmented bodies coupled with each other).
    """
    try:
        bar = prismatic_bar(component.solid, component.segments.along)
    except ValueError as error:
        raise ModelError(f'component {component.name!r} cannot be segmented: {error}; write fidelity = "elastic"') from error
    row = _lay_out_row(component, bar, properties)
    density = component.material.density if component.mass is None else component.mass / (bar.area * bar.length)
    mass, stiffness = _row_mass(row, density), _row_stiffness(row, component)
    motions = np.vstack([rigid_transfer(bar.center, place) for place in row.places])
    whole = motions.T @ mass @ motions
    points, recovery = _corner_recovery(row)
    superelement = Superelement(
        name=component.name,
        labels=tuple((name, dof) for name in row.names for dof in DOF_NAMES),
        frames=tuple(Frame(place) for place in row.places),
        attachments=row.attachments,
        stiffness=stiffness,
        mass=mass,
        damping=None,
        recovery=recovery,
        recovery_points=points,
        constraints=row.constraints,
        modal_frequencies_hz=np.zeros(0),
        cutoff_hz=np.inf,
        full_dofs=6 * row.count,
        mass_kg=float(whole[0, 0]),
        center_of_mass=bar.center,
        inertia=0.5 * (whole[3:, 3:] + whole[3:, 3:].T),
        loads=_row_loads(row, component, properties, mass, loads),
    )
    check_superelement(superelement)
    return superelement


def _lay_out_row(component: Component, bar: PrismaticBar, properties: SolidProperties) -> SegmentRow:
    count = component.segments.count
    edges = np.linspace(bar.low, bar.high, count + 1)
    places = [_on_axis(bar, float(0.5 * (a + b))) for a, b in itertools.pairwise(edges)]
    names = [f"segment_{number}" for number in range(1, count + 1)]
    attachments: dict[str, Attachment] = {}
    ties: list[tuple[int, FloatArray]] = []  # node and weights of the segments it follows
    for name, interface in component.interfaces.items():
        span = interface_span(bar, interface)
        frame = Frame(properties.patch_centroids[name])
        if span is None:
            raise ModelError(
                f"component {component.name!r}: interface {name!r} has patches apart from each other along the bar, which "
                'segments cannot show; write one interface for each, or fidelity = "elastic"'
            )
        middle = min(max(0.5 * sum(span), bar.low), bar.high)
        covered = np.maximum(0.0, np.minimum(edges[1:], span[1]) - np.maximum(edges[:-1], span[0]))
        held = np.flatnonzero(covered > 0.5 * bar.length / count)
        if span[1] - span[0] <= END_TOLERANCE * bar.length:
            node = _end_node(bar, middle, places, names)
        elif interface.coupling == "average" and np.count_nonzero(covered) > 1:
            node = len(places)
            places.append(frame.origin)
            names.append(name)
            ties.append((node, covered / covered.sum()))
        else:
            node = int(held[0]) if len(held) else min(int((middle - bar.low) / bar.length * count), count - 1)
            ties += [(int(other), np.eye(count)[node]) for other in held[1:]]
        attachments[name] = Attachment(node, frame)
    table = np.array(places)
    return SegmentRow(bar, count, table, tuple(names), attachments, _tie_rows(table, ties))


def _on_axis(bar: PrismaticBar, place: float) -> FloatArray:
    point = np.array(bar.center)
    point[bar.axis] = place
    return point


def _end_node(bar: PrismaticBar, place: float, places: list[FloatArray], names: list[str]) -> int:
    """Index of the massless node on an end face, made where it is missing."""
    name = "low_end" if place < bar.center[bar.axis] else "high_end"
    if name not in names:
        names.append(name)
        places.append(_on_axis(bar, place))
    return names.index(name)


def _tie_rows(places: FloatArray, ties: Sequence[tuple[int, FloatArray]]) -> FloatArray:
    """Rows ``(6 t, 6 n)``: a node less the weighed motions of the segments carried to it."""
    rows = np.zeros((6 * len(ties), 6 * len(places)))
    for number, (node, weights) in enumerate(ties):
        block = rows[6 * number : 6 * number + 6]
        block[:, 6 * node : 6 * node + 6] = np.eye(6)
        for segment in np.flatnonzero(weights):
            transfer = rigid_transfer(places[segment], places[node])
            block[:, 6 * segment : 6 * segment + 6] -= weights[segment] * transfer
    return rows


def _row_stiffness(row: SegmentRow, component: Component) -> FloatArray:
    chain = [*range(row.count)]
    if "low_end" in row.names:
        chain.insert(0, row.names.index("low_end"))
    if "high_end" in row.names:
        chain.append(row.names.index("high_end"))
    stiffness = np.zeros((6 * len(row.places), 6 * len(row.places)))
    for first, second in itertools.pairwise(chain):
        dofs = [6 * first + i for i in range(6)] + [6 * second + i for i in range(6)]
        stiffness[np.ix_(dofs, dofs)] += spring_stiffness(row.bar, component.material, row.places[first], row.places[second])
    return stiffness


def _row_mass(row: SegmentRow, density: float) -> FloatArray:
    carried = np.diag([1.0] * row.count + [0.0] * (len(row.places) - row.count))
    return np.asarray(np.kron(carried, segment_mass(row.bar, density, row.bar.length / row.count)), dtype=np.float64)


def _corner_recovery(row: SegmentRow) -> tuple[FloatArray, FloatArray]:
    """Four corners of each segment's section ``(4 n, 3)`` [m] and their displacement per unit dof: bending and twist are seen."""
    reach = np.sqrt(12.0 * np.array(row.bar.second_moments) / row.bar.area) / 2.0
    corners = np.zeros((4, 3))
    corners[:, in_plane_axes(row.bar.axis)] = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * reach
    points = row.places[: row.count, None, :] + corners
    recovery = np.zeros((12 * row.count, 6 * len(row.places)))
    for node in range(row.count):
        recovery[12 * node : 12 * node + 12, 6 * node : 6 * node + 6] = rigid_map(points[node], row.places[node])
    return points.reshape(-1, 3), recovery


def _row_loads(
    row: SegmentRow, component: Component, properties: SolidProperties, mass: FloatArray, loads: Sequence[Load]
) -> dict[str, StaticLoad]:
    """Unit loads along each component axis: body loads by mass, tractions on the segment under their centroid."""
    found: dict[str, StaticLoad] = {}
    for load in loads:
        if load.component != component.name or load.kind == "force":
            continue
        group = f"load:{load.name}"
        if load.kind == "body":
            unit = mass @ np.tile(np.eye(6, 3), (len(row.places), 1))
        elif load.kind == "traction" and group in properties.patch_centroids:
            centroid = properties.patch_centroids[group]
            share = (centroid[row.bar.axis] - row.bar.low) / row.bar.length
            node = min(max(int(share * row.count), 0), row.count - 1)
            unit = np.zeros((6 * len(row.places), 3))
            transfer = rigid_transfer(row.places[node], centroid)[:3]
            unit[6 * node : 6 * node + 6] = properties.patch_areas[group] * transfer.T
        else:
            raise ModelError(
                f"load {load.name!r}: {load.kind} cannot act on the segmented component {component.name!r}; "
                "write a force at one of its interfaces, or make the component elastic"
            )
        found |= {f"{load.name}:{axis}": StaticLoad(unit[:, i]) for i, axis in enumerate("xyz")}
    return found
