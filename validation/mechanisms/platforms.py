"""Other parallel platforms as data: the planar 3-RPR, the Tricept and the Gough-Stewart hexapod."""

from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.mechanism import (
    AxisName,
    ChainItem,
    Closure,
    CoordinateConstraint,
    Marker,
    Mechanism,
    PointConstraint,
    prismatic,
    revolute,
    wrap_angles,
)

PLANAR: tuple[AxisName, ...] = ("x", "y")
ON_CIRCLE = 1e-6


def planar_3rpr(base: FloatArray, platform: FloatArray) -> Mechanism:
    """Return a triangle on three telescopic legs in the xy plane, each with a lumped compliance
    ``d_i`` along it.

    Args:
        base: ``(3, 2)`` joints on the ground [m].
        platform: ``(3, 2)`` joints on the platform, in its own frame [m].
    """
    chains: list[tuple[ChainItem, ...]] = []
    closures: list[Closure] = []
    for leg in (1, 2, 3):
        anchor, joint = base[leg - 1], platform[leg - 1]
        chain: tuple[ChainItem, ...] = (
            prismatic("x", float(anchor[0])), prismatic("y", float(anchor[1])), revolute("z", f"th{leg}"), Marker(f"leg_{leg}"),
            prismatic("x", f"q{leg}"), prismatic("x", f"d{leg}"), Marker(f"joint_{leg}"), revolute("z", f"ps{leg}"),
            prismatic("x", -float(joint[0])), prismatic("y", -float(joint[1])), Marker(f"platform_{leg}"),
        )  # fmt: skip
        chains.append(chain)
        if leg > 1:
            closures += [
                PointConstraint("platform_1", f"platform_{leg}", PLANAR),
                CoordinateConstraint({"th1": 1.0, "ps1": 1.0, f"th{leg}": -1.0, f"ps{leg}": -1.0}),
            ]
    return Mechanism(
        "planar 3-RPR", tuple(chains), tuple(closures), ("q1", "q2", "q3"), ("d1", "d2", "d3")
    )


def planar_3rpr_state(
    base: FloatArray, platform: FloatArray, place: Sequence[float], angle: float
) -> FloatArray:
    """Return all coordinates of a planar 3-RPR whose platform frame is at a place [m] and turned by
    an angle [rad].

    Args:
        base: Base joints, ``(3, 2)`` [m].
        platform: Platform joints in the platform frame, ``(3, 2)`` [m].
        place: Of the platform frame, x and y [m].
        angle: By which it is turned [rad].
    """
    mechanism = planar_3rpr(base, platform)
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    legs = np.asarray(place) + platform @ turned.T - base
    directions = np.arctan2(legs[:, 1], legs[:, 0])
    values = {
        "th": directions,
        "q": np.hypot(legs[:, 0], legs[:, 1]),
        "ps": wrap_angles(angle - directions),
        "d": np.zeros(3),
    }
    # the coordinate constraints compare plain sums of angles, so all legs count the same turns
    values["ps"] += angle - directions - values["ps"]
    return np.array([values[name[:-1]][int(name[-1]) - 1] for name in mechanism.coordinates])


def planar_3rpr_assemblies(
    base: FloatArray, platform: FloatArray, lengths: FloatArray
) -> list[tuple[float, float, float]]:
    """Return every pose (x, y, angle) of the platform frame at given leg lengths ``(3,)``, at most
    six.

    With the first platform joint as origin the differences of the leg equations are linear in its
    place; what is left is a trigonometric polynomial of degree three in the angle (Gosselin,
    Sefrioui and Richard 1992), found here from seven samples.

    Args:
        base: Base joints, ``(3, 2)`` [m].
        platform: Platform joints in the platform frame, ``(3, 2)`` [m].
        lengths: Of the legs, ``(3,)`` [m].
    """
    local = platform - platform[0]

    def place(angle: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
        x = cos * local[:, 0] - sin * local[:, 1] - base[:, 0]
        y = sin * local[:, 0] + cos * local[:, 1] - base[:, 1]
        sums = (x**2 + y**2 - lengths**2) / 2.0
        a, b, c = ((part[:, 1:] - part[:, :1]) for part in (x, y, sums))
        across = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        return (
            -(c[:, 0] * b[:, 1] - c[:, 1] * b[:, 0]),
            -(a[:, 0] * c[:, 1] - a[:, 1] * c[:, 0]),
            across,
        )

    samples = np.array([2.0 * np.pi * number / 7.0 for number in range(7)])
    px, py, d = place(samples)
    first = (px - d * base[0, 0]) ** 2 + (py - d * base[0, 1]) ** 2 - (d * lengths[0]) ** 2
    harmonics = np.fft.fft(first)[[3, 2, 1, 0, 6, 5, 4]]
    roots = np.roots(harmonics)
    angles = np.sort(np.angle(roots[np.abs(np.abs(roots) - 1.0) < ON_CIRCLE]))
    px, py, d = place(angles)
    shift_x = np.cos(angles) * platform[0, 0] - np.sin(angles) * platform[0, 1]
    shift_y = np.sin(angles) * platform[0, 0] + np.cos(angles) * platform[0, 1]
    return [
        (float(x), float(y), float(t))
        for x, y, t in zip(px / d - shift_x, py / d - shift_y, angles, strict=True)
    ]


def hexapod(base: FloatArray, platform: FloatArray) -> Mechanism:
    """Return a platform on six telescopic legs (6-UPS).

    Args:
        base: ``(6, 3)`` universal joints on the ground [m].
        platform: ``(6, 3)`` spherical joints on the platform, in its own frame [m].
    """
    free: tuple[ChainItem, ...] = (
        prismatic("x", "x"), prismatic("y", "y"), prismatic("z", "z"),
        revolute("x", "rx"), revolute("y", "ry"), revolute("z", "rz"), Marker("platform"),
    )  # fmt: skip
    return _on_telescopic_legs("hexapod", free, base, platform)


def tricept(base: FloatArray, platform: FloatArray) -> Mechanism:
    """Return a platform on a central telescope behind a universal joint (UP), moved by three
    telescopic legs (UPS).

    Args:
        base: ``(3, 3)`` universal joints on the ground [m].
        platform: ``(3, 3)`` spherical joints on the platform, in its own frame [m].
    """
    center: tuple[ChainItem, ...] = (
        revolute("x", "rx"),
        revolute("y", "ry"),
        prismatic("z", "z"),
        Marker("platform"),
    )
    return _on_telescopic_legs("Tricept", center, base, platform)


def _on_telescopic_legs(
    name: str, center: tuple[ChainItem, ...], base: FloatArray, platform: FloatArray
) -> Mechanism:
    """Return a platform at the end of a chain, moved by legs with their joints ``(n, 3)`` on the
    ground and on the platform [m].
    """
    numbers = range(1, len(base) + 1)
    carried = [
        item
        for number, joint in zip(numbers, platform, strict=True)
        for item in _joint_there_and_back(number, joint)
    ]
    legs = [_telescopic_leg(number, joint) for number, joint in zip(numbers, base, strict=True)]
    closures = tuple(PointConstraint(f"foot_{number}", f"tip_{number}") for number in numbers)
    lengths = tuple(f"q{number}" for number in numbers)
    return Mechanism(name, ((*center, *carried), *legs), closures, lengths)


def _joint_there_and_back(number: int, joint: FloatArray) -> tuple[ChainItem, ...]:
    x, y, z = (float(value) for value in joint)
    there: tuple[ChainItem, ...] = (
        prismatic("x", x),
        prismatic("y", y),
        prismatic("z", z),
        Marker(f"foot_{number}"),
    )
    return (*there, prismatic("x", -x), prismatic("y", -y), prismatic("z", -z))


def _telescopic_leg(number: int, joint: FloatArray) -> tuple[ChainItem, ...]:
    x, y, z = (float(value) for value in joint)
    return (
        prismatic("x", x), prismatic("y", y), prismatic("z", z),
        revolute("x", f"al{number}"), revolute("y", f"be{number}"), prismatic("z", f"q{number}"),
        Marker(f"tip_{number}"),
    )  # fmt: skip
