"""Drives under control on a linear system along a path: motors are coordinates of it, and the
states of their controllers rows of first order.

Coordinates are deviations from the rigid machine that moves as the set points say, so a controller
sees what its motor lacks: with set speed ``v`` and acceleration ``a`` its inputs are ``(0, v, a, x,
v + x')``, and the force that the rigid motion needs is a load on its motor.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import AxisControl
from headstock.solvers.control.dead_time import LinearBlock, stack_blocks
from headstock.solvers.control.drive_loops import make_controller
from headstock.solvers.paths.linear_motion import CompliantHistory, LinearMotion

INPUTS = 5  # of a controller: set position, speed, acceleration, measured position, motor speed
SPEED, ACCELERATION, POSITION, MOTOR_SPEED = 1, 2, 3, 4


@dataclass(frozen=True, eq=False)
class ServoMotion:
    """A machine along its trajectory with the loops of its drives closed.

    Attributes:
        motion: Its coordinates are those of the machine, then motors, then controllers.
        motors: Where motors stand among them.
        control: All controllers, one below the other.
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        reads: ``(k, d, c + d)`` at the nodes: what the position controllers read per coordinate.
        beside: ``(n, d)`` what they read beside that.
    """

    motion: LinearMotion
    motors: slice
    control: LinearBlock
    speeds: FloatArray
    accelerations: FloatArray
    reads: FloatArray
    beside: FloatArray

    def read(self, history: CompliantHistory) -> FloatArray:
        """What the position controllers read beside their set points ``(n, d)`` [m]."""
        states = history.compliant[:, : self.motors.stop]
        reads = self.motion.between(self.reads, slice(None))
        return np.asarray((reads @ states[..., None])[..., 0] + self.beside)

    def forces(self, history: CompliantHistory) -> FloatArray:
        """Forces of the drives ``(n, d)`` [N]."""
        count, states = self.speeds.shape[1], history.compliant
        read = self.read(history)
        given = np.zeros((len(states), count, INPUTS))
        given[:, :, SPEED], given[:, :, ACCELERATION] = self.speeds, self.accelerations
        given[:, :, POSITION] = read
        given[:, :, MOTOR_SPEED] = self.speeds + history.rate[:, self.motors]
        flat = given.reshape(len(states), -1)
        return np.asarray(
            states[:, self.motors.stop :] @ self.control.c.T + flat @ self.control.d.T
        )


def close_motors(
    free: LinearMotion,
    controls: Sequence[AxisControl],
    *,
    speeds: FloatArray,
    accelerations: FloatArray,
    gravity: FloatArray,
    scales: FloatArray,
    beside: FloatArray | None = None,
) -> ServoMotion:
    """Close the loops of drives along a path.

    Args:
        free: The machine with free motors, its last ``d`` coordinates; its load is that of the rigid
            motion, so on the motors what it takes of their drives, with the sign turned.
        controls: Of the ``d`` drives.
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        gravity: ``(k, c + d)`` generalised weight at the nodes [N].
        scales: ``(k, d, c + d)`` what a linear scale reads per coordinate.
        beside: ``(n, d)`` what it reads beside that; None for nothing.
    """
    count, size = len(controls), free.mass.shape[-1]
    block = stack_blocks([make_controller(control) for control in controls])
    own = len(block.a)
    motors, states = slice(size - count, size), slice(size, size + own)
    columns = INPUTS * np.arange(count)
    seen, turned = columns + POSITION, columns + MOTOR_SPEED
    at_motor = np.zeros((count, size))
    at_motor[:, motors] = np.eye(count)
    on_scale = np.array([control.encoder == "scale" for control in controls])
    reads = np.where(on_scale[:, None], scales, at_motor)
    nodes, whole = len(free.nodes), size + own
    mass, damping, stiffness = (np.zeros((nodes, whole, whole)) for _ in range(3))
    mass[:, :size, :size], damping[:, :size, :size] = free.mass, free.damping
    stiffness[:, :size, :size] = free.stiffness
    # force = c z + d (inputs), z' = a z + b (inputs): rows of the motors and of the states
    damping[:, motors, motors] -= block.d[:, turned]
    damping[:, states, motors] = -block.b[:, turned]
    damping[:, states, states] = np.eye(own)
    stiffness[:, motors, :size] -= block.d[:, seen] @ reads
    stiffness[:, motors, states] = -block.c
    stiffness[:, states, :size] = -block.b[:, seen] @ reads
    stiffness[:, states, states] = -block.a
    read: FloatArray = np.zeros((len(free.times), count))
    if beside is not None:
        read = np.asarray(np.where(on_scale, beside, read))
    given = np.zeros((len(free.times), count, INPUTS))
    given[:, :, SPEED], given[:, :, MOTOR_SPEED] = speeds, speeds
    given[:, :, ACCELERATION], given[:, :, POSITION] = accelerations, read
    flat = given.reshape(len(free.times), -1)
    load = np.zeros((len(free.times), whole))
    load[:, :size] = free.load
    load[:, motors] += flat @ block.d.T
    load[:, states] = flat @ block.b.T
    weight = np.zeros((nodes, whole))
    weight[:, :size] = gravity
    motion = dataclasses.replace(
        free,
        mass=mass,
        damping=damping,
        stiffness=stiffness,
        tool=np.concatenate([free.tool, np.zeros((nodes, 3, own))], axis=-1),
        gravity_deflection=np.asarray(np.linalg.solve(stiffness, weight[..., None])[..., 0]),
        load=load,
    )
    return ServoMotion(motion, motors, block, speeds, accelerations, reads, read)
