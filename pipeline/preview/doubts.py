"""What looks like a slip in a machine before anything is computed, from rigid bodies and joints alone: what moves
freely, parts of a size that no part has, joints whose ends lie far apart, axes whose travel ends beyond a rail, supports
that sink under their weight.
"""

import dataclasses
import importlib
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.loading import load_library
from headstock.geometry.machine.carriages import find_travel_faults
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.geometry.parts.components import Component, Support
from headstock.geometry.parts.mass_properties import SolidProperties, closed_form_properties
from headstock.geometry.parts.solids import MeshFile, PointMass, SuperelementFile
from headstock.meshing.length_units import doubt_mesh_size
from headstock.pipeline.planning.locking import foresee_locking
from headstock.pipeline.planning.rail_meshes import find_coarse_rails
from headstock.pipeline.preview.rigid_areas import doubt_rigid_areas
from headstock.pipeline.preview.rigid_bodies import RigidMachine, place_rigid
from headstock.pipeline.preview.watched_numbers import find_unknown_numbers
from headstock.pipeline.storage.part_files import describe_solid, find_missing_patches
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.reduction.motions.part_names import name_families, split_number
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, choose_poses

PARTS_MODULE = "headstock.pipeline.exchange.scene_parts"
COUPLING_MODULE = "headstock.pipeline.preview.free_motions"
MOST_DEFLECTION = 1e-3  # of a support or joint under the weight that it carries [m]
SLIDING = ("linear_guide", "ball_screw", "prismatic")
TOUCHING = 0.01  # of the larger interface: areas that near lie on each other
POINT_REACH = 1.0  # of a point mass from the area that carries it [m]
PROJECTIONS = 50
EVERY_DOF = (0, 1, 2, 3, 4, 5)

type Parts = Mapping[str, SolidProperties]


@dataclass(frozen=True, eq=False)
class _Area:
    """A box around an interface where it stands.

    Attributes:
        box: ``(2, 3)`` in that frame [m].
        point_mass: Whether it is the place of a mass without a shape.
    """

    frame: Frame
    box: FloatArray
    point_mass: bool

    @property
    def size(self) -> float:
        """Longest side [m]."""
        return float(np.ptp(self.box, axis=0).max())

    @property
    def middle(self) -> FloatArray:
        """``(3,)`` in the machine frame [m]."""
        return self.frame.origin + self.frame.rotation @ self.box.mean(axis=0)

    def nearest(self, place: FloatArray) -> FloatArray:
        """Return the point ``(3,)`` of the box that is nearest to a place, machine frame [m]."""
        local = (place - self.frame.origin) @ self.frame.rotation
        return self.frame.origin + self.frame.rotation @ np.clip(local, *self.box)


@dataclass(frozen=True)
class JointGap:
    """How far the two ends of a joint lie apart, but for what it travels.

    Attributes:
        middles: Between the middles of both areas [m].
        areas: Between the areas, zero where they meet [m].
        size: Longest side of the larger area [m].
        usual: Distance of middles that is not doubted [m].
        across: " across its direction of travel" where it has one.
    """

    middles: float
    areas: float
    size: float
    usual: float
    across: str

    @property
    def doubtful(self) -> bool:
        """Return whether the ends are farther apart than joints are long."""
        return self.middles > self.usual and self.areas > TOUCHING * self.usual


def measure_joints(scene: Scene, pose: Pose) -> dict[str, JointGap]:
    """Measure how far the ends of each joint lie apart in a pose; joints of ground and of ends whose
    place is not known are left out.
    """
    parts = _describe_parts(scene.machine, read=True)
    return _measure_joints(scene.machine, parts, pose)


def doubt_machine(scene: Scene, *, read: bool = True) -> tuple[str, ...]:
    """Warnings of what looks like a slip; empty where nothing does.

    Args:
        read: Ask the CAD kernel and mesh files for sizes, where they are not kept; without it only
            parts with a closed form are looked at.
    """
    parts = _describe_parts(scene.machine, read=read)
    pose = next(iter(choose_poses(scene).values()))
    warnings = doubt_rigid_areas(scene, parts) + [
        f"component {name!r}: {doubt}"
        for name, properties in parts.items()
        for doubt in [_doubt_part(scene.machine.components[name], properties)]
        if doubt
    ]
    try:
        warnings += _doubt_joints(scene.machine, parts, pose)
        warnings += _doubt_deflections(scene.machine, parts, pose)
        warnings += find_travel_faults(scene.machine)
    except (HeadstockError, ValueError):
        pass  # a pose or a joint that cannot be had is the matter of its own stage
    return tuple(warnings)


def _describe_parts(machine: Machine, *, read: bool) -> Parts:
    store, found = Store(default_store_root()), {}
    for name, part in machine.components.items():
        if isinstance(part.solid, SuperelementFile):
            continue
        closed = closed_form_properties(part)
        if closed is None and read:
            try:
                closed = describe_solid(part, store)
            except HeadstockError:
                continue  # its own stage says so
        if closed is not None:
            found[name] = closed
    return found


def _doubt_part(component: Component, properties: SolidProperties) -> str | None:
    if not isinstance(component.solid, MeshFile):
        return None
    mass = component.mass or component.material.density * properties.volume
    extent = float(np.ptp(properties.box, axis=0).max())
    return doubt_mesh_size(component.solid, extent, mass)


def _doubt_joints(machine: Machine, parts: Parts, pose: Pose) -> list[str]:
    """Joints whose ends lie farther apart than their larger interface; of joints that differ by a
    number the farthest.
    """
    worst: dict[str, tuple[float, str]] = {}
    for name, gap in _measure_joints(machine, parts, pose).items():
        stem = split_number(name)[0]
        if gap.doubtful and gap.middles > worst.get(stem, (0.0, ""))[0]:
            ends = " and ".join(str(end) for end in machine.joints[name].ends)
            worst[stem] = (
                gap.middles,
                f"joint {name}: the middles of {ends} are {_show_length(gap.middles)} apart{gap.across}, and the larger of both measures "
                f"{_show_length(gap.size)}; check `at` of both components and the interfaces that the joint names",
            )
    for name, (beside, end, size) in _find_beside(machine, parts, pose).items():
        stem = split_number(name)[0]
        if beside > worst.get(stem, (0.0, ""))[0]:
            worst[stem] = (
                beside,
                f"joint {name}: it acts {_show_length(beside)} beside {end}, across its direction of travel, and its carriage measures "
                f"{_show_length(size)}; check `at` or `carriages`, and which rail it names: rails count from the positive side",
            )
    return [words for _, words in worst.values()]


def _find_beside(
    machine: Machine, parts: Parts, pose: Pose
) -> dict[str, tuple[float, JointEnd, float]]:
    """Find the carriages that act farther beside their rail than they are long: by joint the distance
    [m], the rail, and the length of the carriage [m].
    """
    frames, found = place_components(machine, pose), {}
    for name, joint in machine.joints.items():
        carriers = [end for end in joint.ends if end.component and not _is_rail(machine, end)]
        if joint.length is None or joint.point is None or not carriers:
            continue
        carrier = carriers[0].component or ""
        start, moved = machine.components[carrier].placement, frames[carrier]
        local = (joint.point - start.origin) @ start.rotation
        place = moved.origin + moved.rotation @ local
        for end in joint.ends:
            area = _area_of(end, machine, parts, frames)
            if area is None or not _is_rail(machine, end):
                continue
            rail = machine.components[end.component or ""].interfaces[end.interface or ""].rail
            travel = frames[end.component or ""].rotation[
                :, "xyz".index(rail.along if rail else "x")
            ]
            offset = place - area.nearest(place)
            beside = float(np.linalg.norm(offset - (offset @ travel) * travel))
            if beside > joint.length:
                found[name] = (beside, end, joint.length)
    return found


def _is_rail(machine: Machine, end: JointEnd) -> bool:
    part = machine.components.get(end.component or "")
    return part is not None and (
        (interface := part.interfaces.get(end.interface or "")) is not None
        and interface.rail is not None
    )


def _measure_joints(machine: Machine, parts: Parts, pose: Pose) -> dict[str, JointGap]:
    frames = place_components(machine, pose)
    along = {
        joint: axis.direction
        for axis in machine.axes.values()
        if axis.kind == "linear"
        for joint in axis.joints
    }
    gaps = {}
    for name, joint in machine.joints.items():
        areas = [_area_of(end, machine, parts, frames) for end in joint.ends]
        known = [area for area in areas if area is not None]
        screw = machine.joints.get(name.removesuffix("_shaft"))
        slides = joint.kind in SLIDING or (screw is not None and screw.kind == "ball_screw")
        free = joint.rotation[:, 0] if slides else along.get(name)
        if len(known) == 2 and not all(area.point_mass for area in known):
            gaps[name] = _measure_gap(known[0], known[1], free)
    return gaps


def _area_of(
    end: JointEnd, machine: Machine, parts: Parts, frames: Mapping[str, Frame]
) -> _Area | None:
    """Where an end is; None of ground and where it is not known."""
    if end.component is None or end.interface is None:
        return None
    if end.component not in parts or end.interface not in parts[end.component].patch_boxes:
        return None
    point = isinstance(machine.components[end.component].solid, PointMass)
    return _Area(frames[end.component], parts[end.component].patch_boxes[end.interface], point)


def _measure_gap(first: _Area, second: _Area, free: FloatArray | None) -> JointGap:
    """Measure how far two areas lie apart.

    Args:
        free: ``(3,)`` direction that the joint slides along, in which they may lie apart.
    """
    size = max(first.size, second.size)
    point = first.point_mass or second.point_mass
    apart = second.middle - first.middle
    shift = np.zeros(3) if free is None else (apart @ free) * free
    return JointGap(
        float(np.linalg.norm(apart - shift)),
        _find_distance(first, second, shift),
        size,
        max(size, POINT_REACH) if point else size,
        "" if free is None else " across its direction of travel",
    )


def _find_distance(first: _Area, second: _Area, shift: FloatArray) -> float:
    """Find the shortest distance [m] of two boxes, the second moved by ``-shift`` ``(3,)`` [m], by
    alternating projections (Cheney and Goldstein 1959).
    """
    place, distance = second.middle - shift, math.inf
    for _ in range(PROJECTIONS):
        other = first.nearest(place)
        place = second.nearest(other + shift) - shift
        before, distance = distance, float(np.linalg.norm(place - other))
        if distance >= before:
            break
    return distance


def _show_length(length: float) -> str:
    return f"{1e3 * length:.3g} mm" if length < 1.0 else f"{length:.3g} m"


def _doubt_deflections(machine: Machine, parts: Parts, pose: Pose) -> list[str]:
    """Joints that deflect under the weight that they carry, with every body rigid; nothing where
    that is not known, or where gravity moves what nothing holds.
    """
    if machine.mechanism is not None or len(parts) < len(machine.components):
        return []
    bodies = {name: parts[name] for name, part in machine.components.items() if part.interfaces}
    held = {
        joint.name: joint
        for support in machine.supports.values()
        if (joint := _hold(support, machine)) is not None
    }
    joints = {name: dataclasses.replace(one, errors=None) for name, one in machine.joints.items()}
    bare = dataclasses.replace(
        machine,
        joints=joints | held,
        components={name: machine.components[name] for name in bodies},
    )
    rigid = place_rigid(bare, bodies, pose)
    stretched = rigid.stretch_by_weight(np.array(machine.gravity))
    sunk = {
        spring.name: (deflection, float(spring.stiffness[:3, :3].max()))
        for spring in rigid.springs
        for stretch in [
            stretched.get(spring.name, np.zeros(3)) * (spring.stiffness[:3, :3].diagonal() > 0.0)
        ]
        if (deflection := float(np.linalg.norm(stretch))) > MOST_DEFLECTION
        and not machine.joints[spring.name].soft
    }
    return [
        _describe_sinking(machine, family, names[0], *max(sunk[name] for name in names))
        for family, names in name_families(sunk).items()
    ]


def _describe_sinking(
    machine: Machine, family: str, joint: str, deflection: float, stiffness: float
) -> str:
    frequency = math.sqrt(np.linalg.norm(machine.gravity) / deflection) / (2.0 * math.pi)
    grounded = any(end.component is None for end in machine.joints[joint].ends)
    return (
        f"joint {family} {'sinks' if grounded else 'gives'} by {_show_length(deflection)} under the weight it carries, "
        f"with {stiffness:.3g} N/m at most, as a mount of {frequency:.2g} Hz; "
        f"check the unit of its stiffness, or write soft = true where an air spring or rubber is meant"
    )


def _hold(support: Support, machine: Machine) -> Joint | None:
    """A rigid joint to ground in place of a support, which is at least as stiff; None for a body
    without an interface that it could act at.
    """
    interfaces = machine.components[support.component].interfaces
    if not interfaces:
        return None
    end = JointEnd(support.component, next(iter(interfaces)))
    return Joint(f"supports.{support.name}", (end, JointEnd()), "rigid", fixed=EVERY_DOF)


def check_scene(scene: Scene) -> list[str]:
    """Return what is allowed but looks wrong: bodies that move freely, odd numbers, what an analysis on
    request lacks.

    Raises:
        SceneError: Patches without facets, rails too coarse, watched numbers that no run finds, files
            of reduced bodies that are none.
    """
    problems, remarks = find_missing_patches(scene)
    coarse, perhaps = find_coarse_rails(scene)
    problems += coarse + find_unknown_numbers(scene)
    if any(isinstance(one.solid, SuperelementFile) for one in scene.machine.components.values()):
        problems += load_library(PARTS_MODULE).find_part_problems(scene)
    if problems:
        raise SceneError(problems)
    lacking = [
        f"with --analysis {name}: {problem.place}: {problem.key}: {problem.message}"
        for name, deferred in scene.deferred.items()
        for problem in deferred
    ]
    return [
        *scene.warnings,
        *lacking,
        *free_motion_warnings(scene),
        *doubt_machine(scene),
        *perhaps,
        *foresee_locking(scene),
        *remarks,
    ]


def free_motion_warnings(scene: Scene) -> tuple[str, ...]:
    """Warnings of a machine in which bodies may move that are not declared free; empty without.

    Elastic bodies have the free motions of rigid ones on the same joints. Nothing is said where
    that would take a mesh: imported parts, supports on faces or points, mechanisms.
    """
    try:
        rigid = _place_rigid(scene)
        if rigid is None or not rigid.held:
            return ()
        # where everything is held, which is usual, nothing that couples is loaded
        coupling = importlib.import_module(COUPLING_MODULE)
        points = scene.analyses[StaticRequest].at if StaticRequest in scene.analyses else ()
        warnings: tuple[str, ...] = coupling.describe_free_motions(
            rigid.layout.superelements,
            scene.machine,
            next(iter(choose_poses(scene).values())),
            points,
        )
        return warnings
    except HeadstockError:
        # a solid or a joint that cannot be built is the matter of its own stage
        return ()


def _place_rigid(scene: Scene) -> RigidMachine | None:
    """The machine in its first pose with every body rigid; None where that is not known without a
    mesh or nothing can be free.
    """
    machine = scene.machine
    if (
        scene.mechanism is not None
        or machine.supports
        or not any(
            any(dof not in joint.fixed and not joint.stiffness[dof].any() for dof in range(6))
            for joint in machine.joints.values()
        )
    ):
        return None
    if any(
        isinstance(part.solid, MeshFile | SuperelementFile) for part in machine.components.values()
    ):
        return None
    store = Store(default_store_root())
    parts = {name: describe_solid(part, store) for name, part in machine.components.items()}
    return place_rigid(machine, parts, next(iter(choose_poses(scene).values())))
