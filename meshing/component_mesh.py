"""The mesh of one component: plain arrays, in the component's own frame."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray

IntArray = NDArray[np.int64]
CellKind = Literal["tet4", "tet10", "hex8", "hex20", "hex27"]


POOR_QUALITY = 0.05


@dataclass(frozen=True, eq=False)
class MeshQuality:
    """Quality of a mesh.

    Attributes:
        minimum_scaled_jacobian: Smallest scaled Jacobian over all elements (1 ideal, <= 0
            inverted).
        poor_share: Share of the volume in elements with a scaled Jacobian below ``POOR_QUALITY``.
        worst_place: ``(3,)`` middle of the element that is worst [m].
        worst_face: ``face:N`` that it lies at; empty where it lies at none, or faces have no
            numbers.
        flatness: ``L^6 / t^4`` of second-order tets of length L that alone fill a wall of thickness
            t, mean over the volume, slivers left out [m^2].
        flat_size: Median length of those [m], 0 where there are none.
        flat_thickness: Median thickness of their walls [m].
        remarks: What was done to mesh small features.
        repaired: Number of curved elements that were inverted as meshed and have been straightened
            or optimised.
        volume: Volume integrated over the elements [m^3].
        cad_volume: Volume of the CAD solid [m^3], NaN where there is none.
        cad_areas: CAD area of each patch group [m^2], NaN where there is none.
    """

    minimum_scaled_jacobian: float
    repaired: int
    volume: float
    cad_volume: float
    cad_areas: dict[str, float] = field(default_factory=dict)
    poor_share: float = 0.0
    worst_place: FloatArray = field(default_factory=lambda: np.zeros(3))
    worst_face: str = ""
    flatness: float = 0.0
    flat_size: float = 0.0
    flat_thickness: float = 0.0
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class CurvedFacets:
    """Facets on curved faces, and where those faces lie.

    Attributes:
        nodes: ``(n, nodes per facet)`` gmsh order, in any orientation.
        nearest: ``(n, q, 3)`` points of the CAD face that are nearest to the quadrature places of
            each facet.
        shares: ``(n,)`` how many facets each stands for.
    """

    nodes: IntArray
    nearest: FloatArray
    shares: FloatArray


@dataclass(frozen=True, eq=False)
class SurfaceGaps:
    """Volumes between the facets of a mesh and the curved faces of its part.

    Attributes:
        facets: ``(n, nodes per facet)`` facets on curved faces.
        volumes: ``(n, q)`` volume between each facet and its face, shared out among the facet's
            quadrature places (``elements.quality.PLACES`` along each side) [m^3]; positive where
            the mesh cuts the part short.
    """

    facets: IntArray
    volumes: FloatArray


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Small features of a part that its mesh lacks.

    Attributes:
        places: ``(n, 3, 3)`` three points along the depth of each: one end, the middle, the other
            end [m].
        volumes: ``(n,)`` what the part has there and the mesh has not [m^3]; negative for holes.
        strengths: ``(n,)`` how many times the energy of that volume each changes.
    """

    places: FloatArray
    volumes: FloatArray
    strengths: FloatArray

    def scaled(self, unit: float) -> "LeftOut":
        """Return the mesh in another unit: lengths times ``unit``."""
        return LeftOut(self.places * unit, self.volumes * unit**3, self.strengths)


@dataclass(frozen=True, eq=False)
class MissingVolumes:
    """Small features of its part that a mesh lacks.

    Attributes:
        cells: ``(n,)`` in which they lie.
        shapes: ``(n, nodes per cell)`` shape functions there.
        volumes: ``(n,)`` what the part has more than the mesh [m^3]; negative for holes.
        strengths: ``(n,)`` how many times the energy of that volume is at stake.
    """

    cells: IntArray
    shapes: FloatArray
    volumes: FloatArray
    strengths: FloatArray

    def within(self, cells: IntArray) -> "MissingVolumes":
        """Return those in some cells alone.

        Args:
            cells: Sorted; they become 0, 1, ...
        """
        mine = np.isin(self.cells, cells)
        return MissingVolumes(
            np.searchsorted(cells, self.cells[mine]),
            self.shapes[mine],
            self.volumes[mine],
            self.strengths[mine],
        )


@dataclass(frozen=True, eq=False)
class ComponentMesh:
    """Nodes, cells of one kind, and named groups of surface facets.

    Node order inside cells and facets is gmsh's (VTK order differs for hex20/hex27 and the last two
    edges of tet10).

    Attributes:
        points: ``(n_points, 3)`` [m]; every point belongs to a cell.
        cells: ``(n_cells, nodes per cell)`` indices into ``points``.
        kind: Cell kind; its order is the order of the displacement field.
        straight: All edges straight and mid-nodes centred: the geometry map is affine (tets) or
            trilinear (hexes).
        patches: ``(n_facets, nodes per facet)`` facets (gmsh tri3/tri6/quad4/quad8/quad9) of each
            patch group: one group per interface name, ``support:NAME`` per support and
            ``load:NAME`` per load.
        quality: Checks made when the mesh was made.
        gaps: What it cuts short of curved faces; None without a CAD shape, as of mesh files.
        missing: Small features that it lacks; None for none.
    """

    points: FloatArray
    cells: IntArray
    kind: CellKind
    straight: bool
    patches: dict[str, IntArray]
    quality: MeshQuality
    gaps: SurfaceGaps | None = None
    missing: MissingVolumes | None = None
