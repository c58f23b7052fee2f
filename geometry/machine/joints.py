"""Joints between interfaces, and the axes that move one side of them."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.guide_errors import AxisErrors, RailErrors

JointKind = Literal[
    "rigid",
    "spring",
    "linear_guide",
    "ball_screw",
    "bolted",
    "bearing",
    "mount",
    "revolute",
    "universal",
    "spherical",
    "prismatic",
]
GROUND = "ground"


@dataclass(frozen=True)
class JointEnd:
    """One end of a joint: an interface of a component, or ground (both None)."""

    component: str | None = None
    interface: str | None = None

    def __str__(self) -> str:
        return GROUND if self.component is None else f"{self.component}.{self.interface}"


@dataclass(frozen=True)
class ScrewShaft:
    """The shaft of a ball screw, from the fixed bearing at the joint's second end to the nut at its
    first.

    Attributes:
        axial: Young's modulus times area [N].
        torsional: Shear modulus times polar second moment of area [N m^2].
        lead: Travel per turn [m]; zero where the shaft's twist is not to be seen.
        bearing: Axial stiffness of the fixed bearing [N/m].
        coupling: Torsional stiffness between the shaft and the motor, which is locked [N m/rad].
        floating_end: Interface up to which the shaft's free length is measured; None for the bearing's
            own.
        second_end: A second fixed bearing, at the shaft's other end; None where that end floats.
        second_bearing: Its axial stiffness [N/m].
        length: Of the shaft between both bearings [m]; infinite without a second one.
    """

    axial: float
    torsional: float
    lead: float = 0.0
    bearing: float = np.inf
    coupling: float = np.inf
    floating_end: JointEnd | None = None
    second_end: JointEnd | None = None
    second_bearing: float = np.inf
    length: float = np.inf


@dataclass(frozen=True)
class ContactLayer:
    """Stiffness per area between two patches, of bolted or glued faces.

    Attributes:
        normal: Across the faces [N/m^3].
        shear: Along the faces [N/m^3].
        covers: Size of the area that it covers over that of the patches, about their centre.
    """

    normal: float
    shear: float
    covers: float = 1.0


@dataclass(frozen=True, eq=False)
class Joint:
    """Two ends that are coupled in a joint frame: each direction is fixed, free or a spring.

    The joint point is ``point`` (machine frame, zero axis positions) or else the frame origin of
    the first end that is neither ground nor a rail; it moves with that end's component. Both ends
    are carried to it by rigid levers. A carriage of a given length is coupled to its rail
    next to the joint point, at the position of the pose.

    Attributes:
        kind: What the scene called it.
        rotation: ``(3, 3)`` joint axes in the machine frame, all fixed to the body that carries the
            joint point.
        second_axis: ``(3,)`` axis of a universal joint that is fixed to its second end, as
            ``rotation``'s x axis is to its first; the joint's z axis lies closest to it in every
            pose. None for other joints.
        fixed: Joint dofs (0..5 for x y z rx ry rz of the joint frame) that are eliminated: no
            relative motion.
        stiffness: ``(6, 6)`` stiffness between the ends in the joint frame [N/m, N m/rad], zero on
            fixed dofs.
        damping: ``(6, 6)`` viscous damping in the joint frame [N s/m, N m s/rad].
        point: ``(3,)`` joint point [m] or None.
        length: Length of the carriage on a rail [m]; None for a joint between fixed interfaces.
        screw: Shaft between the ends of a ball screw, in series with its nut: the stiffness changes
            with the axis position.
        loss_factor: Structural damping eta: the complex stiffness is ``(1 + i eta)`` times the
            stiffness [-].
        layer: Stiffness per area over the patches of both ends, in addition to ``stiffness``; None
        without. errors: Of the rail or the screw it slides along; None without.
        soft: It is meant to deflect visibly under the weight that it carries.
    """

    name: str
    ends: tuple[JointEnd, JointEnd]
    kind: JointKind
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    fixed: tuple[int, ...] = ()
    stiffness: FloatArray = field(default_factory=lambda: np.zeros((6, 6)))
    damping: FloatArray = field(default_factory=lambda: np.zeros((6, 6)))
    point: FloatArray | None = None
    length: float | None = None
    screw: ScrewShaft | None = None
    loss_factor: float = 0.0
    second_axis: FloatArray | None = None
    layer: ContactLayer | None = None
    errors: RailErrors | None = None
    soft: bool = False

    @property
    def connects(self) -> bool:
        """Return whether it transmits any force: something is fixed or sprung."""
        return bool(self.fixed) or bool(np.any(self.stiffness)) or self.layer is not None


@dataclass(frozen=True, eq=False)
class Axis:
    """A machine axis: its position slides (or turns) every body on the far side of its joints.

    Attributes:
        joints: Names of the joints across which it moves (guides and drive).
        moves: Names of the components it carries, worked out from the joint graph or given.
        direction: ``(3,)`` unit vector in the machine frame.
        kind: ``linear`` [m] or ``rotary`` [rad].
        center: ``(3,)`` point on a rotary axis [m].
        limits: Lowest and highest position [m or rad].
        errors: Error motions of what it moves; None without.
    """

    name: str
    joints: tuple[str, ...]
    moves: tuple[str, ...]
    direction: FloatArray
    kind: Literal["linear", "rotary"] = "linear"
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    limits: tuple[float, float] = (-np.inf, np.inf)
    errors: AxisErrors | None = None


def connected_groups(names: Iterable[str], edges: Iterable[tuple[str, str]]) -> list[list[str]]:
    """Return the groups of what edges connect, directly or by way of others.

    Args:
        names: All there are, in the order in which groups and their members are listed; names of
            their other edges come last.
    """
    group_of = {name: [name] for name in names}
    for edge in edges:
        small, large = sorted((group_of.setdefault(name, [name]) for name in edge), key=len)
        if small is not large:
            large.extend(small)
            group_of.update(dict.fromkeys(small, large))
    number_of = {name: number for number, name in enumerate(group_of)}
    distinct = {id(group): group for group in group_of.values()}
    return [sorted(group, key=number_of.__getitem__) for group in distinct.values()]
