"""Positions, Jacobians and bias accelerations of the markers of a mechanism, for one state or a
batch
of states at once.

A chain is a product of elementary motions, as 4 x 4 matrices (Denavit and Hartenberg 1955, with one
motion per factor). A column of a Jacobian is the unit twist of its joint (Whitney 1972); bias
accelerations come by the outward recursion with zero joint accelerations (Featherstone 2008, ch.
5). Every function takes leading batch dimensions and complex numbers, for the complex step.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray, skew
from headstock.geometry.mechanisms.mechanism import AXES, Marker, Mechanism, Step

IndexArray = NDArray[np.intp]
_SKEW = np.array([skew(axis).ravel() for axis in np.eye(3)])


@dataclass(frozen=True, eq=False)
class _ChainLayout:
    """A mechanism's chains as arrays; chains are padded to the same number of motions.

    Attributes:
        constant: ``(C, D, 4, 4)``: motion = constant + cosine cos v + sine sin v + linear v, fixed
            steps before it multiplied in.
        cosine: ``(C, D, 4, 4)``.
        sine: ``(C, D, 4, 4)``.
        linear: ``(C, D, 4, 4)``.
        source: ``(C, D)`` which coordinate drives a motion; the number of coordinates where none
            does.
        amount: ``(C, D)`` fixed part of each motion.
        direction: ``(C, D, 3)`` axis of each motion in its own frame, zero where there is none.
        turns: ``(C, D)`` 1 for rotations, else 0.
        marker_chain: ``(P,)`` chain of each marker; after the mechanism's markers comes the ground,
            as
            one more.
        mark_depth: ``(P,)`` motions before each marker.
        mark_local: ``(P, 4, 4)`` fixed steps between the last motion and the marker.
        spread: ``(P, D, n)`` 1 where a motion on the way to a marker is driven by a coordinate.
    """

    constant: FloatArray
    cosine: FloatArray
    sine: FloatArray
    linear: FloatArray
    source: IndexArray
    amount: FloatArray
    direction: FloatArray
    turns: FloatArray
    marker_chain: IndexArray
    marker_depth: IndexArray
    marker_local: FloatArray
    spread: FloatArray


@dataclass(frozen=True, eq=False)
class Placement:
    """Frames of a mechanism in a state.

    Attributes:
        frames: ``(..., C, D + 1, 4, 4)`` frame after each motion.
        axes: ``(..., C, D, 3)`` axis of each motion in the ground frame.
        rotations: ``(..., P, 3, 3)`` orientation of each marker.
        positions: ``(..., P, 3)`` origin of each marker [m].
    """

    layout: _ChainLayout
    frames: FloatArray
    axes: FloatArray
    rotations: FloatArray
    positions: FloatArray


@dataclass(frozen=True, eq=False)
class Bias:
    """Velocities, and accelerations with zero joint accelerations, of every marker.

    Attributes:
        omega: ``(..., P, 3)`` angular velocity [rad/s].
        velocity: ``(..., P, 3)`` of the origins [m/s].
        alpha: ``(..., P, 3)`` angular bias acceleration [rad/s^2].
        acceleration: ``(..., P, 3)`` bias acceleration of the origins [m/s^2].
    """

    omega: FloatArray
    velocity: FloatArray
    alpha: FloatArray
    acceleration: FloatArray


@lru_cache(maxsize=64)
def _chain_layout(mechanism: Mechanism) -> _ChainLayout:
    """Return the chains of a mechanism as arrays."""
    count = len(mechanism.chains)
    depth = max(
        sum(isinstance(item, Step) and item.coordinate is not None for item in chain)
        for chain in mechanism.chains
    )
    tensors = np.zeros((4, count, depth, 4, 4))
    tensors[0] = np.eye(4)
    source = np.full((count, depth), len(mechanism.coordinates), dtype=np.intp)
    amount = np.zeros((count, depth))
    turns = np.zeros((count, depth))
    direction = np.zeros((count, depth, 3))
    markers: list[tuple[int, int, FloatArray]] = []
    for row, chain in enumerate(mechanism.chains):
        fixed, level = np.eye(4), 0
        for item in chain:
            if isinstance(item, Marker):
                markers.append((row, level, fixed))
                continue
            motion = _motion_tensors(item)
            if item.coordinate is None:
                parts = [1.0, np.cos(item.amount), np.sin(item.amount), item.amount]
                fixed = fixed @ np.einsum("i,ijk->jk", parts, motion)
                continue
            tensors[:, row, level] = fixed @ motion
            source[row, level], amount[row, level] = mechanism.index(item.coordinate), item.amount
            turns[row, level] = item.kind == "rotation"
            direction[row, level] = np.eye(3)[AXES.index(item.axis)]
            fixed, level = np.eye(4), level + 1
    # the ground, as a last marker without a name
    markers.append((0, 0, np.eye(4)))
    chains, depths = (np.array([marker[i] for marker in markers], dtype=np.intp) for i in (0, 1))
    spread = np.eye(len(mechanism.coordinates) + 1)[source][..., :-1][chains]
    spread = spread * (np.arange(depth) < depths[:, None])[..., None]
    local = np.array([marker[2] for marker in markers])
    constant, cosine, sine, linear = tensors
    return _ChainLayout(
        constant,
        cosine,
        sine,
        linear,
        source,
        amount,
        direction,
        turns,
        chains,
        depths,
        local,
        spread,
    )


def place_markers(mechanism: Mechanism, state: FloatArray) -> Placement:
    """Return the frames of all motions and markers.

    Args:
        mechanism: With ``n`` coordinates.
        state: ``(..., n)`` coordinates, in the mechanism's order.
    """
    layout = _chain_layout(mechanism)
    padded = np.concatenate([state, np.zeros((*state.shape[:-1], 1), state.dtype)], axis=-1)
    value = (padded[..., layout.source] + layout.amount)[..., None, None]
    steps = (
        layout.constant
        + layout.cosine * np.cos(value)
        + layout.sine * np.sin(value)
        + layout.linear * value
    )
    frames = np.empty(
        (*state.shape[:-1], len(layout.source), layout.source.shape[1] + 1, 4, 4), steps.dtype
    )
    frames[..., 0, :, :] = np.eye(4)
    for level in range(layout.source.shape[1]):
        np.matmul(
            frames[..., level, :, :], steps[..., level, :, :], out=frames[..., level + 1, :, :]
        )
    axes = (frames[..., 1:, :3, :3] @ layout.direction[..., None])[..., 0]
    marked = frames[..., layout.marker_chain, layout.marker_depth, :, :] @ layout.marker_local
    return Placement(layout, frames, axes, marked[..., :3, :3], marked[..., :3, 3])


def marker_jacobians(placement: Placement) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of the markers' motion by the coordinates.

    Returns:
        Of positions ``(..., P, 3, n)`` and of orientations ``(..., P, 3, n)``: velocity and angular
        velocity per unit rate.
    """
    layout = placement.layout
    axes = placement.axes.take(layout.marker_chain, axis=-3)
    centers = placement.frames[..., 1:, :3, 3].take(layout.marker_chain, axis=-3)
    turns = layout.turns[layout.marker_chain][..., None]
    arms = placement.positions[..., :, None, :] - centers
    columns = turns * cross(axes, arms) + (1.0 - turns) * axes
    spread = layout.spread
    return np.swapaxes(columns, -1, -2) @ spread, np.swapaxes(turns * axes, -1, -2) @ spread


def marker_bias(placement: Placement, rates: FloatArray) -> Bias:
    """Return the velocities and bias accelerations of all markers at given rates ``(..., n)`` of
    the coordinates.
    """
    layout = placement.layout
    padded = np.concatenate([rates, np.zeros((*rates.shape[:-1], 1), rates.dtype)], axis=-1)
    twist = placement.axes * padded[..., layout.source][..., None]
    turning, sliding = twist * layout.turns[..., None], twist * (1.0 - layout.turns[..., None])
    omega = _running_sum(turning)
    before = omega[..., :-1, :]
    alpha = _running_sum(cross(before, turning))
    origins = placement.frames[..., :3, 3]
    step = origins[..., 1:, :] - origins[..., :-1, :]
    swept = cross(before, step)
    velocity = _running_sum(swept + sliding)
    acceleration = _running_sum(
        cross(alpha[..., :-1, :], step) + cross(before, swept + 2.0 * sliding)
    )
    index = (..., layout.marker_chain, layout.marker_depth, slice(None))
    omega, alpha = omega[index], alpha[index]
    arms = placement.positions - origins[index]
    lever = cross(omega, arms)
    return Bias(
        omega,
        velocity[index] + lever,
        alpha,
        acceleration[index] + cross(alpha, arms) + cross(omega, lever),
    )


def cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the cross product of the last axes; several times faster than ``numpy.cross`` on small
    arrays.
    """
    # written twice in a row, the three components of a cyclic product are slices
    a, b = np.concatenate([first, first], axis=-1), np.concatenate([second, second], axis=-1)
    return a[..., 1:4] * b[..., 2:5] - a[..., 2:5] * b[..., 1:4]


def skew_matrices(vectors: FloatArray) -> FloatArray:
    """Return the matrices ``(..., 3, 3)`` whose product with a vector is the cross product."""
    return (vectors @ _SKEW).reshape(*vectors.shape, 3)


def _running_sum(terms: FloatArray) -> FloatArray:
    """Return the sums of the first 0, 1, ... terms along the second last axis."""
    total = np.zeros((*terms.shape[:-2], terms.shape[-2] + 1, terms.shape[-1]), terms.dtype)
    np.cumsum(terms, axis=-2, out=total[..., 1:, :])
    return total


def _motion_tensors(step: Step) -> FloatArray:
    """Return ``(4, 4, 4)``: constant, cosine, sine and linear part of an elementary motion."""
    axis = np.eye(3)[AXES.index(step.axis)]
    parts = np.zeros((4, 4, 4))
    if step.kind == "translation":
        parts[0], parts[3, :3, 3] = np.eye(4), axis
        return parts
    along = np.diag([*axis, 1.0])
    parts[0], parts[1], parts[2, :3, :3] = along, np.eye(4) - along, skew(axis)
    return parts
