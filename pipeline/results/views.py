"""What a picture of the machine needs: surfaces, and in each pose placements, joints, points and
how the surfaces move in modes.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.machine import Machine
from headstock.geometry.parts.components import Component, Material
from headstock.geometry.parts.skins import (
    IntArray,
    Skin,
    inertia_skin,
    mark_places,
    solid_skin,
    split_skin,
)
from headstock.geometry.parts.solids import SuperelementFile
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import DofLayout, locate_interface, turn_dofs
from headstock.reduction.motions.body_fields import carried_motion
from headstock.reduction.superelement import Superelement

# single precision is plenty for pictures and halves the file
ShiftArray = NDArray[np.floating]
BENDING_SPLITS = 3
# distinguished in light and dark, and by most colour-blind readers
COLORS = (
    "#4f7cac",
    "#d08a4a",
    "#6a9a5b",
    "#9172b4",
    "#c2a83e",
    "#4aa3a2",
    "#b5566e",
    "#8892a0",
    "#a07d5c",
    "#6a78c7",
)


@dataclass(frozen=True, eq=False)
class JointView:
    """A joint in a pose: its kind, its two ends and its frame in the machine."""

    kind: str
    first: str
    second: str
    frame: Frame


@dataclass(frozen=True, eq=False)
class PointView:
    """A named point in a pose.

    Attributes:
        tool_place: ``(3,)`` in the machine frame [m].
        work_place: ``(3,)``, the same; None where it is ground.
    """

    tool: str
    work: str
    tool_place: FloatArray
    work_place: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class SensorView:
    """A sensor, or a point mass without directions, in a pose.

    Attributes:
        place: ``(3,)`` in the machine frame [m].
        measured: Its dofs.
        directions: ``(k, 3)`` unit vectors along which they are, machine axes.
    """

    place: FloatArray
    measured: tuple[str, ...]
    directions: FloatArray


@dataclass(frozen=True, eq=False)
class PoseView:
    """The machine in a pose.

    Attributes:
        placements: Frame of each component in the machine frame.
        shifts: Component to ``(modes, points of its skin, 3)`` mode shapes in machine axes [m /
            sqrt(kg)]; empty without modes.
        pushes: ``"POINT DIRECTION"`` to component to ``(points of its skin, 3)`` displacement under
            a unit force there, with the opposite force on the work, machine axes [m/N].
    """

    placements: dict[str, Frame]
    joints: dict[str, JointView]
    points: dict[str, PointView]
    shifts: dict[str, ShiftArray] = field(default_factory=dict)
    pushes: dict[str, dict[str, ShiftArray]] = field(default_factory=dict)
    sensors: dict[str, SensorView] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class MachineView:
    """Everything there is to draw.

    Attributes:
        skins: Surface of each component in its own frame.
        materials: Of the components whose surface strains are known: those that were meshed.
    """

    skins: dict[str, Skin] = field(default_factory=dict)
    axes: dict[str, FloatArray] = field(default_factory=dict)
    poses: dict[str, PoseView] = field(default_factory=dict)
    materials: dict[str, Material] = field(default_factory=dict)


def pick_name(what: str, wanted: str | None, known: Iterable[str]) -> str:
    """A name that is known; the first where none is wanted.

    Args:
        what: The kind of thing, for the message.

    Raises:
        KeyError: It is not known.
    """
    names = list(known)
    if wanted is None and names:
        return names[0]
    if wanted not in names:
        raise KeyError(f"there is no {what} {wanted!r}; there are: {', '.join(names) or 'none'}")
    return wanted


def component_colors(view: MachineView) -> dict[str, str]:
    """A colour ``#rrggbb`` for each component, the same in every picture."""
    return {name: COLORS[index % len(COLORS)] for index, name in enumerate(view.skins)}


def component_skin(component: Component, superelement: Superelement, skin: Skin | None) -> Skin:
    """The surface to draw: that of the mesh, else of the solid, else a block of equal inertia, with
    marks at the nodes of a body whose shape is unknown.

    Args:
        component: Its solid is drawn where there is no mesh.
        superelement: Its inertia is drawn where the solid has no surface.
        skin: Surface of its mesh; None where it has none.
    """
    if skin is not None:
        return skin
    drawn = solid_skin(component.solid)
    if drawn is None:
        drawn = inertia_skin(
            superelement.mass_kg, superelement.center_of_mass, superelement.inertia
        )
    if len(superelement.frames) > 1:
        # a body that bends needs points between its corners
        for _ in range(BENDING_SPLITS):
            drawn = split_skin(drawn)
    if isinstance(component.solid, SuperelementFile):
        drawn = mark_places(drawn, superelement.frames)
    return drawn


def view_pose(coupled: CoupledMachine, machine: Machine) -> PoseView:
    """Return where everything is in the pose that a machine was coupled in."""
    frames = {spring.name: spring.frame for spring in coupled.joint_springs}
    return place_view(machine, coupled.layout, frames)


def place_view(machine: Machine, layout: DofLayout, frames: Mapping[str, Frame]) -> PoseView:
    """Return where components, joints and points are.

    Args:
        machine: Whose joints and points they are.
        frames: Joint to its frame in the machine frame; joints that are not in it are left out.
    """
    joints = {
        name: JointView(joint.kind, str(joint.ends[0]), str(joint.ends[1]), frames[name])
        for name, joint in machine.joints.items()
        if name in frames
    }
    points = {}
    for name, point in machine.points.items():
        if point.carrier.component is not None:
            place = locate_interface(layout, point.carrier, point.offset)
            work = None if point.work.component is None else locate_interface(layout, point.work)
            points[name] = PointView(str(point.tool), str(point.work), place, work)
    sensors = view_sensors(machine, layout.placements)
    return PoseView(dict(layout.placements), joints, points, sensors=sensors)


def view_sensors(machine: Machine, placements: Mapping[str, Frame]) -> dict[str, SensorView]:
    """Return where sensors and point masses are.

    Args:
        placements: Frame of each component in the machine frame.
    """
    views = {}
    for name, sensor in machine.sensors.items():
        frame = placements[sensor.component]
        views[name] = SensorView(
            frame.origin + frame.rotation @ np.array(sensor.position),
            tuple(sensor.directions),
            sensor.turn_directions(frame.rotation),
        )
    return views


def shift_skins(
    coupled: CoupledMachine, skins: dict[str, Skin], stacked: FloatArray
) -> dict[str, ShiftArray]:
    """Displacement ``(modes, n, 3)`` of every skin point in machine axes, single precision.

    Args:
        stacked: ``(n_all, modes)`` motions of all superelement dofs.
    """
    found: dict[str, ShiftArray] = {}
    for name, skin in skins.items():
        superelement, placement = coupled.layout.superelements[name], coupled.placements[name]
        own = turn_dofs(superelement, placement) @ stacked[coupled.offsets[name]]
        moved = _skin_recovery(superelement, skin) @ own
        shifts = moved.T.reshape(stacked.shape[1], len(moved) // 3, 3) @ placement.rotation.T
        found[name] = shifts.astype(np.float32)
    return found


class SurfaceGauges:
    """The triangles of a free surface, each a strain gauge.

    No traction acts on a free surface, so the stress there is plane and its energy follows from the
    strains in the surface. Where an interface, a load or a support acts on the surface, the part of
    the energy that the traction does is missing.

    Args:
        points: ``(n, 3)`` [m].
        triangles: ``(m, 3)``.

    Source: Timoshenko and Goodier (1970), Theory of Elasticity, plane stress.
    """

    def __init__(self, points: FloatArray, triangles: IntArray) -> None:
        sides = points[triangles[:, 1:]] - points[triangles[:, :1]]
        normals = np.cross(sides[:, 0], sides[:, 1])
        doubled = np.linalg.norm(normals, axis=1)
        whole = doubled > 0.0
        sides, normals, self._doubled = sides[whole], normals[whole], doubled[whole]
        first = sides[:, 0] / np.linalg.norm(sides[:, 0], axis=1, keepdims=True)
        across = np.cross(normals / self._doubled[:, None], first)
        self._axes = np.stack([first, across], axis=2)
        # rows: the two sides; columns: the two axes in the plane
        self._inverses = np.linalg.inv(sides @ self._axes)
        self._triangles = triangles[whole]
        self._corner = self._triangles.ravel()
        area = np.bincount(self._corner, np.repeat(self._doubled, 3), minlength=len(points))
        self._area = np.where(area > 0.0, area, 1.0)

    def energy_density(self, shift: ShiftArray, material: Material) -> FloatArray:
        """Return the strain energy per volume just below the surface [J/m^3], ``(n,)`` means over the
        triangles at each point, by area.

        Args:
            shift: ``(n, 3)`` displacement [m], in the axes of the points.
        """
        moved = shift.astype(float)
        strained = moved[self._triangles[:, 1:]] - moved[self._triangles[:, :1]]
        gradient = self._inverses @ (strained @ self._axes)
        strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
        nu = material.poisson_ratio
        trace = strain[:, 0, 0] + strain[:, 1, 1]
        squares = np.einsum("mij,mij->m", strain, strain)
        factor = 0.5 * material.youngs_modulus / (1.0 - nu**2)
        density = factor * (nu * trace**2 + (1.0 - nu) * squares)
        weighed = np.repeat(self._doubled * density, 3)
        return np.asarray(
            np.bincount(self._corner, weighed, minlength=len(self._area)) / self._area
        )


def _skin_recovery(superelement: Superelement, skin: Skin) -> FloatArray:
    """Displacement ``(3 n, dofs)`` of the skin's points per unit dof: recovered on the mesh, else
    carried by the near nodes.

    A rigid body moves rigidly.
    """
    size = len(superelement.labels)
    if superelement.recovery is not None and skin.nodes is not None and skin.weights is not None:
        basis = superelement.recovery.basis.reshape(-1, 3, size)
        found = np.zeros((len(skin.points), 3, size))
        for around in range(skin.nodes.shape[1]):
            found += skin.weights[:, around, None, None] * basis[skin.nodes[:, around]]
        return found.reshape(-1, size)
    return carried_motion(superelement, skin.points)
