"""Closure equations of a mechanism: residual, Jacobian and bias, and the passive coordinates that
close the loops.

``phi(q) = 0``, ``phi_q qd = 0``, ``phi_q qdd + gamma = 0``. Orientation closures use ``vee
skew(E)``, ``E = R1^T R2``, whose derivative is ``T R1^T (omega2 - omega1)`` with ``T = (tr(E) I -
E) / 2``, off the constraint too.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from headstock.geometry.errors import ClosureError
from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.mechanisms.kinematics import (
    Bias,
    IndexArray,
    Placement,
    cross,
    marker_jacobians,
    place_markers,
    skew_matrices,
)
from headstock.geometry.mechanisms.mechanism import (
    AXES,
    CoordinateConstraint,
    Mechanism,
    OrientationConstraint,
    PointConstraint,
)

MAX_ITERATIONS = 40
LARGEST_STEP = 0.5
CLOSED = 1e-13
STAGNANT = 1e-9  # below this a step that no longer shrinks is roundoff
ROUNDING = 16.0  # roundings of places that a chain of joints may add up
RANK_TOLERANCE = 1e-9
_UNIT = np.eye(3)


@dataclass(frozen=True, eq=False)
class Kinematics:
    """A mechanism in a state, with first derivatives.

    Attributes:
        of_position: ``(..., P, 3, n)`` derivative of the markers' positions.
        of_rotation: ``(..., P, 3, n)`` of their orientations.
        closure_jacobian: ``(..., m, n)`` ``phi_q``.
    """

    placement: Placement
    of_position: FloatArray
    of_rotation: FloatArray
    closure_jacobian: FloatArray


def evaluate_kinematics(mechanism: Mechanism, state: FloatArray) -> Kinematics:
    """Return the placement and all Jacobians at a state ``(..., n)``."""
    placement = place_markers(mechanism, state)
    of_position, of_rotation = marker_jacobians(placement)
    return Kinematics(
        placement,
        of_position,
        of_rotation,
        _closure_jacobian(mechanism, placement, of_position, of_rotation),
    )


@dataclass(frozen=True, eq=False)
class _ClosureLayout:
    """Closures as arrays: markers of all point constraints and orientation constraints, and which
    of their components are
    wanted.

    Attributes:
        meet_first: ``(K,)`` markers of the point constraints.
        meet_second: ``(K,)``.
        meet_frame: ``(K,)`` marker whose axes are used; the number of markers for ground.
        align_first: ``(L,)`` markers of the orientation constraints.
        align_second: ``(L,)``.
        rows: Picks the wanted components from point constraints (3 K), orientation constraints (3
            L) and balances, in the
            order of the closures.
        weights: ``(B, n)`` of the coordinate constraints.
        values: ``(B,)`` of the coordinate constraints.
    """

    meet_first: IndexArray
    meet_second: IndexArray
    meet_frame: IndexArray
    align_first: IndexArray
    align_second: IndexArray
    rows: IndexArray
    weights: FloatArray
    values: FloatArray


@lru_cache(maxsize=64)
def _closure_layout(mechanism: Mechanism) -> _ClosureLayout:
    """Return the closures of a mechanism as arrays."""
    markers = {name: row for row, name in enumerate(mechanism.markers)}
    points = [item for item in mechanism.closures if isinstance(item, PointConstraint)]
    orientations = [item for item in mechanism.closures if isinstance(item, OrientationConstraint)]
    sums = [item for item in mechanism.closures if isinstance(item, CoordinateConstraint)]
    weights = np.array(
        [[item.weights.get(name, 0.0) for name in mechanism.coordinates] for item in sums]
    )
    starts = {id(item): 3 * number for number, item in enumerate((*points, *orientations))}
    starts |= {id(item): 3 * len(starts) + number for number, item in enumerate(sums)}
    rows: list[int] = []
    for item in mechanism.closures:
        picked = (
            [0]
            if isinstance(item, CoordinateConstraint)
            else [AXES.index(axis) for axis in item.axes]
        )
        rows += [starts[id(item)] + component for component in picked]

    def marker_rows(names: list[str | None]) -> IndexArray:
        return np.array(
            [len(markers) if name is None else markers[name] for name in names], dtype=np.intp
        )

    return _ClosureLayout(
        marker_rows([item.first for item in points]),
        marker_rows([item.second for item in points]),
        marker_rows([item.frame for item in points]),
        marker_rows([item.first for item in orientations]),
        marker_rows([item.second for item in orientations]),
        np.array(rows, dtype=np.intp),
        weights.reshape(len(sums), len(mechanism.coordinates)),
        np.array([item.value for item in sums]),
    )


def closure_residual(
    mechanism: Mechanism, state: FloatArray, placement: Placement | None = None
) -> FloatArray:
    """Return ``phi``, ``(..., m)`` [m, rad], by how much the loops are open.

    Args:
        state: Coordinates ``(..., n)`` [m, rad].
        placement: Of the markers there, where it is known already.
    """
    layout = _closure_layout(mechanism)
    placement = placement or place_markers(mechanism, state)
    axes, gap = _axes_and_gap(layout, placement)
    met = (np.swapaxes(axes, -1, -2) @ gap[..., None])[..., 0]
    aligned = _vee(_relative(layout, placement))
    balanced = (layout.weights @ state[..., None])[..., 0] - layout.values
    return _pick(layout, met, aligned, balanced)


def closure_bias(mechanism: Mechanism, placement: Placement, bias: Bias) -> FloatArray:
    """Return ``gamma``, ``(..., m)``: second time derivative of the closures with zero joint
    accelerations.

    Args:
        bias: Accelerations of the markers there with zero joint accelerations.
    """
    layout = _closure_layout(mechanism)
    axes, gap = _axes_and_gap(layout, placement)
    omega = bias.omega.take(layout.meet_frame, axis=-2)
    alpha = bias.alpha.take(layout.meet_frame, axis=-2)
    speed = bias.velocity.take(layout.meet_first, axis=-2) - bias.velocity.take(
        layout.meet_second, axis=-2
    )
    apart = bias.acceleration.take(layout.meet_first, axis=-2) - bias.acceleration.take(
        layout.meet_second, axis=-2
    )
    turned = apart - 2.0 * cross(omega, speed) - cross(alpha, gap) + cross(omega, cross(omega, gap))
    met = (np.swapaxes(axes, -1, -2) @ turned[..., None])[..., 0]
    aligned = _orientation_bias(layout, placement, bias)
    balanced = np.zeros((*gap.shape[:-2], len(layout.values)), gap.dtype)
    return _pick(layout, met, aligned, balanced)


def close_chains(mechanism: Mechanism, state: FloatArray) -> FloatArray:
    """Return the coordinates that close the loops, by Newton's method from a state.

    Args:
        mechanism: Its closures must be as many as its passive coordinates, and regular.
        state: ``(..., n)`` start; the passive coordinates are changed, the others fixed.

    Returns:
        ``(..., n)``.

    Raises:
        ClosureError: The pose cannot be reached from there, or the passive coordinates are singular
            in a pose whose loops are open. A singular pose whose loops are closed but for rounding
            is given back as it is.
    """
    return close_kinematics(mechanism, state)[0]


def close_kinematics(mechanism: Mechanism, state: FloatArray) -> tuple[FloatArray, Kinematics]:
    """Close loops as :func:`close_chains`, and return the kinematics there too, right to the last
    correction of Newton's method.

    Args:
        state: Coordinates ``(..., n)`` [m, rad] to start from; the passive ones change.
    """
    columns = mechanism.passive_slice
    state = np.array(state, dtype=np.result_type(state, float))
    before = np.inf
    for _ in range(MAX_ITERATIONS):
        kinematics = evaluate_kinematics(mechanism, state)
        residual = closure_residual(mechanism, state, kinematics.placement)
        closed = _is_closed(kinematics.placement, residual)
        try:
            step = np.linalg.solve(kinematics.closure_jacobian[..., columns], residual[..., None])[
                ..., 0
            ]
        except np.linalg.LinAlgError as error:
            if closed.all():
                return state, kinematics
            raise ClosureError(
                f"{mechanism.name}: the loop closures do not determine the coordinates in this pose: it is singular"
            ) from error
        # in a singular pose a residual of rounding asks for a step of any size
        lost = closed & ~(np.abs(step).max(axis=-1, initial=0.0) < STAGNANT)
        step[lost] = 0.0
        size = np.abs(step).max(initial=0.0)
        if not np.isfinite(size):
            break
        # far from the solution a full step may jump to another assembly
        state[..., columns] -= step * min(1.0, LARGEST_STEP / max(size, LARGEST_STEP))
        if size < CLOSED or 0.1 * before <= size < STAGNANT:
            return state, kinematics
        before = size
    kinematics = evaluate_kinematics(mechanism, state)
    residual = closure_residual(mechanism, state, kinematics.placement)
    if _is_closed(kinematics.placement, residual).all():
        return state, kinematics
    worst = float(np.abs(residual).max())
    raise ClosureError(
        f"{mechanism.name}: the loops stay open by {worst:.2g} m or rad after {MAX_ITERATIONS} steps; the pose is out of reach"
    )


def _is_closed(placement: Placement, residual: FloatArray) -> BoolArray:
    """Return whether loops ``(...,)`` are open by no more than rounding of where their markers
    are.
    """
    reach = np.maximum(1.0, np.abs(placement.positions).max(axis=(-2, -1), initial=0.0))
    return np.abs(residual).max(axis=-1, initial=0.0) <= ROUNDING * np.finfo(float).eps * reach


@dataclass(frozen=True, eq=False)
class _Mobility:
    """Free and fixed motions of a mechanism in a pose.

    Attributes:
        freedom: Motions that the closures leave, compliant coordinates fixed.
        closures: Number of closure equations; those above the rank are redundant, and forces in
            them not unique.
        passive_condition: Condition number of the closures in the passive coordinates; infinite
            where these are not square.
    """

    freedom: int
    rank: int
    closures: int
    passive_condition: float

    @property
    def redundant(self) -> int:
        """Closures that say nothing new."""
        return self.closures - self.rank


def find_mobility(mechanism: Mechanism, state: FloatArray) -> _Mobility:
    """Find the rank of the closures and what they leave free, at one closed state ``(n,)``."""
    jacobian = evaluate_kinematics(mechanism, state).closure_jacobian
    rigid = jacobian[:, : mechanism.compliant_slice.start]
    sizes = np.linalg.svd(rigid, compute_uv=False)
    rank = int((sizes > RANK_TOLERANCE * sizes.max(initial=1.0)).sum())
    passive = jacobian[:, mechanism.passive_slice]
    condition = float(np.linalg.cond(passive)) if passive.shape[0] == passive.shape[1] else np.inf
    return _Mobility(rigid.shape[1] - rank, rank, len(jacobian), condition)


def _closure_jacobian(
    mechanism: Mechanism, placement: Placement, of_position: FloatArray, of_rotation: FloatArray
) -> FloatArray:
    layout = _closure_layout(mechanism)
    axes, gap = _axes_and_gap(layout, placement)
    frame_turn = of_rotation.take(layout.meet_frame, axis=-3)
    opening = of_position.take(layout.meet_first, axis=-3) - of_position.take(
        layout.meet_second, axis=-3
    )
    met = np.swapaxes(axes, -1, -2) @ (opening + skew_matrices(gap) @ frame_turn)
    turning = of_rotation.take(layout.align_second, axis=-3) - of_rotation.take(
        layout.align_first, axis=-3
    )
    first = placement.rotations.take(layout.align_first, axis=-3)
    aligned = _vee_map(_relative(layout, placement)) @ np.swapaxes(first, -1, -2) @ turning
    balanced = np.broadcast_to(
        layout.weights, (*placement.positions.shape[:-2], *layout.weights.shape)
    )
    return _pick(layout, met, aligned, balanced, columns=True)


def _axes_and_gap(layout: _ClosureLayout, placement: Placement) -> tuple[FloatArray, FloatArray]:
    gap = placement.positions.take(layout.meet_first, axis=-2) - placement.positions.take(
        layout.meet_second, axis=-2
    )
    return placement.rotations.take(layout.meet_frame, axis=-3), gap


def _relative(layout: _ClosureLayout, placement: Placement) -> FloatArray:
    first = placement.rotations.take(layout.align_first, axis=-3)
    return np.swapaxes(first, -1, -2) @ placement.rotations.take(layout.align_second, axis=-3)


def _orientation_bias(layout: _ClosureLayout, placement: Placement, bias: Bias) -> FloatArray:
    first = np.swapaxes(placement.rotations.take(layout.align_first, axis=-3), -1, -2)
    relative = _relative(layout, placement)
    omega1 = bias.omega.take(layout.align_first, axis=-2)
    omega2 = bias.omega.take(layout.align_second, axis=-2)
    alpha = bias.alpha.take(layout.align_second, axis=-2) - bias.alpha.take(
        layout.align_first, axis=-2
    )
    # the closure is the axial vector of Q = R1^T R2, whose rate is V(Q) w with w the relative spin
    # in the axes of the first body. Its second rate is V(Q) w' + V(Q') w; here without unknown
    # accelerations, with Q' = w x Q and w' seen from the turning axes
    speed = first @ (omega2 - omega1)[..., None]
    change = first @ (alpha - cross(omega1, omega2))[..., None]
    growth = _vee_map(skew_matrices(speed[..., 0]) @ relative)
    return (_vee_map(relative) @ change + growth @ speed)[..., 0]


def _vee(matrix: FloatArray) -> FloatArray:
    flat = matrix.reshape(*matrix.shape[:-2], 9)
    return 0.5 * (flat[..., [7, 2, 3]] - flat[..., [5, 6, 1]])


def _vee_map(matrix: FloatArray) -> FloatArray:
    trace = matrix[..., 0, 0] + matrix[..., 1, 1] + matrix[..., 2, 2]
    return (0.5 * trace)[..., None, None] * _UNIT - 0.5 * matrix


def _pick(
    layout: _ClosureLayout,
    met: FloatArray,
    aligned: FloatArray,
    balanced: FloatArray,
    *,
    columns: bool = False,
) -> FloatArray:
    """Return the wanted rows of all closures, in the closures' order."""
    keep = 1 if columns else 0
    shape = met.shape[: met.ndim - 2 - keep]
    tail = met.shape[-1:] if columns else ()
    parts = [part.reshape(*shape, -1, *tail) for part in (met, aligned, balanced)]
    stacked = np.concatenate(parts, axis=-1 - keep)
    return stacked.take(layout.rows, axis=-1 - keep)
