"""A segmented bar: its nodes, the six-dof springs between segments, the mass of each, and how the
bar moves at any place along it; how interfaces and loads on its surface act on the nodes.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame, rigid_map, rigid_transfer
from headstock.geometry.parts.components import Component, Interface, Material, Patch
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.geometry.parts.patches import (
    PatchSamples,
    PlanarSolid,
    in_plane_axes,
    sample_patches,
)
from headstock.geometry.parts.prismatic_bars import PrismaticBar, patch_span, shear_coefficient
from headstock.geometry.parts.solids import Tube
from headstock.reduction.superelement import InterfaceMap

# parts closer to each other than this share of a segment move as one: a spring between them would
# be absurdly stiff
CLOSEST = 1e-4
Span = tuple[float, float]
DEPENDENCE_TOLERANCE = 1e-10


def _spring_stiffness(
    bar: PrismaticBar, material: Material, first: FloatArray, second: FloatArray
) -> FloatArray:
    """Return the stiffness ``(12, 12)`` of a piece of a bar between two places on its axis [N/m, N,
    N m].

    Exact for loads at its ends: extension, Saint-Venant torsion and bending with shear in both
    directions.

    Source: Timoshenko (1921); Przemieniecki (1968), section 5.6 (by inversion of the end's
    flexibility).
    """
    length = float(np.linalg.norm(second - first))
    end = np.linalg.inv(_end_flexibility(bar, material, length))
    if second[bar.axis] < first[bar.axis]:
        raise ValueError("a spring runs in the direction of the bar's axis")
    stretch = np.hstack([-rigid_transfer(first, second), np.eye(6)])
    stiffness = stretch.T @ end @ stretch
    return 0.5 * (stiffness + stiffness.T)


def _end_flexibility(bar: PrismaticBar, material: Material, length: float) -> FloatArray:
    """Return the motion ``(6, 6)`` of the upper end of a piece per unit load there, its lower end
    fixed [m/N, rad/N, rad/(N m)].
    """
    modulus = material.youngs_modulus
    shear = modulus / (2.0 * (1.0 + material.poisson_ratio))
    across = in_plane_axes(bar.axis)
    flexibility = np.zeros((6, 6))
    flexibility[bar.axis, bar.axis] = length / (modulus * bar.area)
    flexibility[3 + bar.axis, 3 + bar.axis] = length / (
        shear * bar.torsion_constant * bar.torsion_factor
    )
    slide = length / (shear_coefficient(bar, material.poisson_ratio) * shear * bar.area)
    for direction, about, second_moment in zip(
        across, across[::-1], bar.second_moments, strict=True
    ):
        bending = modulus * second_moment * bar.bending_factor
        # a small rotation about `about` moves points further along the axis by +-1 in `direction`
        sign = float(np.cross(np.eye(3)[about], np.eye(3)[bar.axis])[direction])
        flexibility[direction, direction] = length**3 / (3.0 * bending) + slide
        flexibility[3 + about, 3 + about] = length / bending
        flexibility[direction, 3 + about] = flexibility[3 + about, direction] = (
            sign * length**2 / (2.0 * bending)
        )
    return flexibility


def segment_mass(bar: PrismaticBar, density: float, length: float) -> FloatArray:
    """Return the mass matrix ``(6, 6)`` of a rigid segment about its centre [kg, kg m^2].

    Args:
        density: [kg/m^3].
        length: Of the segment [m].
    """
    across = in_plane_axes(bar.axis)
    mass = density * bar.area * length
    matrix = np.diag([mass, mass, mass, 0.0, 0.0, 0.0])
    matrix[3 + bar.axis, 3 + bar.axis] = density * length * sum(bar.second_moments)
    for about, second_moment in zip(across[::-1], bar.second_moments, strict=True):
        matrix[3 + about, 3 + about] = density * length * second_moment + mass * length**2 / 12.0
    return matrix


@dataclass(frozen=True)
class _SegmentNode:
    """A stretch of a bar that moves rigidly with one node: a segment's centre (no length), an end
    face, or rigid interfaces.

    Attributes:
        low: Where it begins along the bar [m].
        high: Where it ends [m].
    """

    low: float
    high: float
    node: int


@dataclass(frozen=True, eq=False)
class _SegmentChain:
    """A bar as nodes: the segments' centres first, then one massless node for each rigid stretch
    that holds no centre.

    Attributes:
        places: ``(n, 3)`` node places in the component frame [m].
        nodes_along: In ascending order along the bar; springs run between neighbours.
        coupled: Segments whose centre lies in a rigid stretch that another node represents:
            ``(segment, node)``.
    """

    bar: PrismaticBar
    material: Material
    count: int
    places: FloatArray
    nodes_along: tuple[_SegmentNode, ...]
    coupled: tuple[tuple[int, int], ...]


def _lay_out_chain(
    bar: PrismaticBar, material: Material, count: int, rigid_spans: Sequence[Span]
) -> _SegmentChain:
    """Cut a bar into equal segments, and make what rigid interfaces and end faces cover rigid from
    edge to edge.

    Args:
        rigid_spans: Where rigid interfaces begin and end; those that touch become one rigid
            stretch. An end face is a span without length, which gets a node of its own beyond half
            a segment's spring.
    """
    length = bar.length / count
    places = [bar.low + (number + 0.5) * length for number in range(count)]
    coupled: list[tuple[int, int]] = []
    nodes_along: list[_SegmentNode] = []
    inside: set[int] = set()
    for low, high in _join_spans(rigid_spans, CLOSEST * length):
        within = [
            i
            for i in range(count)
            if low - CLOSEST * length <= places[i] <= high + CLOSEST * length
        ]
        inside.update(within)
        if within:
            low, high = min(low, places[within[0]]), max(high, places[within[-1]])
        else:
            places.append(0.5 * (low + high))
        node = within[0] if within else len(places) - 1
        nodes_along.append(_SegmentNode(low, high, node))
        coupled += [(other, node) for other in within[1:]]
    nodes_along += [_SegmentNode(places[i], places[i], i) for i in range(count) if i not in inside]
    on_axis = np.tile(bar.center, (len(places), 1))
    on_axis[:, bar.axis] = places
    return _SegmentChain(
        bar,
        material,
        count,
        on_axis,
        tuple(sorted(nodes_along, key=lambda segment_node: segment_node.low)),
        tuple(coupled),
    )


def _join_spans(spans: Sequence[Span], slack: float) -> list[Span]:
    """Return the ascending spans apart from each other that cover the same places."""
    joined: list[Span] = []
    for low, high in sorted(spans):
        if joined and low <= joined[-1][1] + slack:
            joined[-1] = (joined[-1][0], max(high, joined[-1][1]))
        else:
            joined.append((low, high))
    return joined


def _node_at(chain: _SegmentChain, position: float) -> _SegmentNode:
    """Return the node nearest to a place along the bar."""
    return min(
        chain.nodes_along,
        key=lambda segment_node: max(segment_node.low - position, position - segment_node.high),
    )


def chain_stiffness(chain: _SegmentChain) -> FloatArray:
    """Return the stiffness ``(6 n, 6 n)`` of the springs between neighbouring nodes."""
    size = 6 * len(chain.places)
    stiffness = np.zeros((size, size))
    for first, second in itertools.pairwise(chain.nodes_along):
        start, stop = _axis_point(chain, first.high), _axis_point(chain, second.low)
        carry = np.zeros((12, size))
        carry[:6, _dofs(first.node)] = rigid_transfer(chain.places[first.node], start)
        carry[6:, _dofs(second.node)] = rigid_transfer(chain.places[second.node], stop)
        touched = [
            *range(*_dofs(first.node).indices(size)),
            *range(*_dofs(second.node).indices(size)),
        ]
        part = carry[:, touched]
        stiffness[np.ix_(touched, touched)] += (
            part.T @ _spring_stiffness(chain.bar, chain.material, start, stop) @ part
        )
    return stiffness


def section_motion(chain: _SegmentChain, position: float) -> FloatArray:
    """Return the motion ``(6, 6 n)`` of the section at a place along the bar, at its centre, per
    unit node dof.

    Between nodes it is that of the beam loaded at its ends, before the first and after the last
    one it is rigid.
    """
    here = _axis_point(chain, position)
    motion = np.zeros((6, 6 * len(chain.places)))
    nearest = _node_at(chain, position)
    if (
        nearest.low <= position <= nearest.high
        or position < chain.nodes_along[0].low
        or position > chain.nodes_along[-1].high
    ):
        motion[:, _dofs(nearest.node)] = rigid_transfer(chain.places[nearest.node], here)
        return motion
    second = next(
        i for i, segment_node in enumerate(chain.nodes_along) if segment_node.low > position
    )
    before, after = chain.nodes_along[second - 1], chain.nodes_along[second]
    start, stop = _axis_point(chain, before.high), _axis_point(chain, after.low)
    # the end force at `stop`, carried to here, bends what lies between `start` and here
    end_force = _spring_stiffness(chain.bar, chain.material, start, stop)[6:]
    deflection = (
        _end_flexibility(chain.bar, chain.material, position - before.high)
        @ rigid_transfer(here, stop).T
        @ end_force
    )
    deflection[:, :6] += rigid_transfer(start, here)
    motion[:, _dofs(before.node)] += deflection[:, :6] @ rigid_transfer(
        chain.places[before.node], start
    )
    motion[:, _dofs(after.node)] += deflection[:, 6:] @ rigid_transfer(
        chain.places[after.node], stop
    )
    return motion


def _axis_point(chain: _SegmentChain, position: float) -> FloatArray:
    point = np.array(chain.bar.center)
    point[chain.bar.axis] = position
    return point


def _dofs(node: int) -> slice:
    return slice(6 * node, 6 * node + 6)


@dataclass(frozen=True, eq=False)
class SegmentedBar:
    """A chain of segments with everything that hangs on it.

    Attributes:
        chain: Segments and rigid stretches.
        frames: Of every node: those of the chain first, then one per averaging interface.
        constraints: ``(m, 6 n)`` rows that tie nodes under one rigid interface, or make a node the
            mean of a surface.
    """

    chain: _SegmentChain
    solid: PlanarSolid | Tube
    frames: tuple[Frame, ...]
    names: tuple[str, ...]
    interface_maps: dict[str, InterfaceMap]
    constraints: FloatArray


def attach_interfaces(
    component: Component, solid: PlanarSolid | Tube, bar: PrismaticBar, properties: SolidProperties
) -> SegmentedBar:
    """Lay a bar out in segments and hang a component's interfaces on it.

    What a rigid interface covers moves rigidly, from edge to edge of its patches. An averaging one
    follows the rigid motion that fits its surface best, as on an elastic component.

    Args:
        component: With interfaces, material and number of segments.
        solid: Its shape, of which the surface is sampled.
        bar: The same as a prismatic bar: axis, section, ends.
        properties: Centroids of the interfaces' patches.

    Raises:
        ValueError: Where a face lies is not known.
    """
    fixed = {name: item for name, item in component.interfaces.items() if item.rail is None}
    spans = {
        name: [patch_span(bar, patch) for patch in item.patches] for name, item in fixed.items()
    }
    firm = {name: spans[name] for name, item in fixed.items() if _is_firm(item, spans[name])}
    rigid_spans = list(itertools.chain(*firm.values()))
    chain = _lay_out_chain(bar, component.material, component.segments.count, rigid_spans)
    nodes, names, ties = _hang_firmly(chain, firm)
    means = [name for name in fixed if name not in nodes]
    nodes |= zip(means, itertools.count(len(chain.places)), strict=False)
    origins = {name: Frame(properties.patch_centroids[name]) for name in fixed}
    rows = [_tie_rows(chain, segment=segment, node=node) for segment, node in ties]
    rows += [_mean_rows(chain, solid, fixed[name], origins[name]) for name in means]
    return SegmentedBar(
        chain,
        solid,
        (*map(Frame, chain.places), *(origins[name] for name in means)),
        (*names, *means),
        {name: InterfaceMap(nodes[name], origin) for name, origin in origins.items()},
        _join_rows(rows, len(chain.places), len(means)),
    )


def _hang_firmly(
    chain: _SegmentChain, spans: Mapping[str, Sequence[tuple[float, float]]]
) -> tuple[dict[str, int], list[str], list[tuple[int, int]]]:
    """Return the node of each firm interface, the names of the chain's nodes, and which nodes are tied
    to which.

    Args:
        spans: By interface, from edge to edge of its patches along the bar [m].
    """
    bar = chain.bar
    ends = {(bar.low, bar.low): "low_end", (bar.high, bar.high): "high_end"}
    names = [f"segment_{number}" for number in range(1, chain.count + 1)]
    names += [""] * (len(chain.places) - chain.count)
    nodes: dict[str, int] = {}
    ties = list(chain.coupled)
    for name, covered in spans.items():
        node, *others = dict.fromkeys(_node_at(chain, 0.5 * sum(span)).node for span in covered)
        nodes[name] = node
        ties += [(other, node) for other in others]
        names[node] = names[node] or ends.get(covered[0], name)
    return nodes, names, ties


def _is_firm(interface: Interface, spans: Sequence[tuple[float, float]]) -> bool:
    """Return whether the bar moves rigidly under an interface: as it says, or since its patches lie
    in one section.
    """
    (low, high), *_ = spans
    return interface.coupling == "rigid" or (low == high and set(spans) == {(low, high)})


def surface_motion(chain: _SegmentChain, points: FloatArray) -> FloatArray:
    """Return the displacement ``(3 k, 6 n)`` of points ``(k, 3)`` of the bar per unit dof of the
    chain's nodes; sections stay plane.
    """
    along = points[:, chain.bar.axis]
    motion = np.zeros((len(points), 3, 6 * len(chain.places)))
    for section in np.unique(along):
        here = np.flatnonzero(along == section)
        center = np.array(chain.bar.center)
        center[chain.bar.axis] = section
        motion[here] = (
            rigid_map(points[here], center) @ section_motion(chain, float(section))
        ).reshape(len(here), 3, -1)
    return motion.reshape(3 * len(points), -1)


def _sample_surface(
    chain: _SegmentChain, solid: PlanarSolid | Tube, patches: Sequence[Patch]
) -> PatchSamples:
    """Return the points on patches for area integrals of the bar's motion."""
    breaks = sorted(
        {end for segment_node in chain.nodes_along for end in (segment_node.low, segment_node.high)}
    )
    return sample_patches(solid, patches, chain.bar.axis, breaks)


def traction_load(
    chain: _SegmentChain, solid: PlanarSolid | Tube, patches: Sequence[Patch]
) -> FloatArray:
    """Return the nodal loads ``(6 n, 3)`` of a traction of one along x, y and z over patches [m^2,
    m^3].

    Args:
        chain: The segmented bar with ``n`` nodes.

    Returns:
        ``(6 n, 3)``, a column per direction: forces [N/Pa = m^2] and moments [N m/Pa = m^3] on the
        nodes.
    """
    samples = _sample_surface(chain, solid, patches)
    motion = surface_motion(chain, samples.points).reshape(len(samples.points), 3, -1)
    return np.einsum("k,kin->ni", samples.areas, motion)


def _tie_rows(chain: _SegmentChain, *, segment: int, node: int) -> FloatArray:
    """Return the rows ``(6, 6 n)``: one node less another carried to it."""
    rows = np.zeros((6, 6 * len(chain.places)))
    rows[:, 6 * node : 6 * node + 6] = -rigid_transfer(chain.places[node], chain.places[segment])
    rows[:, 6 * segment : 6 * segment + 6] = np.eye(6)
    return rows


def _mean_rows(
    chain: _SegmentChain, solid: PlanarSolid | Tube, interface: Interface, frame: Frame
) -> FloatArray:
    """Return the rows ``(6, 6 n)``: less the rigid motion about the frame that fits the surface of
    an interface best.

    Source: as for elastic components, Kaufmann, Buxbaum and Lichtblau (2019): weights are areas.
    """
    samples = _sample_surface(chain, solid, interface.patches)
    rigid = rigid_map(samples.points, frame.origin)
    weighted = rigid * np.repeat(samples.areas, 3)[:, None]
    # least squares over the surface: q = (R^T W R)^-1 R^T W u with u the bar's motion. Rotations
    # are scaled by the radius of gyration so that the pseudo-inverse measures rank in one unit: a
    # line cannot determine its rotation about itself
    radius = float(
        np.sqrt(
            samples.areas @ ((samples.points - frame.origin) ** 2).sum(axis=1) / samples.areas.sum()
        )
    )
    scale = np.repeat([1.0, 1.0 / radius], 3)
    gram = scale[:, None] * (rigid.T @ weighted) * scale / samples.areas.sum()
    inverse = np.linalg.pinv(gram, rcond=DEPENDENCE_TOLERANCE, hermitian=True) / samples.areas.sum()
    return -(scale[:, None] * inverse * scale) @ weighted.T @ surface_motion(chain, samples.points)


def _join_rows(rows: Sequence[FloatArray], chained: int, means: int) -> FloatArray:
    """Return all rows over all nodes; the last ones, six per averaging interface, get that
    interface's own motion.
    """
    result = np.zeros((6 * len(rows), 6 * (chained + means)))
    if rows:
        result[:, : 6 * chained] = np.vstack(rows)
    if means:
        result[-6 * means :, 6 * chained :] = np.eye(6 * means)
    return result
