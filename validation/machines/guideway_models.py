"""A machine on rails with its carriages fixed where they stand in a pose: what an unreduced model can take."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import scipy.sparse.linalg
from scipy.sparse import csr_matrix

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.carriages import Carriage, place_carriages
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.geometry.parts.components import Interface, Patch
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import describe_component
from headstock.reduction.components.interface_patches import measure_patch
from headstock.reduction.components.rail_fits import fit_rail
from headstock.reduction.rails import Rail, carriage_rows
from headstock.validation.machines.monolithic_machines import InterfaceView, MonolithicMachine


def fix_carriages(machine: Machine, pose: Pose) -> Machine:
    """Every carriage on an evenly averaging patch of its own under it, and every screw with the stiffness it has in the pose."""
    carriages = {carriage.joint: carriage for carriage in place_carriages(machine, pose)}
    components = dict(machine.components)
    for name, component in machine.components.items():
        fixed = {key: interface for key, interface in component.interfaces.items() if interface.rail is None}
        own = {c.joint: _patch_under(machine, c) for c in carriages.values() if c.rail.component == name}
        components[name] = dataclasses.replace(component, interfaces=fixed | own)
    joints = {name: _fix_joint(machine, joint, carriages.get(name), pose) for name, joint in machine.joints.items()}
    return dataclasses.replace(machine, components=components, joints=joints)


def view_carriages(machine: Machine, meshes: Mapping[str, ComponentMesh], pose: Pose) -> dict[str, InterfaceView]:
    """What every carriage sees of a mesh that knows the rails only, weighed as the reduced model weighs it."""
    views = {}
    for carriage in place_carriages(machine, pose):
        component = machine.components[str(carriage.rail.component)]
        mesh = meshes[component.name]
        name = str(carriage.rail.interface)
        fit = fit_rail(component.name, component.interfaces[name], measure_patch(mesh, name))
        blur = float(np.diff(fit.knots).max())
        rail = Rail(fit.axis, fit.center, *carriage.span, fit.knots, np.eye(4 * len(fit.points)), blur)
        rows = np.zeros((6, 3 * len(mesh.points)))
        rows[:, (3 * fit.patch.nodes[:, None] + np.arange(3)).ravel()] = (
            carriage_rows(rail, carriage.place, carriage.length) @ fit.operator.T
        )
        origin = np.array(fit.center)
        origin[fit.axis] = carriage.place
        views[f"{component.name}.{carriage.joint}"] = InterfaceView(csr_matrix(rows), origin)
    return views


def solve_monolithic(model: MonolithicMachine, point: str, count: int) -> tuple[FloatArray, FloatArray]:
    """Compliance ``(6, 6)`` at a point and the lowest frequencies [Hz] of a held machine without constraints, by one factorisation.

    Raises:
        ValueError: The machine has held joints.
    """
    if model.constraints.shape[0]:
        raise ValueError("this road takes machines whose joints are all springs")
    stiffness = model.stiffness.tocsc()
    # symmetric and positive definite: no pivoting, and an ordering for symmetric matrices
    factor = scipy.sparse.linalg.splu(stiffness, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    rows = model.points[point]
    compliance = rows @ factor.solve(rows.T.toarray())
    inverse = scipy.sparse.linalg.LinearOperator(stiffness.shape, matvec=factor.solve, dtype=float)
    values = scipy.sparse.linalg.eigsh(
        stiffness, k=count, M=model.mass.tocsc(), sigma=0.0, OPinv=inverse, tol=1e-10, return_eigenvectors=False
    )
    return np.asarray(compliance), np.asarray(np.sqrt(np.sort(values)) / (2.0 * math.pi))


def _patch_under(machine: Machine, carriage: Carriage) -> Interface:
    """The rail's strip cut to the carriage's length: a rect on the same face."""
    interface = machine.components[str(carriage.rail.component)].interfaces[str(carriage.rail.interface)]
    (patch,) = interface.patches
    if interface.rail is None or patch.shape != "strip":
        raise ValueError("rails of this road are strips")
    axis = "xyz".index(interface.rail.along)
    center = list(patch.center)
    center[axis] = carriage.place
    in_plane = [i for i in range(3) if i != "xyz".index(patch.face[0])]
    size = tuple(carriage.length if i == axis else patch.size[0] for i in in_plane)
    return Interface(carriage.joint, (Patch(patch.face, "rect", (center[0], center[1], center[2]), size),), "average")


def _fix_joint(machine: Machine, joint: Joint, carriage: Carriage | None, pose: Pose) -> Joint:
    if carriage is not None:
        ends = tuple(JointEnd(end.component, joint.name) if end == carriage.rail else end for end in joint.ends)
        return dataclasses.replace(joint, ends=(ends[0], ends[1]), length=None)
    if joint.screw is None:
        return joint
    first, second = (_place_interface(machine, end, pose) for end in joint.ends)
    distance = abs(float((first - second) @ joint.rotation[:, 0]))
    stiffness = np.array(joint.stiffness)
    stiffness[0, 0] = 1.0 / (1.0 / stiffness[0, 0] + 1.0 / joint.screw.bearing + distance / joint.screw.axial)
    return dataclasses.replace(joint, stiffness=stiffness, screw=None)


def _place_interface(machine: Machine, end: JointEnd, pose: Pose) -> FloatArray:
    """Middle ``(3,)`` of an interface in the machine frame in a pose [m]."""
    component = machine.components[str(end.component)]
    frame = place_components(machine, pose)[component.name]
    return np.asarray(frame.origin + frame.rotation @ describe_component(component).patch_centroids[str(end.interface)])
