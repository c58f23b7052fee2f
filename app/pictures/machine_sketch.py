"""A machine with its interfaces, joints, supports and points as a surface with labels."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from headstock.app.pictures.numbered import Color, LabelledSurface
from headstock.app.pictures.picture import Marks, Note
from headstock.app.pictures.scenes import TOOL_COLOR, TOOL_SHARE, join_skins_in_pose
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Patch
from headstock.geometry.parts.patches import (
    FACE_DIRECTIONS,
    PlanarFace,
    PlanarSolid,
    band_span,
    in_plane_axes,
    named_planar_face,
    patch_rects,
)
from headstock.geometry.parts.plane_shapes import flatten_patch
from headstock.geometry.parts.solids import Tube
from headstock.meshing.components.skins import find_areas
from headstock.pipeline.preview.rigid_view import SupportView
from headstock.pipeline.results.views import JointView, MachineView, PointView, PoseView, SensorView

# kinds that move or hold along an axis: the columns of their frame that it is
AXIS_COLUMNS = {
    "linear_guide": (0,),
    "ball_screw": (0,),
    "bearing": (0,),
    "mount": (2,),
    "revolute": (0,),
    "universal": (0, 2),
    "prismatic": (0,),
}
RIGID, SPRING, FREE = (0.39, 0.45, 0.55), (0.85, 0.47, 0.02), (0.49, 0.23, 0.93)
MOUNT, WORK, SUPPORT = (0.10, 0.55, 0.27), (0.10, 0.35, 0.80), (0.20, 0.20, 0.20)
SENSOR, MASS = (0.80, 0.25, 0.60), (0.30, 0.30, 0.30)
MOST_NAMED = 20  # sensors; more names would hide the machine
AREAS: dict[str, Color] = {"area of an interface": (0.78, 0.78, 0.75), "rail": (0.25, 0.27, 0.30)}
AROUND = 48  # flat pieces of a band around a tube
LIFT = 1e-3  # of an area above its face, as a share of the part's size
FREE_KINDS = ("revolute", "universal", "spherical", "prismatic")
BALL_SHARE, ARROW_SHARE, CONE_SHARE = 0.007, 0.06, 0.03


@dataclass(frozen=True)
class _Sketch:
    """Marks, names and legend of a picture, in the order in which they are drawn."""

    marks: list[Marks] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    legend: list[tuple[str, Color]] = field(default_factory=list)

    def count(self, what: str, number: int, color: Color) -> None:
        """Add to the legend what there is at all."""
        if number:
            self.legend.append((f"{what}: {number}", color))

    def draw_joints(self, joints: Mapping[str, JointView]) -> None:
        """Draw balls and axes at joints, cones at mounts."""
        groups: dict[str, list[tuple[str, JointView]]] = {}
        for name, joint in joints.items():
            groups.setdefault(_group(joint), []).append((name, joint))
        for group, members in groups.items():
            color = GROUPS[group]
            places = np.array([joint.frame.origin for _, joint in members])
            if group == "mount":
                into = np.array([-joint.frame.rotation[:, 2] for _, joint in members])
                self.marks.append(Marks(places, color, CONE_SHARE, True, "cone", into))
            else:
                self.marks.append(Marks(places, color, BALL_SHARE, True))
                self.marks.extend(_axis_arrows([joint for _, joint in members], color))
            self.notes.extend(Note(name, joint.frame.origin, color) for name, joint in members)
            self.count(group, len(members), color)

    def draw_supports(self, supports: Mapping[str, SupportView]) -> None:
        """Draw a cone for each direction that is fixed."""
        for name, support in supports.items():
            places = np.repeat(support.places, len(support.directions), axis=0)
            along = np.tile(support.directions, (len(support.places), 1))
            self.marks.append(Marks(places, SUPPORT, CONE_SHARE, True, "cone", along))
            self.notes.extend(Note(name, place, SUPPORT) for place in support.places)
        self.count("support, a cone per fixed direction", len(supports), SUPPORT)

    def draw_points(self, points: Mapping[str, PointView]) -> None:
        """Draw both places of each point, tools named."""
        tools = np.array([point.tool_place for point in points.values()]).reshape(-1, 3)
        works = [point.work_place for point in points.values() if point.work_place is not None]
        self.marks.append(Marks(tools, TOOL_COLOR, TOOL_SHARE, True))
        self.marks.append(Marks(np.array(works).reshape(-1, 3), WORK, TOOL_SHARE, True))
        # first, where there is most room
        self.notes[:0] = [Note(name, one.tool_place, TOOL_COLOR) for name, one in points.items()]
        self.count("tool of a point", len(points), TOOL_COLOR)
        self.count("work of a point", len(works), WORK)

    def draw_sensors(self, sensors: Mapping[str, SensorView]) -> None:
        """Draw a ball at each sensor and point mass, and an arrow along what is measured; few are named."""
        for what, color, shown in (
            (
                "sensor, an arrow per direction",
                SENSOR,
                {n: s for n, s in sensors.items() if s.measured},
            ),
            ("point mass", MASS, {n: s for n, s in sensors.items() if not s.measured}),
        ):
            places = [sensor.place for sensor in shown.values()]
            self.marks.append(Marks(np.array(places).reshape(-1, 3), color, BALL_SHARE, True))
            tails = [one.place for one in shown.values() for _ in one.measured]
            if tails:
                along = np.vstack([one.directions for one in shown.values()])
                self.marks.append(Marks(np.array(tails), color, CONE_SHARE, True, "arrow", along))
            if len(shown) <= MOST_NAMED:
                self.notes.extend(Note(name, one.place, color) for name, one in shown.items())
            self.count(what, len(shown), color)


def label_machine(
    title: str,
    view: MachineView,
    placed: PoseView,
    supports: Mapping[str, SupportView],
    components: Mapping[str, Component],
) -> LabelledSurface:
    """The skins of a machine in a pose, areas of interfaces, and marks and names at joints, supports,
    points and sensors.
    """
    sketch = _Sketch()
    sketch.draw_joints(placed.joints)
    sketch.draw_supports(supports)
    sketch.draw_points(placed.points)
    sketch.draw_sensors(placed.sensors)
    joined = join_skins_in_pose(view, placed)
    corners, triangles, owners = [joined.points], [joined.triangles], [joined.owners]
    start = len(joined.points)
    for owner, (kind, areas) in enumerate(
        _interface_areas(components, placed).items(), len(joined.palette)
    ):
        for area in areas:
            # corners that triangles share are one, so that no edge is drawn between these
            places, flat = np.unique(area.reshape(-1, 3).round(9), axis=0, return_inverse=True)
            corners.append(places)
            triangles.append(start + flat.reshape(-1, 3))
            owners.append(np.full(len(area), owner))
            start += len(places)
        sketch.count(kind, len(areas), AREAS[kind])
    return LabelledSurface(
        np.vstack(corners),
        np.vstack(triangles),
        np.concatenate(owners),
        dict(enumerate(view.skins, 1)),
        title,
        palette=np.vstack([joined.palette, list(AREAS.values())]),
        marks=tuple(sketch.marks),
        notes=tuple(sketch.notes),
        legend=tuple(sketch.legend),
    )


GROUPS: dict[str, Color] = {
    "mount": MOUNT,
    "rigid or bolted joint": RIGID,
    "spring, guide, screw or bearing": SPRING,
    "free joint": FREE,
}


def _group(joint: JointView) -> str:
    if joint.kind == "mount":
        return "mount"
    if joint.kind in ("rigid", "bolted"):
        return "rigid or bolted joint"
    return "free joint" if joint.kind in FREE_KINDS else "spring, guide, screw or bearing"


def _axis_arrows(joints: list[JointView], color: Color) -> list[Marks]:
    """An arrow along each axis of joints."""
    arrows = [
        (joint.frame.origin, joint.frame.rotation[:, column])
        for joint in joints
        for column in AXIS_COLUMNS.get(joint.kind, ())
    ]
    if not arrows:
        return []
    tails, along = (np.array(part) for part in zip(*arrows, strict=True))
    return [Marks(tails, color, ARROW_SHARE, True, "arrow", along)]


def _interface_areas(
    components: Mapping[str, Component], placed: PoseView
) -> dict[str, list[FloatArray]]:
    """Triangles ``(k, 3, 3)`` of areas, outward, machine frame [m]: of interfaces of parts from a
    file, and of patches on flat faces of other solids and around tubes, whose whole faces are left
    out.
    """
    areas: dict[str, list[FloatArray]] = {kind: [] for kind in AREAS}
    for name, part in components.items():
        frame = placed.placements[name]
        for label, corners in lift_areas(part).items():
            kind = "rail" if part.interfaces[label].rail else "area of an interface"
            areas[kind].append(corners @ frame.rotation.T + frame.origin)
        if not isinstance(part.solid, PlanarSolid | Tube):
            continue
        for interface in part.interfaces.values():
            kind = "rail" if interface.rail else "area of an interface"
            for patch in interface.patches:
                for outline in [] if patch.shape == "whole" else _lift_outlines(part.solid, patch):
                    rim = outline @ frame.rotation.T + frame.origin
                    fan = np.arange(1, len(rim) - 1)
                    areas[kind].append(rim[np.column_stack([0 * fan, fan, fan + 1])])
    return areas


def _lift_outlines(solid: PlanarSolid | Tube, patch: Patch) -> list[FloatArray]:
    """Convex outlines ``(k, 3)`` of a patch a little above its face, anticlockwise from outside [m]."""
    if isinstance(solid, Tube):
        if patch.shape != "band":
            return []
        outer = patch.face == "outer"
        radius = 0.5 * solid.outer_diameter if outer else 0.5 * solid.inner_diameter
        angles = 2.0 * np.pi * np.arange(AROUND + 1) / AROUND * (1.0 if outer else -1.0)
        radius += LIFT * solid.outer_diameter * (1.0 if outer else -1.0)
        ends = np.array(band_span(patch, 0.0, solid.length))
        points = np.empty((2, AROUND + 1, 3))
        points[..., :2] = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        points[..., 2] = ends[:, None]
        return list(np.stack([points[0, :-1], points[0, 1:], points[1, 1:], points[1, :-1]], 1))
    face = named_planar_face(solid, patch.face)
    if face is None:
        return []
    _, sign = FACE_DIRECTIONS[patch.face]
    lift, areas = LIFT * max(solid.size), []
    for outline in _outlines(face, patch):
        area = np.full((len(outline), 3), face.position + sign * lift)
        area[:, in_plane_axes(face.axis)] = outline
        # x y z without y is left-handed as seen along y
        turned = sign < 0.0 if face.axis != 1 else sign > 0.0
        areas.append(area[::-1] if turned else area)
    return areas


def lift_areas(part: Component) -> dict[str, FloatArray]:
    """Triangles ``(m, 3, 3)`` of the interfaces of a part from a file, a little above its faces, and
    patches above whole faces [m].
    """
    areas = find_areas(part)
    size = max((np.ptp(corners, axis=(0, 1)).max() for corners in areas.values()), default=0.0)
    for name, corners in areas.items():
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
        whole = part.interfaces[name].patches[0].shape == "whole"
        areas[name] = corners + (1.0 if whole else 2.0) * LIFT * size * across[:, None]
    return areas


def _outlines(face: PlanarFace, patch: Patch) -> list[FloatArray]:
    """Convex outlines ``(k, 2)`` of a patch along the two in-plane axes, anticlockwise [m]."""
    rects = patch_rects(face, patch)
    if rects is not None:
        return [np.array([[a, c], [b, c], [b, d], [a, d]]) for a, b, c, d in rects]
    axes = list(in_plane_axes(face.axis))
    middle = np.array(patch.center)[axes]
    return [middle + piece for piece in flatten_patch(patch, np.eye(3)[axes]).pieces()]
