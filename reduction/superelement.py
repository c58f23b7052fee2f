"""The superelement that every fidelity of a component is turned into: matrices, recovery basis and
error estimates.
"""

from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.meshing.process.plain_hdf5 import STORED_AS
from headstock.reduction.patch_shapes import PatchShapes
from headstock.reduction.rails import CONTROL_POINT_DOFS, ControlPoint, Rail


@dataclass(frozen=True, eq=False)
class Truncation:
    """Two moments of the modes left out, from which their dynamic stiffness is bounded at every
    frequency below them.

    With the participation ``p_k = psi^T M phi_k`` ``(n_b,)`` and ``omega_k`` of each mode left out,
    eliminating its modal dof adds ``-lambda^2 p_k p_k^T / (omega_k^2 - lambda)`` to the dynamic
    stiffness of the boundary dofs at ``lambda = omega^2``.

    Attributes:
        first: ``(n_b, n_b)`` sum of ``p_k p_k^T / omega_k^2``.
        second: ``(n_b, n_b)`` sum of ``p_k p_k^T / omega_k^4``.
        limit: Lowest ``omega_k^2`` among them [rad^2/s^2]; inf when none is left out.
    """

    first: FloatArray
    second: FloatArray
    limit: float


def most_participation(truncation: Truncation, square: float) -> FloatArray:
    """Return what the sum of ``p_k p_k^T / (omega_k^2 - lambda)`` is at most ``(n_b, n_b)``: all of
    the series' rest at the lowest mode.

    Raises:
        ValueError: The frequency is not below the lowest mode left out: there is no bound.
    """
    if not square < truncation.limit:
        raise ValueError(
            f"omega^2 = {square:g} lies beyond the lowest mode left out, {truncation.limit:g}"
        )
    return truncation.first + (square / (1.0 - square / truncation.limit)) * truncation.second


def lowest_participating(first: FloatArray, second: FloatArray) -> float:
    """Return the lowest ``omega^2`` that the moments themselves show, where no mode was searched
    for; inf without any.

    A Rayleigh quotient over ``K^-1 M psi``: as a rule a few percent above the lowest mode that
    moves the boundary.
    """
    scale = np.sqrt(np.maximum(first.diagonal(), 0.0))
    scale = np.where(scale > 0.0, 1.0 / np.where(scale > 0.0, scale, 1.0), 0.0)
    values, vectors = np.linalg.eigh(first * scale * scale[:, None])
    kept = values > len(values) * np.finfo(float).eps * values.max(initial=0.0)
    if not kept.any():
        return np.inf
    white = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    return 1.0 / float(np.linalg.eigvalsh(white.T @ second @ white)[-1])


@dataclass(frozen=True, eq=False)
class InterfaceMap:
    """Node and frame of a fixed interface of a superelement.

    Attributes:
        node: Index of the 6-dof boundary node that carries the interface rigidly.
        shapes: Deformation shapes that it has besides; interfaces of the same points share them.
    """

    node: int
    frame: Frame
    shapes: PatchShapes | None = None


@dataclass(frozen=True, eq=False)
class StaticLoad:
    """A load on a superelement.

    Attributes:
        vector: ``(n,)`` reduced load [N, N m; modal].
        particular: ``(3 n_points,)`` displacement under the load with boundary and modal dofs fixed
            [m]: what the reduced dofs cannot show; None when nothing is to be recovered.
        missing: ``(n,)`` energy products of its discretisation error with those of the dofs [J per
            unit]; None where nobody knows.
    """

    vector: FloatArray
    particular: FloatArray | None = None
    missing: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class ProbeLoad:
    """Response to a static load at a probe with boundary and modal dofs fixed: what the reduced
    dofs cannot show.

    Attributes:
        values: ``(9,)`` displacement and stress.
        smoothing: ``(s, 6)`` what recovery changes in that stress and around; None where nobody
            knows.
        missing: ``(9,)`` energy products of the discretisation errors; None where nobody knows.
    """

    values: FloatArray
    smoothing: FloatArray | None = None
    missing: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class ProbeRows:
    """Outputs of a probe in a superelement: displacement x y z [m] and stress xx yy zz xy xz yz
    [Pa], component axes.

    Attributes:
        values: ``(9, n)`` per dof.
        inertia: ``(9, n_b)`` that the modes left out add at rest per acceleration of the boundary
            dofs, times -1; zero without mass.
        smoothing: ``(s, 6, n)`` what recovery changes in the stresses at the probe and at the nodes
            of its cells; the root of the sum of squares over the first axis is the size of a
            change. None where nobody knows.
        missing: ``(9, n)`` energy products of the discretisation errors of the dofs with those of
            the response to the load that does the work of what is seen, with boundary and modal dofs
            fixed; None where nobody knows.
        strain_reach: Size of its cells over Young's modulus: what an error of the stress moves
            across them [m/Pa].
        singular: What makes the stress there grow with every finer mesh; empty for nothing.
    """

    values: FloatArray
    inertia: FloatArray
    smoothing: FloatArray | None = None
    missing: FloatArray | None = None
    strain_reach: float = 0.0
    loads: dict[str, ProbeLoad] = field(default_factory=dict)
    singular: str = ""


@dataclass(frozen=True, eq=False)
class SensorRows:
    """Motion of a superelement at the place of a sensor.

    Attributes:
        motion: ``(3, n)`` displacement x y z per dof, component axes.
        mass: What the superelement's matrices carry there [kg].
    """

    motion: FloatArray
    mass: float = 0.0


@dataclass(frozen=True, eq=False)
class Recovery:
    """Motion of every mesh point with the dofs.

    Attributes:
        basis: ``(3 n_points, n)`` displacement of every mesh point per unit dof.
        points: ``(n_points, 3)`` in the component frame [m].
    """

    basis: FloatArray
    points: FloatArray


@dataclass(frozen=True, eq=False)
class ErrorEstimates:
    """Estimated errors of a superelement's matrices; None where nobody knows.

    Attributes:
        truncation: What the fixed-interface modes left out would add; None without mass, for
            components that are no reduced finite element model, and for imported ones that do not
            say.
        missing_energy: ``(n, n)`` estimated energy products of the discretisation errors of the
            dofs: what the strain energy of the component is too large by is half of ``q^T E q``.
            None for components without a mesh, and for imported ones that do not say.
        mesh_safety: What ``missing_energy`` is to be multiplied by, so that it covers the true
            errors in 95 of 100 cases.
        mesh_truth: Share of ``missing_energy`` that true errors lie around, and how far of it on
            either side in 95 of 100 cases.
        shape_stiffness: ``(n, n)`` change of the stiffness by the part's curved faces, which the
            mesh cuts short or overshoots.
        left_out_stiffness: ``(n, n)`` change of the stiffness by small features of the part that the
            mesh lacks; None where it lacks none.
        corrected: The stiffness has been corrected by ``missing_energy``: errors of the mesh are of
            either sign.
    """

    truncation: Truncation | None = None
    missing_energy: FloatArray | None = None
    mesh_safety: float = 2.0
    shape_stiffness: FloatArray | None = None
    shape_mass: FloatArray | None = None
    left_out_stiffness: FloatArray | None = None
    left_out_mass: FloatArray | None = None
    mesh_truth: tuple[float, float] = (1.0, 1.0)
    corrected: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Superelement:
    """A component reduced to boundary and modal dofs, in its own frame, SI.

    Dofs are ordered [6 per boundary node in the order x y z rx ry rz | 4 per control point of its
    rails | deformation shapes of its flexible interfaces | modal dofs].

    Attributes:
        labels: ``(node, control point or "mode", dof name or mode number)`` for each dof, in their order.
        frames: Frame of each boundary node in the component frame (origin where its 6 dofs live,
            axes parallel to the component).
        interface_maps: Interface name to boundary node and interface frame. Elastic components have
            one node per distinct interface; rigid ones a single node at the centre of mass that
            carries every interface. Rails are not among them.
        stiffness: ``(n, n)`` symmetric.
        mass: ``(n, n)`` symmetric.
        damping: ``(n, n)`` viscous or None.
        recovery: Motion of the mesh points; None where it was not asked for, and on every rank but
            0.
        constraints: ``(m, n)`` rows that must vanish, where interfaces share nodes; usually ``(0,
            n)``.
        modal_frequencies_hz: ``(n_modes,)`` fixed-interface frequencies of the modal dofs.
        cutoff_hz: Fixed-interface modes are complete up to here; inf for rigid bodies, 0 with none
            kept.
        full_dofs: Degrees of freedom of the model it was reduced from.
        mass_kg: Mass [kg].
        center_of_mass: ``(3,)`` [m].
        inertia: ``(3, 3)`` about the centre of mass, component axes [kg m^2].
        residual: Largest relative residual of the solves behind it.
        warnings: What the reduction has to say to the user.
        free_dofs: Boundary dofs that no mass and no stiffness reaches (named to the user), e.g. a
            rotation of a line patch.
        supported: Some of its points are fixed to the machine frame, so it has no rigid-body
            motions.
        control_points: Control points of elastic rails, which have dofs of their own.
        rails: Interfaces that carriages slide along, by name.
        errors: What the modes left out and the mesh make of its matrices.
        probes: What is seen at places inside it, by name.
        sensors: Motion at the places of sensors and point masses, by name.
    """

    name: str
    labels: tuple[tuple[str, str], ...]
    frames: tuple[Frame, ...]
    interface_maps: dict[str, InterfaceMap] = field(metadata={STORED_AS: "attachments"})
    stiffness: FloatArray
    mass: FloatArray
    constraints: FloatArray
    modal_frequencies_hz: FloatArray
    cutoff_hz: float
    full_dofs: int
    mass_kg: float
    center_of_mass: FloatArray
    inertia: FloatArray
    damping: FloatArray | None = None
    recovery: Recovery | None = None
    residual: float = 0.0
    loads: dict[str, StaticLoad] = field(default_factory=dict)
    free_dofs: tuple[str, ...] = ()
    supported: bool = False
    warnings: tuple[str, ...] = ()
    control_points: tuple[ControlPoint, ...] = field(default=(), metadata={STORED_AS: "stations"})
    rails: dict[str, Rail] = field(default_factory=dict)
    errors: ErrorEstimates = field(default_factory=ErrorEstimates)
    probes: dict[str, ProbeRows] = field(default_factory=dict)
    sensors: dict[str, SensorRows] = field(default_factory=dict)

    def interface_position(self, interface: str) -> FloatArray:
        """Return ``(3,)`` where an interface is, of a rail its middle, in the component frame
        [m].
        """
        rail = self.rails.get(interface)
        return self.interface_maps[interface].frame.origin if rail is None else rail.center

    @property
    def node_size(self) -> int:
        """Number of dofs of the boundary nodes, 6 each."""
        return 6 * len(self.frames)

    @property
    def boundary_size(self) -> int:
        """Number of boundary dofs: of boundary nodes, control points and deformation shapes."""
        return self.node_size + CONTROL_POINT_DOFS * len(self.control_points) + self.shape_size

    @property
    def shape_size(self) -> int:
        """Number of dofs of deformation shapes of flexible interfaces."""
        shapes = [entry.shapes for entry in self.interface_maps.values() if entry.shapes]
        return sum({one.first: one.count for one in shapes}.values())

    @property
    def modal_count(self) -> int:
        """Number of modal dofs."""
        return int(np.shape(self.stiffness)[0]) - self.boundary_size
