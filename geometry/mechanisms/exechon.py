"""The Exechon, a tripod of two UPR legs on a common first axis and one SPR leg with a two-axis
wrist: mechanism, inverse kinematics, and the components that it carries, posed by their tool.

Base frame: y along the common first axis of legs 1 and 2, x towards leg 3, z towards the platform.
Platform frame: x along the last revolutes of legs 1 and 2, y along the last revolute of leg 3, z
towards the tool. Functions of poses take leading batch dimensions.

Source: Zoppi, Zlatanov and Molfino (2010), Kinematics analysis of the Exechon tripod,
DETC2010-28668, whose legs A, C, B are legs 1, 2, 3 here; sec. 4 is written with the angles ``phi``
of the plane of legs 1 and 2 (sin phi = c_alpha there up to sign) and ``beta`` of the platform in
it. With lumped compliances between leg tip and platform joint the model is that of Bonnemains,
Chanal, Bouzgarrou and Ray (2010), eqs. 4 to 6.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.errors import JointLimitError, SingularPoseError, UnreachablePoseError
from headstock.geometry.frames import FloatArray, Frame, compose_frames, rotation_about
from headstock.geometry.mechanisms.closures import evaluate_kinematics
from headstock.geometry.mechanisms.kinematics import place_markers
from headstock.geometry.mechanisms.mechanism import (
    AxisName,
    ChainItem,
    CoordinateConstraint,
    Marker,
    Mechanism,
    OrientationConstraint,
    PointConstraint,
    prismatic,
    revolute,
    wrap_angles,
)

LEGS = ("leg_1", "leg_2", "leg_3")
LENGTHS = ("q1", "q2", "q3")
WRIST = ("g4", "g5")
COMPLIANCES = ("d11", "d12", "d21", "d22", "d31", "d32")
Sign = Literal[-1, 1]
Assembly = tuple[Sign, Sign]
ASSEMBLIES: tuple[Assembly, ...] = ((1, 1), (1, -1), (-1, 1), (-1, -1))
SINGULAR = 1e-9
LARGEST_CONDITION = 1e6


@dataclass(frozen=True)
class ExechonDimensions:
    """Lengths of an Exechon [m].

    Attributes:
        base: Places of the legs' base joints: y of legs 1 and 2 on the common axis, x of leg 3.
        platform: Places of the platform joints: y of legs 1 and 2, x of leg 3.
        universal_offsets: Distance between the two axes of the universal joint of legs 1 and 2,
            signed by the way it is built.
        platform_heights: z of the platform joints of legs 1 and 2.
        wrist: x and z of the wrist centre in the platform frame.
        tool_length: From the wrist centre to the tool point along the spindle.
    """

    base: tuple[float, float, float]
    platform: tuple[float, float, float]
    universal_offsets: tuple[float, float] = (0.0, 0.0)
    platform_heights: tuple[float, float] = (0.0, 0.0)
    wrist: tuple[float, float] = (0.0, 0.0)
    tool_length: float = 0.0


def exechon_mechanism(dimensions: ExechonDimensions) -> Mechanism:
    """Return the mechanism: 3 lengths and 2 wrist angles driven, 9 passive angles, 9 closures, 6
    lumped compliances.

    Markers: ``leg_i`` turns with leg i and does not slide, ``tip_i`` is its end, ``joint_i`` its
    platform joint, ``platform``, ``wrist_4`` and ``wrist_5`` turn with the axes of the wrist about
    its centre, ``tcp``.

    Of the twelve loop equations two are redundant, and sharing the first angle of legs 1 and 2
    takes one more away.
    """
    c, h = dimensions.wrist
    wrist: tuple[ChainItem, ...] = (
        prismatic("x", c), prismatic("z", h), revolute("z", "g4"), Marker("wrist_4"), revolute("y", "g5"), Marker("wrist_5"),
        prismatic("z", dimensions.tool_length), Marker("tcp"),
    )  # fmt: skip
    x3, c3 = dimensions.base[2], dimensions.platform[2]
    third: tuple[ChainItem, ...] = (
        prismatic("x", x3), revolute("x", "a1"), revolute("y", "a2"), revolute("z", "a3"), Marker("leg_3"), prismatic("z", "q3"), Marker("tip_3"),
        prismatic("x", "d31"), prismatic("z", "d32"), Marker("joint_3"), revolute("y", "ps3"), prismatic("x", -c3), Marker("platform_3"),
    )  # fmt: skip
    between: tuple[AxisName, ...] = ("y", "z")
    return Mechanism(
        "Exechon",
        chains=(_planar_leg(dimensions, 1, wrist), _planar_leg(dimensions, 2, ()), third),
        closures=(
            # the component along the last revolutes is an identity in the rotating plane of legs 1
            # and 2
            PointConstraint("platform", "platform_2", between, frame="plane"),
            CoordinateConstraint({"th1": 1.0, "ps1": 1.0, "th2": -1.0, "ps2": -1.0}),
            PointConstraint("platform_3", "platform"),
            OrientationConstraint("platform", "platform_3"),
        ),
        driven=(*LENGTHS, *WRIST),
        compliant=COMPLIANCES,
    )


def _planar_leg(
    dimensions: ExechonDimensions, leg: int, wrist: tuple[ChainItem, ...]
) -> tuple[ChainItem, ...]:
    place = leg - 1
    return (
        revolute("y", "phi"),
        *((Marker("plane"),) if leg == 1 else ()),
        prismatic("y", dimensions.base[place]),
        prismatic("z", dimensions.universal_offsets[place]),
        revolute("x", f"th{leg}"),
        Marker(f"leg_{leg}"),
        prismatic("z", f"q{leg}"),
        Marker(f"tip_{leg}"),
        prismatic("y", f"d{leg}1"),
        prismatic("z", f"d{leg}2"),
        Marker(f"joint_{leg}"),
        revolute("x", f"ps{leg}"),
        prismatic("z", -dimensions.platform_heights[place]),
        prismatic("y", -dimensions.platform[place]),
        Marker("platform" if leg == 1 else "platform_2"),
        *wrist,
    )


@dataclass(frozen=True, eq=False)
class MountedExechon:
    """An Exechon in its place above a table.

    Attributes:
        mounting: Base frame in the table frame.
        limits: Lowest and highest value of coordinates that have limits [m, rad].
        assembly: Which way round it is put together: signs of the plane's and of the platform's
            angle.
    """

    dimensions: ExechonDimensions
    mounting: Frame = field(default_factory=Frame)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    assembly: Assembly = (1, 1)
    mechanism: Mechanism = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "mechanism", exechon_mechanism(self.dimensions))


@dataclass(frozen=True, eq=False)
class PoseSurvey:
    """States of a mechanism in many poses.

    Attributes:
        states: ``(..., n)`` coordinates, NaN where a pose is out of reach.
        reached: ``(...)`` whether the pose can be taken.
        within: ``(...)`` whether every joint is within its limits too.
        condition: ``(...)`` condition number of the wrist centre's motion by the leg lengths;
            infinite where not reached.
    """

    states: FloatArray
    reached: NDArray[np.bool_]
    within: NDArray[np.bool_]
    condition: FloatArray


def solve_tool_pose(
    machine: MountedExechon, point: FloatArray, direction: FloatArray
) -> FloatArray:
    """Return the coordinates ``(n,)`` at which the tool stands in one pose.

    Args:
        point: ``(3,)`` tool point in the table frame [m].
        direction: ``(3,)`` unit vector along the tool, from the wrist to the tip, in the table
            frame.

    Raises:
        UnreachablePoseError: The wrist centre is too close to the common axis of legs 1 and 2.
        SingularPoseError: The plane, the platform or the wrist is undetermined, or a motion is lost
            or gained.
        JointLimitError: A joint is beyond its limits; says which and by how much.
    """
    tool_point = f"tool point ({', '.join(f'{1e3 * value:.4g}' for value in point)}) mm"
    center = _wrist_center(machine, np.asarray(point), np.asarray(direction))
    _require_reach(machine, center, tool_point)
    survey = survey_tool_poses(machine, np.asarray(point), np.asarray(direction))
    if not survey.reached:
        raise SingularPoseError(
            f"{tool_point}: the directions of a leg or of the wrist are undetermined there; move the pose a little"
        )
    if not survey.condition < LARGEST_CONDITION:
        raise SingularPoseError(
            f"{tool_point}: the tripod is singular there, condition number {survey.condition:.2g}; a motion of the platform is lost or gained"
        )
    if not survey.within:
        raise JointLimitError(
            f"{tool_point}: {'; '.join(name_limit_faults(machine, survey.states))}"
        )
    return survey.states


def survey_tool_poses(
    machine: MountedExechon, points: FloatArray, directions: FloatArray
) -> PoseSurvey:
    """Return the coordinates of many tool poses. Poses that cannot be reached are flagged; no error
    is raised.

    Args:
        points: ``(..., 3)`` tool points in the table frame [m].
        directions: ``(3,)`` or ``(..., 3)`` unit vectors along the tool in the table frame.
    """
    directions = np.broadcast_to(np.asarray(directions, dtype=float), points.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        states = platform_states(
            machine.dimensions, _wrist_center(machine, points, directions), machine.assembly
        )
        turned = place_markers(machine.mechanism, states)
        platform = turned.rotations[..., machine.mechanism.markers.index("platform"), :, :]
        tool_directions = (
            np.swapaxes(machine.mounting.rotation @ platform, -1, -2) @ directions[..., None]
        )[..., 0]
        wrist = machine.mechanism.index("g4")
        sideways = np.hypot(tool_directions[..., 0], tool_directions[..., 1])
        states[..., wrist] = np.where(
            sideways > SINGULAR,
            np.arctan2(tool_directions[..., 1], tool_directions[..., 0]),
            np.nan,
        )
        states[..., wrist + 1] = np.arctan2(sideways, tool_directions[..., 2])
    reached = np.asarray(np.isfinite(states).all(axis=-1))
    within = reached.copy()
    for name, (low, high) in machine.limits.items():
        value = states[..., machine.mechanism.index(name)]
        within &= (value >= low) & (value <= high)
    return PoseSurvey(states, reached, within, condition_numbers(machine.mechanism, states))


def platform_states(
    dimensions: ExechonDimensions, center: FloatArray, assembly: Assembly = (1, 1)
) -> FloatArray:
    """Return the coordinates of the tripod with its wrist centre in a place, wrist angles and
    compliances zero; NaN where it cannot be.

    Args:
        center: ``(..., 3)`` wrist centre in the base frame [m].
        assembly: One of :data:`ASSEMBLIES`; together they are all solutions with legs of positive
            length.
    """
    mechanism = exechon_mechanism(dimensions)
    phi, beta = _plane_and_platform(dimensions, center, assembly)
    sin_phi, cos_phi, sin_beta, cos_beta = np.sin(phi), np.cos(phi), np.sin(beta), np.cos(beta)
    zero = np.zeros_like(phi)
    normal, radial = np.stack([cos_phi, zero, -sin_phi], -1), np.stack([sin_phi, zero, cos_phi], -1)
    along = np.array([0.0, 1.0, 0.0])
    y_axis = cos_beta[..., None] * along + sin_beta[..., None] * radial
    z_axis = cos_beta[..., None] * radial - sin_beta[..., None] * along
    origin = center - dimensions.wrist[0] * normal - dimensions.wrist[1] * z_axis
    values: dict[str, FloatArray] = {"phi": phi}
    for leg in (1, 2):
        joint = (
            origin
            + dimensions.platform[leg - 1] * y_axis
            + dimensions.platform_heights[leg - 1] * z_axis
        )
        arm = (
            joint
            - dimensions.base[leg - 1] * along
            - dimensions.universal_offsets[leg - 1] * radial
        )
        across, outward = arm[..., 1], (arm * radial).sum(axis=-1)
        values[f"q{leg}"] = np.hypot(across, outward)
        values[f"th{leg}"] = np.arctan2(-across, outward)
    values["ps1"] = wrap_angles(beta - values["th1"])
    values["ps2"] = values["th1"] + values["ps1"] - values["th2"]
    arm = origin + dimensions.platform[2] * normal - np.array([dimensions.base[2], 0.0, 0.0])
    values |= _third_leg(arm, normal, y_axis)
    states = np.zeros((*phi.shape, len(mechanism.coordinates)))
    for name, value in values.items():
        states[..., mechanism.index(name)] = value
    states[~np.asarray(np.isfinite(states).all(axis=-1))] = np.nan
    return states


def condition_numbers(mechanism: Mechanism, states: FloatArray) -> FloatArray:
    """Return the condition number ``(...)`` of the map from leg speeds to the velocity of the wrist
    centre; all lengths, so it has no unit.
    """
    finite = np.asarray(np.isfinite(states).all(axis=-1))
    finite_states = np.where(finite[..., None], states, 1.0)
    kinematics = evaluate_kinematics(mechanism, finite_states)
    closures = kinematics.closure_jacobian
    sizes = np.linalg.svd(closures[..., mechanism.passive_slice], compute_uv=False)
    regular = finite & (sizes[..., -1] > SINGULAR * sizes[..., 0])
    passive = np.where(
        regular[..., None, None], closures[..., mechanism.passive_slice], np.eye(closures.shape[-2])
    )
    legs = slice(0, len(LENGTHS))
    follow = -np.linalg.solve(passive, closures[..., legs])
    center = kinematics.of_position[..., mechanism.markers.index("wrist_4"), :, :]
    motion = center[..., legs] + center[..., mechanism.passive_slice] @ follow
    sizes = np.linalg.svd(motion, compute_uv=False)
    lost = ~regular | (sizes[..., -1] <= SINGULAR * sizes[..., 0])
    return np.where(lost, np.inf, sizes[..., 0] / np.where(lost, 1.0, sizes[..., -1]))


def name_limit_faults(machine: MountedExechon, state: FloatArray) -> list[str]:
    """Return a text for each coordinate beyond its limits at a state."""
    faults = []
    for name, (low, high) in machine.limits.items():
        value = float(state[machine.mechanism.index(name)])
        if not low <= value <= high:
            scale, unit = (1e3, "mm") if name in LENGTHS else (180.0 / np.pi, "deg")
            faults.append(
                f"{name} would be {scale * value:.4g} {unit}, outside {scale * low:.4g} to {scale * high:.4g} {unit}"
            )
    return faults


def _wrist_center(
    machine: MountedExechon, points: FloatArray, directions: FloatArray
) -> FloatArray:
    return (
        points - machine.dimensions.tool_length * directions - machine.mounting.origin
    ) @ machine.mounting.rotation


def _require_reach(machine: MountedExechon, center: FloatArray, tool_point: str) -> None:
    aside, distance = abs(machine.dimensions.wrist[0]), float(np.hypot(center[0], center[2]))
    if distance < aside:
        raise UnreachablePoseError(
            f"{tool_point}: the wrist centre would be {1e3 * distance:.4g} mm from the common axis of legs 1 and 2, and comes no closer than"
            f" {1e3 * aside:.4g} mm"
        )
    if distance - aside <= SINGULAR:
        raise SingularPoseError(
            f"{tool_point}: the wrist centre is on the common axis of legs 1 and 2, whose plane may turn freely"
        )


def _plane_and_platform(
    dimensions: ExechonDimensions, center: FloatArray, assembly: Assembly
) -> tuple[FloatArray, FloatArray]:
    distance = np.hypot(center[..., 0], center[..., 2])
    near = distance - abs(dimensions.wrist[0]) <= SINGULAR
    ratio = dimensions.wrist[0] / np.where(near, np.inf, distance)
    lean = np.arcsin(ratio)
    phi = wrap_angles(
        np.arctan2(center[..., 0], center[..., 2]) - (lean if assembly[0] > 0 else np.pi - lean)
    )
    outward = (
        center[..., 0] * np.sin(phi)
        + center[..., 2] * np.cos(phi)
        - dimensions.base[2] * np.sin(phi)
    )
    free = np.hypot(center[..., 1], outward) <= SINGULAR
    beta = (
        -np.arctan2(center[..., 1], outward)
        if assembly[1] > 0
        else wrap_angles(np.pi - np.arctan2(center[..., 1], outward))
    )
    return np.where(near, np.nan, phi), np.where(free, np.nan, beta)


def _third_leg(arm: FloatArray, x_axis: FloatArray, y_axis: FloatArray) -> dict[str, FloatArray]:
    length = np.sqrt((arm**2).sum(axis=-1))
    x, y, z = (arm[..., i] / length for i in range(3))
    a2 = np.where(np.hypot(y, z) > SINGULAR, np.arcsin(np.clip(x, -1.0, 1.0)), np.nan)
    a1 = np.arctan2(-y, z)
    # the platform's y axis, seen before the twist a3: (-sin a3, cos a3, 0)
    first = np.stack([np.cos(a2), np.sin(a1) * np.sin(a2), -np.cos(a1) * np.sin(a2)], -1)
    second = np.stack([np.zeros_like(a1), np.cos(a1), np.sin(a1)], -1)
    a3 = np.arctan2(-(first * y_axis).sum(axis=-1), (second * y_axis).sum(axis=-1))
    side = np.cos(a3)[..., None] * first + np.sin(a3)[..., None] * second
    down = np.stack([x, y, z], -1)
    ps3 = np.arctan2(-(down * x_axis).sum(axis=-1), (side * x_axis).sum(axis=-1))
    return {"q3": length, "a1": a1, "a2": a2, "a3": a3, "ps3": ps3}


# the axes of a tool pose: place of the tool point, and turns of the tool about the machine's x and
# y
TOOL_AXES = ("X", "Y", "Z", "A", "B")
TOOL_POINT, TOOL_TURNS = TOOL_AXES[:3], TOOL_AXES[3:]


@dataclass(frozen=True, eq=False)
class ToolMechanism:
    """A mounted mechanism, its tool and what it carries.

    Attributes:
        mounted: Dimensions, place and limits.
        tool: ``(3,)`` direction of the tool in the machine frame where a pose does not turn it.
        carries: Component to the marker of the mechanism it is fixed to; its placement is relative
            to
            that marker.
    """

    mounted: MountedExechon
    tool: FloatArray
    carries: Mapping[str, str]


def tool_pose(
    mechanism: ToolMechanism, positions: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the tool point ``(3,)`` [m] and direction ``(3,)`` of a pose, machine frame; A and B
    turn the tool about x, then about y.
    """
    point = np.array([positions.get(axis, 0.0) for axis in TOOL_POINT])
    direction = mechanism.tool
    for axis, about in zip(TOOL_TURNS, ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), strict=True):
        direction = rotation_about(np.array(about), positions.get(axis, 0.0)) @ direction
    return point, direction


def solve_pose(mechanism: ToolMechanism, positions: Mapping[str, float]) -> FloatArray:
    """Return the coordinates ``(n,)`` of the mechanism in a pose.

    Raises:
        PoseError: The pose is out of reach, singular or beyond a joint's limits.
    """
    point, direction = tool_pose(mechanism, positions)
    return solve_tool_pose(mechanism.mounted, point, direction)


def place_carriers(mechanism: ToolMechanism, positions: Mapping[str, float]) -> dict[str, Frame]:
    """Return the frame of the marker under every carried component in the machine frame, in a pose.

    Raises:
        PoseError: The pose is out of reach, singular or beyond a joint's limits.
    """
    mounted = mechanism.mounted.mechanism
    placed = place_markers(mounted, solve_pose(mechanism, positions))
    places = {name: mounted.markers.index(marker) for name, marker in mechanism.carries.items()}
    return {
        name: compose_frames(
            mechanism.mounted.mounting, Frame(placed.positions[place], placed.rotations[place])
        )
        for name, place in places.items()
    }
