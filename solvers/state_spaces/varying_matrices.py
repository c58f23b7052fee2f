"""Matrices of a system that depend on positions of axes, in one basis for all poses: springs whose rows
are interpolated by cubic splines between knots, never the stiffness itself.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.linalg
from scipy.interpolate import CubicSpline

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

FASTEST = 20.0  # times the highest frequency: motions are no faster, so that time steps stay few
DEPENDENT = 1e-10  # share of energy below which a motion adds nothing to the others
NEGLIGIBLE = 1e-4  # of the largest pattern of damping
CONSTANT = 1e-12  # of the largest entry: a field that changes by less is the same everywhere


class PosedMatrices(NamedTuple):
    """``z'' + C z' + K z = B u``, ``y = L z`` at positions of the axes.

    Attributes:
        stiffness: ``(m, m)``.
        damping: ``(m, m)``.
        loads: ``(m, k)``.
        rows: ``(p, m)``.
    """

    stiffness: FloatArray
    damping: FloatArray
    loads: FloatArray
    rows: FloatArray


class PosedSpring(NamedTuple):
    """A joint in coordinates of unit mass.

    Attributes:
        rows: ``(r, m)``.
        stiffness: ``(r, r)``.
        damping: ``(r, r)`` viscous.
    """

    rows: FloatArray
    stiffness: FloatArray
    damping: FloatArray


@dataclass(frozen=True, eq=False)
class Knots:
    """Positions ``(n,)`` of an axis, with the cubic spline through values there."""

    positions: FloatArray

    def pieces(self) -> FloatArray:
        """Return ``(4, n - 1, n)`` coefficients of the weights, highest power first."""
        count = len(self.positions)
        if count == 1:
            return np.array([0.0, 0.0, 0.0, 1.0]).reshape(4, 1, 1)
        pieces = np.zeros((4, count - 1, count))
        spline = CubicSpline(self.positions, np.eye(count))
        pieces[:] = spline.c
        return pieces

    def weigh(self, position: float) -> FloatArray:
        """Return the weights ``(n,)`` of the values at the knots."""
        if len(self.positions) == 1:
            return np.ones(1)
        return np.asarray(CubicSpline(self.positions, np.eye(len(self.positions)))(position))


type Weights = tuple[Sequence[FloatArray], Sequence[FloatArray]]


@dataclass(frozen=True, eq=False)
class Field:
    """An array over a grid of knots.

    Attributes:
        values: ``(n_1, n_2, ..., *shape)`` with 1 in place of the number of knots of an axis that it
            does not depend on.
        level: Which of both sets of knots it has.
    """

    values: FloatArray
    shape: tuple[int, ...]
    level: int

    def at(self, weights: Weights) -> FloatArray:
        """Return the array at weights of the knots of each axis, of both sets."""
        value = self.values
        for weight in weights[self.level]:
            value = value[0] if value.shape[0] == 1 else np.einsum("k,k...->...", weight, value)
        return value

    def turn(self, turn: FloatArray) -> "Field":
        """Return a field of rows ``(r, m)`` in coordinates ``(m, m)``."""
        return replace(self, values=self.values @ turn)

    @property
    def grid(self) -> tuple[int, ...]:
        """Number of knots of each axis, 1 of those that it does not depend on."""
        return self.values.shape[: self.values.ndim - len(self.shape)]

    @property
    def varies(self) -> bool:
        """Return whether it depends on any axis."""
        return self.values.size > int(np.prod(self.shape))


@dataclass(frozen=True, eq=False)
class VaryingSpring:
    """A joint that slides; see ``PosedSpring``."""

    rows: Field
    stiffness: Field
    damping: Field

    def at(self, weights: Weights) -> PosedSpring:
        """Return the joint at weights of the knots."""
        return PosedSpring(
            *(field.at(weights) for field in (self.rows, self.stiffness, self.damping))
        )

    @property
    def fields(self) -> tuple[Field, Field, Field]:
        """Rows, stiffness and damping."""
        return self.rows, self.stiffness, self.damping


@dataclass(frozen=True, eq=False)
class VaryingMatrices:
    """A system in coordinates of unit mass that are the same at all positions.

    Attributes:
        knots: Of each axis by name: those of joints, and those of channels and further damping.
        stiffness: ``(m, m)`` of what stays the same.
        damping: ``(m, m)`` likewise.
        springs: Joints that slide.
        patterns: ``(r, m, m)`` damping that is no sum over joints: modal damping and loss factors.
        further: ``(r,)`` amounts of these.
        loads: ``(k, m)`` rows of the inputs.
        rows: ``(p, m)`` rows of the outputs.
    """

    knots: tuple[Mapping[str, Knots], Mapping[str, Knots]]
    stiffness: FloatArray
    damping: FloatArray
    springs: tuple[VaryingSpring, ...]
    patterns: FloatArray
    further: Field
    loads: Field
    rows: Field

    def at(self, positions: Mapping[str, float]) -> PosedMatrices:
        """Return the matrices at positions of the axes."""
        weights = self.weigh(positions)
        placed = [spring.at(weights) for spring in self.springs]
        return PosedMatrices(
            add_springs(self.stiffness, ((one.rows, one.stiffness) for one in placed)),
            add_springs(
                self.damping + self.damp_further(weights),
                ((one.rows, one.damping) for one in placed),
            ),
            self.loads.at(weights).T,
            self.rows.at(weights),
        )

    @property
    def modal(self) -> "VaryingMatrices":
        """The same in coordinates in which the stiffness that stays the same is diagonal."""
        squares, turn = np.linalg.eigh(self.stiffness)
        springs, others = (
            (replace(spring, rows=spring.rows.turn(turn)) for spring in self.springs),
            {name: getattr(self, name).turn(turn) for name in ("loads", "rows")},
        )
        return replace(
            self,
            stiffness=np.diag(squares),
            damping=turn.T @ self.damping @ turn,
            springs=tuple(springs),
            patterns=turn.T @ self.patterns @ turn,
            **others,
        )

    @property
    def fields(self) -> tuple[Field, ...]:
        """Of the springs in turn, then further damping, loads and rows."""
        springs = itertools.chain(*(spring.fields for spring in self.springs))
        return (*springs, self.further, self.loads, self.rows)

    def damp_further(self, weights: Weights) -> FloatArray:
        """Return the damping ``(m, m)`` that is no sum over joints."""
        return np.einsum("r,rij->ij", self.further.at(weights), self.patterns)

    def weigh(self, positions: Mapping[str, float]) -> Weights:
        """Return the weights of the knots of each axis, of both sets."""
        joints, others = (
            [knots.weigh(positions[name]) for name, knots in level.items()] for level in self.knots
        )
        return joints, others

    @property
    def grid(self) -> list[dict[str, float]]:
        """Positions of the axes at all knots of channels, those of the last axis side by side."""
        return list_grid({name: knots.positions for name, knots in self.knots[1].items()})


def list_grid(positions: Mapping[str, FloatArray]) -> list[dict[str, float]]:
    """Return all combinations of positions of axes, those of the last axis side by side."""
    return [
        dict(zip(positions, map(float, place), strict=True))
        for place in itertools.product(*positions.values())
    ]


def add_springs(total: FloatArray, springs: Iterable[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return ``A + sum R^T k R`` of rows ``(r, m)`` and matrices ``(r, r)``."""
    return sum((rows.T @ matrix @ rows for rows, matrix in springs), total)


def lay_field(values: Sequence[FloatArray], counts: Sequence[int], level: int) -> Field:
    """Return a field of its values at the grid; axes along which it does not change are left out.

    Args:
        values: One array for each point of the grid, in the order of ``list_grid``.
        counts: Number of points of each axis.
        level: Which of both sets of knots they are.
    """
    shape = values[0].shape
    laid = np.array(values).reshape(*counts, *shape)
    largest = float(np.abs(laid).max(initial=0.0))
    for axis in range(len(counts)):
        first = laid.take([0], axis=axis)
        if np.abs(laid - first).max(initial=0.0) <= CONSTANT * largest:
            laid = first
    return Field(laid, shape, level)


def split_patterns(matrices: FloatArray, scales: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return amounts ``(n, r)`` and patterns ``(r, m, m)`` whose sums are ``n`` matrices.

    Args:
        matrices: ``(n, m, m)``.
        scales: ``(m,)`` by which rows and columns are multiplied to be weighed.
    """
    weights = np.outer(scales, scales)
    flat = (matrices * weights).reshape(len(matrices), -1)
    amounts, sizes, patterns = np.linalg.svd(flat, full_matrices=False)
    kept = sizes > NEGLIGIBLE * sizes.max(initial=0.0)
    return amounts[:, kept] * sizes[kept], patterns[kept].reshape(-1, *weights.shape) / weights


def span_motions(
    stiffness: FloatArray,
    least: FloatArray,
    mass: FloatArray,
    up_to_hz: float,
) -> FloatArray:
    """Return the combinations ``(k, m)`` of ``k`` motions that make a basis of unit mass.

    Motions count by their energy at the highest frequency. What would be faster than ``FASTEST`` times
    that frequency in every pose gets the mass that makes it so fast.

    Args:
        stiffness: ``(k, k)`` of the motions, the mean over poses.
        least: ``(k, k)`` of what is as stiff in every pose.
        mass: ``(k, k)``.
        up_to_hz: Highest frequency of interest [Hz].

    Source: Amsallem and Farhat (2011) for one basis of many poses; MacNeal (1971) for the mass.
    """
    square = (2.0 * np.pi * up_to_hz) ** 2
    energies = stiffness + square * mass
    sizes = np.sqrt(energies.diagonal())
    levels, turn = np.linalg.eigh(energies / np.outer(sizes, sizes))
    kept = levels > DEPENDENT * levels[-1]
    basis = (turn[:, kept] / np.sqrt(levels[kept])) / sizes[:, None]
    mass, least = (basis.T @ matrix @ basis for matrix in (mass, least))
    # an energy of one has the mass mu = 1 / (omega^2 + square)
    energy = least + square * mass + DEPENDENT * np.eye(len(mass))
    shares, axes = scipy.linalg.eigh(mass, energy)
    lightest = 1.0 / ((1.0 + FASTEST**2) * square)
    return basis @ (axes / np.sqrt(np.maximum(shares, lightest)))


def respond_posed(matrices: PosedMatrices, omega: FloatArray) -> ComplexArray:
    """Return the frequency response ``(n_freq, p, k)`` at angular frequencies [rad/s]."""
    unit = np.eye(len(matrices.stiffness))
    return np.array(
        [
            matrices.rows
            @ np.linalg.solve(
                matrices.stiffness - value**2 * unit + 1j * value * matrices.damping,
                matrices.loads + 0j,
            )
            for value in omega
        ]
    )


def find_largest_error(exact: ComplexArray, other: ComplexArray, sizes: FloatArray) -> float:
    """Find the largest difference of two frequency responses ``(n_freq, p, k)``, as a share of the
    response at its frequency.

    Args:
        sizes: ``(p, k)`` by which entries are divided before they are compared.
    """
    error = np.linalg.norm((other - exact) / sizes, axis=(1, 2))
    return float((error / np.linalg.norm(exact / sizes, axis=(1, 2))).max(initial=0.0))
