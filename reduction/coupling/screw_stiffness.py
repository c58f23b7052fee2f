"""The stiffness of a ball screw with its nut anywhere between the bearings."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Joint, ScrewShaft
from headstock.solvers.errors import ModelError


@dataclass(frozen=True, eq=False)
class ScrewSpring:
    """What a ball screw is at one place of its nut.

    Attributes:
        stiffness: ``(6, 6)`` between nut and bearings in joint axes, x along the screw.
        far_share: Part of the nut's axial force that goes to the far bearing, 0..1.
    """

    stiffness: FloatArray
    far_share: float


def place_screw(joint: Joint, shaft: ScrewShaft, distance: float) -> ScrewSpring:
    """Nut, shaft, bearings and coupling in series; both sides of a shaft with two fixed bearings in parallel.

    With the motor held, an axial force F on the nut twists the shaft by F p a / (G J), p = lead / (2 pi), a the distance, which gives
    way by p times that; and the nut may turn about the shaft as it moves along the thread. The compliance along the thread is

        1 / k_nut + 1 / (k_near + k_far) + p^2 (a / (G J) + 1 / k_coupling)

    with ``1 / k_near = 1 / k_bearing + a / (E A)`` and the same for the rest of the shaft.

    Args:
        joint: Its stiffness holds the nut's: axial, and about the axis if it has one.
        shaft: Its shaft.
        distance: From the fixed bearing to the nut [m].

    Raises:
        ModelError: The nut stands at or beyond a bearing.

    Source: ISO 3408-4 (2006), static axial rigidity; Altintas, Verl, Brecher, Uriarte and Pritschow (2011), section 2.2, for the twist.
    """
    if not 0.0 < distance < shaft.length:
        where = "at its bearing" if distance <= 0.0 else f"{1e3 * distance:.6g} mm from it, beyond the far one"
        raise ModelError(
            f"joint {joint.name!r}: the nut stands {where}; name the nut's interface first and the bearing's second, and keep the axis "
            "between the bearings"
        )
    near = 1.0 / (1.0 / shaft.bearing + distance / shaft.axial)
    far = 0.0 if shaft.far is None else 1.0 / (1.0 / shaft.far_bearing + (shaft.length - distance) / shaft.axial)
    pitch = shaft.lead / (2.0 * np.pi)
    twist = distance / shaft.torsional
    compliance = 1.0 / joint.stiffness[0, 0] + 1.0 / (near + far) + pitch**2 * (twist + 1.0 / shaft.coupling)
    thread = np.array([1.0, 0.0, 0.0, -pitch, 0.0, 0.0])
    stiffness = np.array(joint.stiffness, dtype=float)
    stiffness[0, 0] = 0.0
    if stiffness[3, 3] != 0.0:
        stiffness[3, 3] = 1.0 / (1.0 / stiffness[3, 3] + twist)
    return ScrewSpring(stiffness + np.outer(thread, thread) / compliance, far / (near + far))
