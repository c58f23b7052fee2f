"""A whole machine as one unreduced finite element model: an independent method for what coupled
superelements give.

Nothing of the reduction or the coupling is used: elastic components keep every node, rigid joints
become Lagrange multipliers, and frequencies come from SLEPc's search on the whole matrices.

A machine on rails with its carriages fixed where they stand in a pose: what an unreduced model can
take.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse
from scipy.sparse import csr_matrix

from headstock.geometry.frames import FloatArray, Frame, rigid_transfer, rotate_dofs
from headstock.geometry.machine.carriages import Carriage, place_carriages
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.geometry.parts.components import Component, Interface, Patch
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import describe_component
from headstock.reduction.components.elastic import scaled_material
from headstock.reduction.components.interface_patches import MeshPatch, measure_patch
from headstock.reduction.components.rail_fits import fit_rail
from headstock.reduction.rails import Rail, carriage_rows
from headstock.solvers.elastic.elasticity import assemble_elasticity
from headstock.solvers.mpi import MPI
from headstock.validation.parts.sparse_eigenpairs import lowest_symmetric_pairs, solve_symmetric


@dataclass(frozen=True, eq=False)
class BodyModel:
    """One component: its own matrices and, by interface, the rows that give its motion.

    Attributes:
        stiffness: ``(n, n)`` in the component's axes.
        mass: ``(n, n)``.
        motions: Interface name to ``(6, n)`` motion of its frame, component axes.
        origins: Interface name to ``(3,)`` origin of its frame in the component frame [m].
    """

    stiffness: csr_matrix
    mass: csr_matrix
    motions: dict[str, csr_matrix]
    origins: dict[str, FloatArray]


@dataclass(frozen=True, eq=False)
class _InterfaceView:
    """What an interface sees of a mesh: its motion ``(6, 3 n_points)`` and its origin ``(3,)``,
    component frame.
    """

    rows: csr_matrix
    origin: FloatArray


@dataclass(frozen=True, eq=False)
class MonolithicMachine:
    """Stiffness, mass and constraint rows of the whole machine, and the relative motion at each
    point ``(6, n)``.
    """

    stiffness: csr_matrix
    mass: csr_matrix
    constraints: csr_matrix
    points: dict[str, csr_matrix]


def monolithic_machine(
    machine: Machine,
    meshes: Mapping[str, ComponentMesh],
    pose: Pose,
    *,
    views: Mapping[str, _InterfaceView] | None = None,
) -> MonolithicMachine:
    """Assemble a machine whose elastic components have the given meshes; supports are not treated.

    Args:
        machine: Its joints between fixed interfaces.
        views: By ``component.interface`` on an elastic component, in place of what its patch and
            coupling say.

    Raises:
        ValueError: The machine has supports.
    """
    if machine.supports:
        raise ValueError("the monolithic model takes machines without supports")
    placements = place_components(machine, pose)
    bodies = {
        name: _elastic_body(component, meshes[name], views or {})
        if component.fidelity == "elastic"
        else _rigid_body(component)
        for name, component in machine.components.items()
    }
    starts = np.cumsum(np.array([0, *(body.mass.shape[0] for body in bodies.values())]))
    columns = {name: int(start) for name, start in zip(bodies, starts, strict=False)}
    model = _Ports(machine, bodies, placements, columns, int(starts[-1]))
    stiffness = scipy.sparse.block_diag([body.stiffness for body in bodies.values()], format="csr")
    rows = []
    for joint in machine.joints.values():
        relative = model.joint_rows(joint)
        stiffness = stiffness + relative.T @ scipy.sparse.csr_matrix(joint.stiffness) @ relative
        if joint.fixed:
            rows.append(relative[list(joint.fixed)])
    constraints = (
        scipy.sparse.vstack(rows, format="csr") if rows else csr_matrix((0, int(starts[-1])))
    )
    points = {
        name: model.relative_motion(point.tool, point.work)
        for name, point in machine.points.items()
    }
    mass = scipy.sparse.block_diag([body.mass for body in bodies.values()], format="csr")
    return MonolithicMachine(stiffness, mass, constraints, points)


def monolithic_compliance(model: MonolithicMachine, point: str) -> FloatArray:
    """Compliance ``(6, 6)`` at a point [m/N, rad/N, m/(N m), rad/(N m)]."""
    rows = model.points[point]
    matrix, size = _bordered(model), model.stiffness.shape[0]
    right = np.zeros((matrix.shape[0], 6))
    right[:size] = rows.T.toarray()
    return rows @ solve_symmetric(matrix, right)[:size]


def monolithic_frequencies(model: MonolithicMachine, count: int, *, shift_hz: float) -> FloatArray:
    """Return the lowest natural frequencies [Hz] ``(count,)``, found around a shift below them that
    hits none.

    Args:
        model: The whole machine, without supports.
        shift_hz: Magnitude of the shift ``-(2 pi f)^2`` [Hz]: below zero, so that it hits no
            eigenvalue, rigid-body modes included.
    """
    border = model.constraints.shape[0]
    mass = scipy.sparse.block_diag([model.mass, csr_matrix((border, border))], format="csr")
    shift = -((2.0 * np.pi * shift_hz) ** 2)
    eigenvalues, _ = lowest_symmetric_pairs(
        _bordered(model), mass, count, shift=shift, constraints=border
    )
    return np.sqrt(np.abs(eigenvalues)) / (2.0 * np.pi)


def _bordered(model: MonolithicMachine) -> csr_matrix:
    scale = float(np.abs(model.stiffness.diagonal()).max()) ** 0.5
    rows = scale * model.constraints
    return scipy.sparse.bmat([[model.stiffness, rows.T], [rows, None]], format="csr")


class _Ports:
    """Motions of interfaces and points in terms of all dofs of the machine."""

    def __init__(
        self,
        machine: Machine,
        bodies: dict[str, BodyModel],
        placements: dict[str, Frame],
        columns: dict[str, int],
        size: int,
    ) -> None:
        self._machine = machine
        self._bodies = bodies
        self._placements = placements
        self._columns = columns
        self._size = size

    def relative_motion(self, tool: JointEnd, work: JointEnd) -> csr_matrix:
        place = self._origin(tool)
        return self._motion_at(tool, place) - self._motion_at(work, place)

    def joint_rows(self, joint: Joint) -> csr_matrix:
        host = next(end for end in joint.ends if end.component is not None)
        assert host.component is not None
        place = self._origin(host)
        if joint.point is not None:
            resting = self._machine.components[host.component].placement
            moved = self._placements[host.component]
            place = moved.origin + moved.rotation @ (
                resting.rotation.T @ (joint.point - resting.origin)
            )
        carried = (
            self._placements[host.component].rotation
            @ self._machine.components[host.component].placement.rotation.T
        )
        turn = csr_matrix(rotate_dofs((carried @ joint.rotation).T))
        return turn @ (
            self._motion_at(joint.ends[1], place) - self._motion_at(joint.ends[0], place)
        )

    def _origin(self, end: JointEnd) -> FloatArray:
        if end.component is None or end.interface is None:
            raise ValueError("a tool end or joint point cannot be ground alone")
        frame = self._placements[end.component]
        return frame.origin + frame.rotation @ self._bodies[end.component].origins[end.interface]

    def _motion_at(self, end: JointEnd, place: FloatArray) -> csr_matrix:
        if end.component is None or end.interface is None:
            return csr_matrix((6, self._size))
        body, start = self._bodies[end.component], self._columns[end.component]
        turn = rotate_dofs(self._placements[end.component].rotation)
        own = (
            csr_matrix(rigid_transfer(self._origin(end), place) @ turn)
            @ body.motions[end.interface]
        )
        after = self._size - start - own.shape[1]
        return scipy.sparse.hstack(
            [csr_matrix((6, start)), own, csr_matrix((6, after))], format="csr"
        )


def _rigid_body(component: Component) -> BodyModel:
    properties = describe_component(component)
    density = (
        component.material.density if component.mass is None else component.mass / properties.volume
    )
    mass = np.zeros((6, 6))
    mass[:3, :3] = density * properties.volume * np.eye(3)
    mass[3:, 3:] = density * properties.inertia
    origins = {name: np.asarray(properties.patch_centroids[name]) for name in component.interfaces}
    motions = {
        name: csr_matrix(rigid_transfer(properties.center, origin))
        for name, origin in origins.items()
    }
    return BodyModel(csr_matrix((6, 6)), csr_matrix(mass), motions, origins)


def _elastic_body(
    component: Component, mesh: ComponentMesh, views: Mapping[str, _InterfaceView]
) -> BodyModel:
    operators = assemble_elasticity(
        mesh, scaled_material(component, mesh), comm=MPI.COMM_SELF, with_mass=True
    )
    order = (3 * operators.nodes[:, None] + np.arange(3)).ravel()
    to_mesh = csr_matrix((np.ones(len(order)), (order, np.arange(len(order)))))
    stiffness = to_mesh @ csr_matrix(operators.stiffness) @ to_mesh.T
    mass = to_mesh @ csr_matrix(scipy.sparse.kron(operators.scalar_mass, np.eye(3))) @ to_mesh.T
    seen = {
        name: views[f"{component.name}.{name}"]
        for name in component.interfaces
        if f"{component.name}.{name}" in views
    }
    patches = {name: measure_patch(mesh, name) for name in component.interfaces if name not in seen}
    rigid = [
        name
        for name, interface in component.interfaces.items()
        if interface.coupling == "rigid" and name not in seen
    ]
    basis, starts = _rigid_patch_basis(mesh, [patches[name] for name in rigid])
    motions = {}
    for name, patch in patches.items():
        if name in rigid:
            start = starts[rigid.index(name)]
            motions[name] = csr_matrix(
                (np.ones(6), (np.arange(6), start + np.arange(6))), shape=(6, basis.shape[1])
            )
        else:
            dofs = (3 * patch.nodes[:, None] + np.arange(3)).ravel()
            motions[name] = csr_matrix(patch.average_operator().T) @ basis[dofs]
    origins = {name: patch.centroid for name, patch in patches.items()}
    motions |= {name: csr_matrix(view.rows) @ basis for name, view in seen.items()}
    origins |= {name: view.origin for name, view in seen.items()}
    return BodyModel(
        csr_matrix(basis.T @ stiffness @ basis),
        csr_matrix(basis.T @ mass @ basis),
        motions,
        origins,
    )


def _rigid_patch_basis(
    mesh: ComponentMesh, patches: list[MeshPatch]
) -> tuple[csr_matrix, list[int]]:
    """Displacements of all points ``(3 n, m)`` by the free ones and 6 dofs per rigid patch."""
    total = 3 * len(mesh.points)
    free = np.ones(total, dtype=bool)
    for patch in patches:
        free[(3 * patch.nodes[:, None] + np.arange(3)).ravel()] = False
    kept = np.flatnonzero(free)
    parts = [
        csr_matrix((np.ones(len(kept)), (kept, np.arange(len(kept)))), shape=(total, len(kept)))
    ]
    starts: list[int] = []
    for patch in patches:
        starts.append(len(kept) + 6 * len(starts))
        dofs = (3 * patch.nodes[:, None] + np.arange(3)).ravel()
        block = csr_matrix((total, 6)).tolil()
        block[dofs] = patch.rigid_displacements()
        parts.append(block.tocsr())
    return scipy.sparse.hstack(parts, format="csr"), starts


def fix_carriages(machine: Machine, pose: Pose) -> Machine:
    """Put every carriage on an evenly averaging patch of its own under it, and every screw with
    the stiffness it has in the pose.
    """
    carriages = {carriage.joint: carriage for carriage in place_carriages(machine, pose)}
    components = dict(machine.components)
    for name, component in machine.components.items():
        fixed = {
            key: interface
            for key, interface in component.interfaces.items()
            if interface.rail is None
        }
        own = {
            c.joint: _patch_under(machine, c)
            for c in carriages.values()
            if c.rail.component == name
        }
        components[name] = dataclasses.replace(component, interfaces=fixed | own)
    joints = {
        name: _fix_joint(machine, joint, carriages.get(name), pose)
        for name, joint in machine.joints.items()
    }
    return dataclasses.replace(machine, components=components, joints=joints)


def view_carriages(
    machine: Machine, meshes: Mapping[str, ComponentMesh], pose: Pose
) -> dict[str, _InterfaceView]:
    """Motion that every carriage takes from a mesh on which only the rails are patches, weighted as
    in the reduced model.

    Returns:
        By ``component.joint``, rows ``(6, 3 n_points)`` and the carriage's place on the rail.
    """
    views = {}
    for carriage in place_carriages(machine, pose):
        component = machine.components[str(carriage.rail.component)]
        mesh = meshes[component.name]
        name = str(carriage.rail.interface)
        fit = fit_rail(component.name, component.interfaces[name], measure_patch(mesh, name))
        blur = float(np.diff(fit.knots).max())
        low, high = carriage.span
        rail = Rail(fit.axis, fit.center, low, high, fit.knots, np.eye(4 * len(fit.points)), blur)
        rows = np.zeros((6, 3 * len(mesh.points)))
        rows[:, (3 * fit.patch.nodes[:, None] + np.arange(3)).ravel()] = (
            carriage_rows(rail, carriage.place, carriage.length) @ fit.operator.T
        )
        origin = np.array(fit.center)
        origin[fit.axis] = carriage.place
        views[f"{component.name}.{carriage.joint}"] = _InterfaceView(csr_matrix(rows), origin)
    return views


def _patch_under(machine: Machine, carriage: Carriage) -> Interface:
    """Return the rail's strip cut to the carriage's length: a rect on the same face."""
    interface = machine.components[str(carriage.rail.component)].interfaces[
        str(carriage.rail.interface)
    ]
    (patch,) = interface.patches
    if interface.rail is None or patch.shape != "strip":
        raise ValueError("rails of this method are strips")
    axis = "xyz".index(interface.rail.along)
    center = list(patch.center)
    center[axis] = carriage.place
    in_plane = [i for i in range(3) if i != "xyz".index(patch.face[0])]
    size = tuple(carriage.length if i == axis else patch.size[0] for i in in_plane)
    return Interface(
        carriage.joint,
        (Patch(patch.face, "rect", (center[0], center[1], center[2]), size),),
        "average",
    )


def _fix_joint(machine: Machine, joint: Joint, carriage: Carriage | None, pose: Pose) -> Joint:
    if carriage is not None:
        ends = tuple(
            JointEnd(end.component, joint.name) if end == carriage.rail else end
            for end in joint.ends
        )
        return dataclasses.replace(joint, ends=(ends[0], ends[1]), length=None)
    if joint.screw is None:
        return joint
    first, second = (_place_interface(machine, end, pose) for end in joint.ends)
    distance = abs(float((first - second) @ joint.rotation[:, 0]))
    stiffness = np.array(joint.stiffness)
    stiffness[0, 0] = 1.0 / (
        1.0 / stiffness[0, 0] + 1.0 / joint.screw.bearing + distance / joint.screw.axial
    )
    return dataclasses.replace(joint, stiffness=stiffness, screw=None)


def _place_interface(machine: Machine, end: JointEnd, pose: Pose) -> FloatArray:
    """Middle ``(3,)`` of an interface in the machine frame in a pose [m]."""
    component = machine.components[str(end.component)]
    frame = place_components(machine, pose)[component.name]
    return (
        frame.origin
        + frame.rotation @ describe_component(component).patch_centroids[str(end.interface)]
    )
