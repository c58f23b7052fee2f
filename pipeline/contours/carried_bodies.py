"""Bodies that a mechanism carries while its tool goes along a path without turning: how each moves
as a rigid one.
"""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.tool_mechanism import ToolMechanism
from headstock.pipeline.stages.run_state import MachineParts
from headstock.solvers.milling.path_drives import move_markers
from headstock.solvers.milling.tool_path import PathPoints


def move_bodies(
    mechanism: ToolMechanism,
    parts: MachineParts,
    times: FloatArray,
    path: PathPoints,
    direction: FloatArray,
    *,
    velocity_terms: bool,
) -> dict[str, FloatArray]:
    """Acceleration of each body that is carried ``(n, 6)``, machine axes: of its centre of mass, and
    about it as fast as Euler's moment of its turning asks for.

    Args:
        mechanism: That carries the bodies.
        parts: Of the machine.
        times: ``(n,)`` [s].
        path: Of the tool point then.
        direction: ``(3,)`` of the tool, machine frame.
        velocity_terms: Whether bodies are accelerated by speeds, too.

    Raises:
        PoseError: The path cannot be followed.
    """
    mounted, found = mechanism.mounted, {}
    moved = move_markers(mounted, times, path, direction, velocity_terms=velocity_terms)
    turn = mounted.mounting.rotation
    for name, marker in mechanism.carries.items():
        if name not in parts.reduced:
            continue
        place = mounted.mechanism.markers.index(marker)
        body, own = parts.superelements[name], parts.plan.components[name].placement
        rotation = moved.rotations[:, place]
        arm = rotation @ (own.origin + own.rotation @ body.center_of_mass)
        omega, alpha = moved.omega[:, place], moved.alpha[:, place]
        # Euler's moment of a body that turns: as if it were accelerated faster
        axes = rotation @ own.rotation
        inertia = axes @ body.inertia @ np.swapaxes(axes, -1, -2)
        moment = np.cross(omega, (inertia @ omega[..., None])[..., 0])
        spin = alpha + np.linalg.solve(inertia, moment[..., None])[..., 0]
        center = (
            moved.acceleration[:, place]
            + np.cross(alpha, arm)
            + np.cross(omega, np.cross(omega, arm))
        )
        found[name] = np.concatenate([center @ turn.T, spin @ turn.T], axis=1)
    return found
