"""Friction of a guide: Coulomb with a Stribeck curve and a viscous part, smooth through zero velocity."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import GuideFriction


def friction_force(law: GuideFriction, velocity: FloatArray) -> FloatArray:
    """Force against the motion [N].

    Source: Armstrong-Helouvry, Dupont and Canudas de Wit (1994), A survey of models, section 2.1 (Stribeck curve with a Gaussian);
        the sign of the velocity is smoothed to a tanh.
    """
    return np.asarray(_level(law, velocity) * np.tanh(velocity / law.smoothing) + law.viscous * velocity)


def friction_slope(law: GuideFriction, velocity: FloatArray) -> FloatArray:
    """Derivative of the force by the velocity [N s/m]; negative where friction falls with speed."""
    bend = np.tanh(velocity / law.smoothing)
    falling = -2.0 * velocity / law.stribeck_speed**2 * (_level(law, velocity) - law.coulomb)
    return np.asarray(falling * bend + _level(law, velocity) * (1.0 - bend**2) / law.smoothing + law.viscous)


def _level(law: GuideFriction, velocity: FloatArray) -> FloatArray:
    """Size of the dry part [N]."""
    return np.asarray(law.coulomb + (law.breakaway - law.coulomb) * np.exp(-((velocity / law.stribeck_speed) ** 2)))
