"""Errors of guides and drives: profiles along a rail or an axis, and what a carriage averages of
them.

A profile is a function of a position, in metres along a linear axis and in radians about a rotary
one; its values are metres or radians.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray, rotate_dofs

SLACK = 1e-9  # of the extent of a table: rounding of positions


class ProfileError(HeadstockError):
    """A position lies outside what a profile is known for."""


@dataclass(frozen=True)
class Wave:
    """A wave ``amplitude sin(2 pi s / period + phase)``.

    Attributes:
        period: Of the position [m, rad].
        amplitude: Half its height [m, rad].
        phase: At position zero [rad].
    """

    period: float
    amplitude: float
    phase: float = 0.0


class _ProfileIntegrals(NamedTuple):
    """A profile and its first and second antiderivative at positions ``(n,)``."""

    values: FloatArray
    first: FloatArray
    second: FloatArray


@dataclass(frozen=True, eq=False)
class ErrorProfile:
    """The sum of a table, a polynomial and waves.

    Attributes:
        positions: ``(k,)`` of the table, rising; none without one.
        values: ``(k,)`` there, with straight lines between them.
        coefficients: ``(c,)`` of the powers 0, 1, ... of the position over ``scale``.
        scale: Position at which every term of the polynomial is its coefficient.
    """

    positions: FloatArray = field(default_factory=lambda: np.zeros(0))
    values: FloatArray = field(default_factory=lambda: np.zeros(0))
    coefficients: FloatArray = field(default_factory=lambda: np.zeros(0))
    scale: float = 1.0
    waves: tuple[Wave, ...] = ()

    def sample(self, places: FloatArray) -> FloatArray:
        """Return the values ``(n,)`` at positions ``(n,)``.

        Raises:
            ProfileError: A position lies outside the table.
        """
        return self.integrate(places).values

    def integrate(self, places: FloatArray) -> _ProfileIntegrals:
        """Return the values and antiderivatives at positions ``(n,)``.

        Raises:
            ProfileError: A position lies outside the table.
        """
        places = np.asarray(places, dtype=float)
        parts = [self._integrate_polynomial(places)]
        parts += [_integrate_wave(wave, places) for wave in self.waves]
        if len(self.positions):
            parts.append(self._integrate_table(places))
        return _ProfileIntegrals(*(np.sum(each, axis=0) for each in zip(*parts, strict=True)))

    def _integrate_polynomial(self, places: FloatArray) -> _ProfileIntegrals:
        falling = self.coefficients[::-1] if len(self.coefficients) else np.zeros(1)
        arms = places / self.scale
        return _ProfileIntegrals(
            np.polyval(falling, arms),
            self.scale * np.polyval(np.polyint(falling), arms),
            self.scale**2 * np.polyval(np.polyint(falling, 2), arms),
        )

    @cached_property
    def _table_integrals(self) -> tuple[FloatArray, FloatArray]:
        """First and second antiderivative at the positions of the table, zero at its beginning."""
        steps = np.diff(self.positions)
        first = np.concatenate(
            [[0.0], np.cumsum(0.5 * steps * (self.values[1:] + self.values[:-1]))]
        )
        # within a step the first antiderivative is a parabola
        gained = steps * first[:-1] + steps**2 * (self.values[:-1] / 3.0 + self.values[1:] / 6.0)
        return first, np.concatenate([[0.0], np.cumsum(gained)])

    def _integrate_table(self, places: FloatArray) -> _ProfileIntegrals:
        low, high = float(self.positions[0]), float(self.positions[-1])
        slack = SLACK * (high - low)
        outside = places[(places < low - slack) | (places > high + slack)]
        if outside.size:
            raise ProfileError(
                f"position {outside[0]:.6g} lies outside its table, which runs from {low:.6g} to {high:.6g}"
            )
        places = np.clip(places, low, high)
        step = np.clip(np.searchsorted(self.positions, places, side="right") - 1, 0, None)
        step = np.minimum(step, len(self.positions) - 2)
        first, second = self._table_integrals
        slope = np.diff(self.values) / np.diff(self.positions)
        arm, start = places - self.positions[step], self.values[step]
        return _ProfileIntegrals(
            start + slope[step] * arm,
            first[step] + start * arm + slope[step] * arm**2 / 2.0,
            np.asarray(
                second[step] + first[step] * arm + start * arm**2 / 2.0 + slope[step] * arm**3 / 6.0
            ),
        )


def _integrate_wave(wave: Wave, places: FloatArray) -> _ProfileIntegrals:
    number = 2.0 * math.pi / wave.period
    angle = number * places + wave.phase
    value = wave.amplitude * np.sin(angle)
    return _ProfileIntegrals(
        np.asarray(value),
        np.asarray(-wave.amplitude / number * np.cos(angle)),
        np.asarray(-value / number**2),
    )


class _AveragedProfile(NamedTuple):
    """Profile averaged over a carriage at places ``(n,)``: its mean and the slope of the line that
    fits it best.
    """

    mean: FloatArray
    slope: FloatArray


def average_profile(profile: ErrorProfile, places: FloatArray, length: float) -> _AveragedProfile:
    """Return the straight line through a profile under a carriage, by least squares over its
    length.

    Args:
        places: ``(n,)`` middles of the carriage.
        length: Of the carriage; zero for a point, which sees the value and no slope.

    Raises:
        ProfileError: The carriage reaches beyond the table.

    Source: Ekinci and Mayer (2007): carriages average the profile of their rail.
    """
    places = np.asarray(places, dtype=float)
    if length == 0.0:
        return _AveragedProfile(profile.sample(places), np.zeros_like(places))
    after = profile.integrate(places + 0.5 * length)
    before = profile.integrate(places - 0.5 * length)
    mean = (after.first - before.first) / length
    # integral of t e(s + t) over the carriage, by parts
    moment = 0.5 * length * (after.first + before.first) - (after.second - before.second)
    return _AveragedProfile(np.asarray(mean), np.asarray(12.0 / length**3 * moment))


@dataclass(frozen=True, eq=False)
class RailErrors:
    """Errors of the rail, or the screw, that a joint slides along: where it would move its carriage
    to, in joint axes.

    Attributes:
        profiles: Joint dof 0..5 to its profile over the position along the rail.
        length: Over which a carriage averages them [m].
        passing: Joint dof to waves that its balls make as they pass: nothing averages them.
        origin: ``(3,)`` from where positions count on ground, machine frame [m]; on a component it
            is the component's own origin.
    """

    profiles: dict[int, ErrorProfile]
    length: float = 0.0
    passing: dict[int, ErrorProfile] = field(default_factory=dict)
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))

    def offset(self, places: FloatArray) -> FloatArray:
        """Return the motion ``(n, 6)`` of a carriage by its rail, joint axes, at positions
        ``(n,)``.

        Straightness tilts a carriage, too: by the slope of the line that fits it best.

        Raises:
            ProfileError: The carriage reaches beyond a table.
        """
        offsets = np.zeros((len(places), 6))
        for dof, profile in self.profiles.items():
            mean, slope = average_profile(profile, places, self.length)
            offsets[:, dof] += mean
            if dof == 1:
                offsets[:, 5] += slope
            if dof == 2:
                offsets[:, 4] -= slope
        for dof, profile in self.passing.items():
            offsets[:, dof] += profile.sample(places)
        return offsets


@dataclass(frozen=True, eq=False)
class AxisErrors:
    """Error motions of an axis as ISO 230-1 names them: of what it moves, in machine axes.

    Attributes:
        motions: Dof 0..5, EX, EY, EZ, EA, EB and EC, to its profile over the axis' position.
        squareness: ``(3,)`` rotation of the line of motion, EA0, EB0 and EC0 [rad].
        point: ``(3,)`` functional point on what it moves, all axes at zero, machine frame [m]; None
            for the middle of its joints.
        rotation: ``(3, 3)`` axes of the scene in the machine frame, which ``motions`` are along.
    """

    motions: dict[int, ErrorProfile]
    squareness: FloatArray = field(default_factory=lambda: np.zeros(3))
    point: FloatArray | None = None
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))

    def sample(self, positions: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the error motion ``(n, 6)`` of the functional point at positions ``(n,)`` of the
        axis, machine axes.

        Squareness turns the line of motion about position zero; what moves keeps its orientation.

        Args:
            positions: Of the axis [m, rad].
            direction: ``(3,)`` of a linear axis, machine frame; zero for a rotary one.

        Raises:
            ProfileError: A position lies outside a table.
        """
        motion = np.zeros((len(positions), 6))
        for dof, profile in self.motions.items():
            motion[:, dof] = profile.sample(positions)
        turned = motion @ rotate_dofs(self.rotation).T
        turned[:, :3] += np.outer(positions, np.cross(self.rotation @ self.squareness, direction))
        return np.asarray(turned)
