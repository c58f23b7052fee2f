"""Frequency response by three methods: undamped modes corrected statically, poles, and a dense
solve per frequency.

Undamped modes serve where no damping couples them, poles of any linear second-order system
(unsymmetric terms, dofs without mass and structural damping included) elsewhere; one dense solve
per frequency is slow, and right for any linear system.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg.lapack import zgecon, zgetrf, zgetrs

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError
from headstock.solvers.linear.modal_coordinates import ModalCoordinates, rigid_response
from headstock.solvers.linear.symmetric_matrices import EPS
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

SINGULAR = 1e-11  # closer to an undamped pole than this share of it, the response is roundoff
UNSEEN = 1e-12  # a mode's share in a channel below this share of the largest one is roundoff
CONDITION_LIMIT = 1e6  # of the eigenvectors: critically damped modes have hardly two of them
INFINITE = 16.0 * EPS
SINGULAR_FACTOR = 16.0
FAR = 3.0  # times the highest frequency asked for: poles beyond make a smooth part
SMOOTH_NODES = 16  # of a polynomial for it: its error is (5 + sqrt(24))^-16
MANY = 2 * SMOOTH_NODES  # frequencies and modes from which a polynomial is faster


class ResponseForm(Protocol):
    """A form that evaluates a response at any frequency."""

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Return the receptance ``(n_freq, n_outputs, n_inputs)``, angular frequencies > 0."""

    def poles(self) -> ComplexArray:
        """Return the poles at positive frequencies, and real ones [rad/s]."""


@dataclass(frozen=True, eq=False)
class RestTerms:
    """Terms that the elastic modes lack.

    Attributes:
        rigid: ``(n_outputs, n_inputs)`` acceleration of the rigid-body motion per unit load.
        residual: ``(n_outputs, n_inputs)`` static compliance that the modes lack.
        square: Lowest omega^2 [rad^2/s^2] where all modes are there: the residual is then roundoff,
            and fades with the static compliance beyond it; else infinite.
    """

    rigid: FloatArray
    residual: FloatArray
    square: float

    def evaluate(self, omega: FloatArray) -> FloatArray:
        """Return their receptance ``(n_freq, n_outputs, n_inputs)``."""
        square = omega[:, None, None] ** 2
        fading = 1.0 if np.isinf(self.square) else (self.square / (self.square + square)) ** 2
        return self.residual * fading - self.rigid / square


@dataclass(frozen=True, eq=False)
class ModalSum:
    """``sum_k r_k / (omega_k^2 - omega^2 + i (omega c_k + h_k))`` and what modes lack.

    Attributes:
        eigenvalues: ``(m,)`` of the elastic modes [rad^2/s^2].
        viscous: ``(m,)`` ``2 zeta omega_k``.
        hysteretic: ``(m,)`` ``eta omega_k^2``.
        residues: ``(m, n_outputs, n_inputs)``.
        seen: The same shape: the mode takes part.
        rest: Rigid-body motion and residual flexibility.
    """

    eigenvalues: FloatArray
    viscous: FloatArray
    hysteretic: FloatArray
    residues: FloatArray
    seen: NDArray[np.bool_]
    rest: RestTerms

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Return the receptance ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies;
        NaN on an undamped pole that is seen.
        """
        band = self.within(float(omega.max())) if len(omega) >= MANY else self
        if band is not self:
            return band.evaluate(omega)
        return self.add_up(omega) + self.rest.evaluate(omega)

    def within(self, highest: float) -> "ModalSum | _BandSum":
        """Return the same up to an angular frequency [rad/s], faster with many modes beyond."""
        far = np.abs(self.poles()) > FAR * highest
        if far.sum() < MANY:
            return self
        nodes = np.polynomial.chebyshev.chebpts1(SMOOTH_NODES)
        values = self._keep(far).add_up(0.5 * highest * (1.0 + nodes))
        vander = np.polynomial.chebyshev.chebvander(nodes, SMOOTH_NODES - 1)
        coefficients = np.linalg.solve(vander, values.reshape(SMOOTH_NODES, -1))
        return _BandSum(self, self._keep(~far), highest, coefficients)

    def _keep(self, modes: NDArray[np.bool_]) -> "ModalSum":
        return ModalSum(
            self.eigenvalues[modes],
            self.viscous[modes],
            self.hysteretic[modes],
            self.residues[modes],
            self.seen[modes],
            self.rest,
        )

    def add_up(self, omega: FloatArray) -> ComplexArray:
        """Return the sum alone."""
        square = omega[:, None] ** 2
        real, imaginary = self.eigenvalues - square, omega[:, None] * self.viscous + self.hysteretic
        size = real**2 + imaginary**2
        # at its resonance a mode with more damping than this is never singular
        damping = self.viscous * np.sqrt(self.eigenvalues) + self.hysteretic
        damped = bool((damping > 10.0 * SINGULAR * self.eigenvalues).all())
        singular = None if damped else size <= (SINGULAR * (self.eigenvalues + square)) ** 2
        if singular is not None:
            size[singular] = np.inf
        # in real numbers twice as fast: (a + i b)^-1 = (a - i b) / (a^2 + b^2)
        real /= size
        imaginary /= size
        receptance: ComplexArray = np.tensordot(real, self.residues, axes=1) - 1j * np.tensordot(
            imaginary, self.residues, axes=1
        )
        return receptance if singular is None else _blank_singular(receptance, singular, self.seen)

    def poles(self) -> ComplexArray:
        """Return each mode's pole at positive frequencies [rad/s]; if overdamped the slower."""
        root = np.sqrt(0.25 * self.viscous**2 - self.eigenvalues - 1j * self.hysteretic)
        return -0.5 * self.viscous + np.where(root.imag < 0.0, -root, root)


@dataclass(frozen=True, eq=False)
class _BandSum:
    """A sum over modes in a band of frequencies: over those far beyond by a polynomial.

    Attributes:
        every: The sum over all modes, for frequencies beyond the band.
        near: That over the modes in and near the band.
        highest: Of the band [rad/s].
        coefficients: ``(SMOOTH_NODES, n_outputs n_inputs)`` of Chebyshev polynomials over the band.
    """

    every: ModalSum
    near: ModalSum
    highest: float
    coefficients: ComplexArray

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Return the receptance ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies."""
        if omega.max(initial=0.0) > self.highest:
            return self.every.evaluate(omega)
        places = 2.0 * omega / self.highest - 1.0
        smooth = np.polynomial.chebyshev.chebvander(places, SMOOTH_NODES - 1) @ self.coefficients
        receptance = self.near.add_up(omega) + self.every.rest.evaluate(omega)
        return receptance + smooth.reshape(receptance.shape)

    def poles(self) -> ComplexArray:
        """Return the poles of all modes [rad/s]."""
        return self.every.poles()


def narrow_band(form: ResponseForm, highest: float) -> ResponseForm:
    """Return the same response, faster up to an angular frequency [rad/s] where it is a sum over
    modes.
    """
    return form.within(highest) if isinstance(form, ModalSum) else form


def sum_over_modes(coordinates: ModalCoordinates) -> ModalSum:
    """Return the sum over all modes; the damping of the coordinates must be diagonal."""
    flexible = slice(coordinates.rigid_count, None)
    rows, loads = coordinates.outputs[:, flexible], coordinates.inputs[flexible]
    size = len(coordinates.eigenvalues)
    return ModalSum(
        eigenvalues=coordinates.eigenvalues[flexible],
        viscous=_diagonal(coordinates.viscous, size)[flexible],
        hysteretic=_diagonal(coordinates.hysteretic, size)[flexible],
        residues=np.einsum("ok,ki->koi", rows, loads),
        seen=_see_modes(rows, loads),
        rest=rest_terms(coordinates),
    )


def rest_terms(coordinates: ModalCoordinates) -> RestTerms:
    """Return what the elastic modes of a system lack."""
    rigid, moves = rigid_response(coordinates)
    lowest = float(coordinates.eigenvalues[coordinates.rigid_count :].min(initial=np.inf))
    return RestTerms(
        np.where(moves, rigid, 0.0),
        coordinates.residual,
        lowest if coordinates.complete else np.inf,
    )


def _see_modes(
    rows: ComplexArray | FloatArray, loads: ComplexArray | FloatArray
) -> NDArray[np.bool_]:
    """Return whether a mode takes part in each entry ``(m, n_outputs, n_inputs)``, from
    ``(n_outputs, m)`` and ``(m, n_inputs)``.
    """
    moved = np.abs(rows) > UNSEEN * np.abs(rows).max(axis=1, keepdims=True, initial=0.0)
    excited = np.abs(loads) > UNSEEN * np.abs(loads).max(axis=0, keepdims=True, initial=0.0)
    return moved.T[:, :, None] & excited[:, None, :]


def _blank_singular(
    values: ComplexArray, singular: NDArray[np.bool_], observed: NDArray[np.bool_]
) -> ComplexArray:
    """Put NaN in place of what a singular mode ``(n_freq, m)`` that takes part
    ``(m, n_outputs, n_inputs)`` has spoilt.
    """
    lost = np.tensordot(singular.astype(float), observed.astype(float), axes=1) > 0.0
    return np.where(lost, np.nan, values)


def _diagonal(matrix: FloatArray | None, size: int) -> FloatArray:
    return np.zeros(size) if matrix is None else np.array(matrix.diagonal())


@dataclass(frozen=True, eq=False)
class PoleSum:
    """``sum_k r_k mu_k / (1 - sigma mu_k)`` and what modes lack; sigma is ``i omega``, or
    ``omega^2`` without viscous damping.

    Attributes:
        flexibilities: ``(p,)`` mu, inverse poles: those of low frequency, which matter, then have
            full machine precision.
        residues: ``(p, n_outputs, n_inputs)``.
        seen: The same shape: the pole takes part.
        rest: Rigid-body motion and residual flexibility.
        first_order: sigma is ``i omega``.
    """

    flexibilities: ComplexArray
    residues: ComplexArray
    seen: NDArray[np.bool_]
    rest: RestTerms
    first_order: bool

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Return the receptance ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies;
        NaN on an undamped pole that is seen.
        """
        sigma = 1j * omega if self.first_order else omega**2 + 0j
        product = sigma[:, None] * self.flexibilities
        singular = np.abs(1.0 - product) <= SINGULAR
        weights = np.where(
            singular, 0.0, self.flexibilities / np.where(singular, 1.0, 1.0 - product)
        )
        if self.first_order:
            # above all poles, with sum r_k = 0 (a load does not jump the displacement), which the
            # plain sum loses digits to find
            above = np.abs(product).min(axis=1, initial=np.inf) > 1.0
            weights[above] = 1.0 / (1j * omega[above, None] * (1.0 - product[above]))
        receptance = np.tensordot(weights, self.residues, axes=1) + self.rest.evaluate(omega)
        return _blank_singular(receptance, singular, self.seen)

    def poles(self) -> ComplexArray:
        """Return the poles at positive frequencies, and real ones [rad/s]."""
        with np.errstate(divide="ignore"):
            inverse = 1.0 / self.flexibilities
        if self.first_order:
            return inverse[inverse.imag >= 0.0]
        return 1j * np.sqrt(inverse)


def sum_over_poles(coordinates: ModalCoordinates) -> PoleSum:
    """Return the sum over all poles of the elastic modes; no damper may act on rigid-body motions.

    Raises:
        AccuracyError: The poles lie so close together that they have hardly independent shapes
            (critical damping).

    Source: Frazer, Duncan and Collar (1938); Geradin and Rixen (2015), section 3.3. The inverse
    state matrix is used, which
        in modal coordinates needs no factorisation of the stiffness.
    """
    flexible = slice(coordinates.rigid_count, None)
    omega = coordinates.omega[flexible]
    rows, loads = coordinates.outputs[:, flexible] + 0j, coordinates.inputs[flexible] + 0j
    softness = _softness(coordinates.hysteretic, flexible, omega)
    if coordinates.viscous is None:
        values, vectors = _eigenpairs(softness / np.outer(omega, omega))
        left, right = rows @ vectors, _solve(vectors, loads)
        return PoleSum(
            values, _products(left, right), _see_modes(left, right), rest_terms(coordinates), False
        )
    loss = softness / omega @ (coordinates.viscous[flexible, flexible] / omega)
    # state (W p, p') with W = diag(omega): A = [[0, W], [-W (softness)^-1, -C]]; its inverse needs
    # no factorisation
    inverse = np.block([[-loss, -softness / omega], [np.diag(1.0 / omega), np.zeros_like(loss)]])
    values, vectors = _eigenpairs(inverse.real if coordinates.hysteretic is None else inverse)
    left = rows / omega @ vectors[: len(omega)]
    right = _solve(vectors, np.vstack([np.zeros_like(loads), loads]))
    # 1 / (i omega - 1 / mu) = -mu / (1 - i omega mu)
    return PoleSum(
        values, _products(left, -right), _see_modes(left, right), rest_terms(coordinates), True
    )


def _softness(hysteretic: FloatArray | None, flexible: slice, omega: FloatArray) -> ComplexArray:
    """Return the inverse of the complex stiffness ``W^-1 (W^2 + i H) W^-1``, W = diag(omega)."""
    unit = np.eye(len(omega)) + 0j
    if hysteretic is None:
        return unit
    return _solve(unit + 1j * hysteretic[flexible, flexible] / np.outer(omega, omega), unit)


def _solve(matrix: ComplexArray, right: ComplexArray) -> ComplexArray:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.complex128)


def _products(left: ComplexArray, right: ComplexArray) -> ComplexArray:
    return np.einsum("ok,ki->koi", left, right)


def _eigenpairs(matrix: ComplexArray | FloatArray) -> tuple[ComplexArray, ComplexArray]:
    values, vectors = scipy.linalg.eig(matrix, check_finite=False)
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    condition = np.linalg.cond(vectors)
    if not condition <= CONDITION_LIMIT:
        raise AccuracyError(
            f"the complex modes are nearly dependent (condition {condition:.2g}): critical damping"
        )
    return np.asarray(values, dtype=np.complex128), np.asarray(vectors, dtype=np.complex128)


def _find_poles(system: SecondOrderSystem) -> ComplexArray:
    """Find all finite poles ``(p,)`` [rad/s], rising in size; conjugate pairs stand twice.

    Structural damping is taken as it acts at positive frequencies, so that with it only poles above
    the real axis mean anything.

    Args:
        system: Any; nothing is symmetrised.

    Source: Tisseur and Meerbergen (2001), The quadratic eigenvalue problem, section 3.4 (first
    companion form) and section 5.1
        (scaling of Fan, Lin and Van Dooren 2004); Moler and Stewart (1973), QZ.
    """
    size = len(system.mass)
    stiffness = system.stiffness + (0.0 if system.hysteretic is None else 1j * system.hysteretic)
    damping = np.zeros((size, size)) if system.damping is None else system.damping
    stiff = float(np.abs(stiffness).max(initial=0.0))
    heavy = float(np.abs(system.mass).max(initial=0.0))
    # s = scale z makes stiffness and mass equally large
    scale = np.sqrt(stiff / heavy) if stiff > 0.0 and heavy > 0.0 else 1.0
    level = max(stiff, heavy * scale**2) or 1.0
    zero, unit = np.zeros((size, size)), np.eye(size)
    left = np.block([[zero, unit], [-stiffness / level, -damping * (scale / level)]])
    right = np.block([[unit, zero], [zero, system.mass * (scale**2 / level)]])
    numerator, denominator = scipy.linalg.eigvals(
        left, right, homogeneous_eigvals=True, check_finite=False
    )
    finite = np.abs(denominator) > INFINITE * (np.abs(numerator) + np.abs(denominator))
    poles = scale * numerator[finite] / denominator[finite]
    return poles[np.argsort(np.abs(poles), kind="stable")]


@dataclass(frozen=True, eq=False)
class DirectResponse:
    """``L (K + i H + i omega C - omega^2 M)^-1 B``.

    Attributes:
        system: Its matrices may be unsymmetric.
        loads: ``(n, n_inputs)`` B.
        rows: ``(n_outputs, n)`` L.
    """

    system: SecondOrderSystem
    loads: FloatArray
    rows: FloatArray

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Return the receptance ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies;
        NaN where the matrix is singular.
        """
        shape = (len(omega), len(self.rows), self.loads.shape[1])
        return np.array([self.rows @ self.displacements(float(value)) for value in omega]).reshape(
            shape
        )

    def poles(self) -> ComplexArray:
        """Return the poles at positive frequencies, and real ones [rad/s]."""
        all_poles = _find_poles(self.system)
        return all_poles[all_poles.imag >= 0.0]

    def displacements(self, omega: float) -> ComplexArray:
        """Return the displacements ``(n, n_inputs)`` at a positive angular frequency, NaN where the
        matrix is singular; rows and columns scaled by the size of their own terms, one step of
        refinement.
        """
        system = self.system
        matrix = system.stiffness - omega**2 * system.mass + 0j
        if system.damping is not None:
            matrix += 1j * omega * system.damping
        if system.hysteretic is not None:
            matrix += 1j * system.hysteretic
        size = np.abs(system.stiffness.diagonal()) + omega**2 * np.abs(system.mass.diagonal())
        scale = 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0))
        scaled = matrix * scale * scale[:, None]
        factor, pivots, info = zgetrf(scaled)
        reciprocal, _ = (
            zgecon(factor, np.abs(scaled).sum(axis=0).max(initial=0.0)) if info == 0 else (0.0, 0)
        )
        if not reciprocal > SINGULAR_FACTOR * EPS:
            return np.full(self.loads.shape, np.nan + 0j)
        right = scale[:, None] * self.loads + 0j
        solution, _ = zgetrs(factor, pivots, right)
        correction, _ = zgetrs(factor, pivots, right - scaled @ solution)
        return scale[:, None] * (solution + correction)
