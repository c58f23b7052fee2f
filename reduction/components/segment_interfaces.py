"""How the interfaces of a segmented bar are coupled to its nodes, and how loads on its surface act
on them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame, rigid_map, rigid_transfer
from headstock.geometry.parts.components import Component, Interface, Patch
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.geometry.parts.patch_samples import PatchSamples, sample_patches
from headstock.geometry.parts.patches import PlanarSolid
from headstock.geometry.parts.prismatic_bars import PrismaticBar, patch_span
from headstock.geometry.parts.solids import Tube
from headstock.reduction.components.segment_chain import (
    SegmentChain,
    lay_out_chain,
    node_at,
    section_motion,
)
from headstock.reduction.superelement import InterfaceMap

DEPENDENCE_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class SegmentedBar:
    """A chain of segments with everything that hangs on it.

    Attributes:
        chain: Segments and rigid stretches.
        frames: Of every node: those of the chain first, then one per averaging interface.
        constraints: ``(m, 6 n)`` rows that tie nodes under one rigid interface, or make a node the
            mean of a surface.
    """

    chain: SegmentChain
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
    firm = {
        name
        for name, item in fixed.items()
        if item.coupling == "rigid"
        or all(low == high and (low, high) == spans[name][0] for low, high in spans[name])
    }
    rigid_spans = [span for name in spans if name in firm for span in spans[name]]
    chain = lay_out_chain(bar, component.material, component.segments.count, rigid_spans)
    frames = [Frame(position) for position in chain.places]
    names = [f"segment_{number}" for number in range(1, chain.count + 1)] + [""] * (
        len(frames) - chain.count
    )
    interface_maps: dict[str, InterfaceMap] = {}
    ties = list(chain.coupled)
    means: list[Interface] = []
    for name, interface in fixed.items():
        frame = Frame(properties.patch_centroids[name])
        node = len(chain.places) + len(means)
        if name in firm:
            nodes = list(
                dict.fromkeys(node_at(chain, 0.5 * sum(span)).node for span in spans[name])
            )
            node = nodes[0]
            ties += [(other, node) for other in nodes[1:]]
            ends = {(bar.low, bar.low): "low_end", (bar.high, bar.high): "high_end"}
            names[node] = names[node] or ends.get(spans[name][0], name)
        else:
            means.append(interface)
            frames.append(frame)
            names.append(name)
        interface_maps[name] = InterfaceMap(node, frame)
    rows = [_tie_rows(chain, segment=segment, node=node) for segment, node in ties] + [
        _mean_rows(chain, solid, item, interface_maps[item.name].frame) for item in means
    ]
    return SegmentedBar(
        chain,
        solid,
        tuple(frames),
        tuple(names),
        interface_maps,
        _join_rows(rows, len(chain.places), len(means)),
    )


def surface_motion(chain: SegmentChain, points: FloatArray) -> FloatArray:
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
    chain: SegmentChain, solid: PlanarSolid | Tube, patches: Sequence[Patch]
) -> PatchSamples:
    """Return the points on patches for area integrals of the bar's motion."""
    breaks = sorted(
        {end for segment_node in chain.nodes_along for end in (segment_node.low, segment_node.high)}
    )
    return sample_patches(solid, patches, chain.bar.axis, breaks)


def traction_load(
    chain: SegmentChain, solid: PlanarSolid | Tube, patches: Sequence[Patch]
) -> FloatArray:
    """Return the nodal loads ``(6 n, 3)`` of a traction of one along x, y and z over patches [m^2,
    m^3].

    Args:
        chain: The segmented bar with ``n`` nodes.
        patches: Where the traction acts.

    Returns:
        ``(6 n, 3)``, a column per direction: forces [N/Pa = m^2] and moments [N m/Pa = m^3] on the
        nodes.
    """
    samples = _sample_surface(chain, solid, patches)
    motion = surface_motion(chain, samples.points).reshape(len(samples.points), 3, -1)
    return np.asarray(np.einsum("k,kin->ni", samples.areas, motion))


def _tie_rows(chain: SegmentChain, *, segment: int, node: int) -> FloatArray:
    """Return the rows ``(6, 6 n)``: one node less another carried to it."""
    rows = np.zeros((6, 6 * len(chain.places)))
    rows[:, 6 * node : 6 * node + 6] = -rigid_transfer(chain.places[node], chain.places[segment])
    rows[:, 6 * segment : 6 * segment + 6] = np.eye(6)
    return rows


def _mean_rows(
    chain: SegmentChain, solid: PlanarSolid | Tube, interface: Interface, frame: Frame
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
    return np.asarray(
        -(scale[:, None] * inverse * scale) @ weighted.T @ surface_motion(chain, samples.points)
    )


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
