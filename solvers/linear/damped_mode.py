"""One complex mode of a damped system, followed from its undamped one; structural damping stays as it
is.
"""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

STEPS = 30
SETTLED = 1e-12  # of the pole
ROUNDING = 1e-8  # of the pole: what steps may stop at that grow no smaller, with very stiff joints


@dataclass(frozen=True, eq=False)
class DampedMode:
    """A solution of ``(s^2 M + s C + K + i H) x = 0``.

    Attributes:
        pole: ``s`` above the real axis [rad/s].
        shape: ``(n,)`` with ``x^T (2 s M + C) x = 1``.
    """

    pole: complex
    shape: ComplexArray

    @property
    def ratio(self) -> float:
        """Damping ratio."""
        return -self.pole.real / abs(self.pole)

    def slope_ratio(self, slope: complex) -> float:
        """Return the derivative of the damping ratio for one of the pole [rad/s]."""
        size = abs(self.pole)
        growth = (self.pole.conjugate() * slope).real / size
        return -slope.real / size - self.ratio * growth / size


def follow_damped_mode(system: SecondOrderSystem, omega: float, shape: FloatArray) -> DampedMode:
    """Find the complex mode that an undamped one becomes.

    Args:
        system: Its matrices are symmetric, ``(n, n)``.
        omega: Undamped natural frequency [rad/s].
        shape: ``(n,)`` its mass-normalised shape.

    Raises:
        ConvergenceError: It is too strongly damped to be followed.

    Source: Ruhe (1973), Newton's method for the nonlinear eigenproblem.
    """
    size = len(shape)
    damping = np.zeros((size, size)) if system.damping is None else system.damping
    lossy = 0.0 if system.hysteretic is None else float(shape @ system.hysteretic @ shape)
    # what a lightly damped mode loses, to first order
    loss = float(shape @ damping @ shape) + lossy / omega
    pole, motion = 1j * omega - 0.5 * loss, shape.astype(np.complex128)
    border = system.mass @ shape
    bordered = np.zeros((size + 1, size + 1), dtype=np.complex128)
    before = np.inf
    for _ in range(STEPS):
        dynamic = system.dynamic_stiffness(pole)
        weighed = 2.0 * pole * (system.mass @ motion) + damping @ motion
        # unknowns of one scale: the pole in units of omega, the border in that of a stiffness
        scale = np.abs(dynamic.diagonal()).mean() / max(
            np.linalg.norm(border), np.finfo(float).tiny
        )
        bordered[:size, :size], bordered[:size, size] = dynamic, omega * weighed
        bordered[size, :size] = scale * border
        step = np.linalg.solve(bordered, np.append(-dynamic @ motion, 0.0))
        motion, pole = motion + step[:size], pole + omega * complex(step[size])
        change = abs(omega * step[size]) / abs(pole)
        if change <= SETTLED or before <= change <= ROUNDING:
            break
        before = change
    else:
        raise ConvergenceError(
            f"the mode at {omega / (2.0 * np.pi):.6g} Hz cannot be followed to its damped form: it is damped too strongly; "
            "lower the upper bound of a damping"
        )
    weight = motion @ (2.0 * pole * (system.mass @ motion) + damping @ motion)
    return DampedMode(pole, motion / np.sqrt(weight))


def slope_damped_shape(
    system: SecondOrderSystem, mode: DampedMode, forces: ComplexArray
) -> ComplexArray:
    """Return the derivatives ``(n, p)`` of a damped mode, up to a multiple of the mode itself.

    Args:
        system: Its matrices are symmetric, ``(n, n)``.
        forces: ``(n, p)`` derivatives of ``(s^2 M + s C + K + i H)`` times the mode, ``s`` as it is.
    """
    size = len(mode.shape)
    damping = 0.0 if system.damping is None else system.damping @ mode.shape
    weighed = 2.0 * mode.pole * (system.mass @ mode.shape) + damping
    dynamic = system.dynamic_stiffness(mode.pole)
    scale = np.abs(dynamic.diagonal()).mean()
    bordered = np.zeros((size + 1, size + 1), dtype=np.complex128)
    bordered[:size, :size] = dynamic
    bordered[:size, size] = scale * weighed / np.linalg.norm(weighed)
    bordered[size, :size] = scale * mode.shape.conj() / np.linalg.norm(mode.shape)
    loads = np.vstack([-forces, np.zeros((1, forces.shape[1]))])
    return np.asarray(np.linalg.solve(bordered, loads)[:size])
