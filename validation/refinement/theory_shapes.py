"""Which mode of a beam model is which: paired with the shapes of beam theory by MAC, whatever order
they come in.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.meshing.component_mesh import IntArray
from headstock.solvers.pairing.mode_pairing import correlate_modes
from headstock.validation.references.beam_theory import (
    EndConditions,
    euler_bernoulli_shape,
    wave_numbers,
)

SLICES = 20
LEAST_MAC = 0.6  # below, no mode is said to be the one looked for
SAME_PLACE = 1e-6


@dataclass(frozen=True)
class _NamedShape:
    """A mode of beam theory.

    Attributes:
        name: ``X1``: first bending mode in x; ``T1``: first torsional mode.
        direction: Axis it moves in, 0..2; the beam's own axis for torsion.
        number: From 1.
    """

    name: str
    direction: int
    kind: Literal["bending", "torsion"]
    number: int


@dataclass(frozen=True, eq=False)
class _SectionMotions:
    """Motion of the sections of a beam in its modes.

    Attributes:
        places: ``(n,)`` of the sections along the beam, 0 to 1.
        motions: ``(m, n, 6)`` rigid motion of each section in each mode: displacement, and rotation
            times ``length`` [m].
        length: Length of the beam [m].
        gyration: ``(6,)`` weight of each motion in the kinetic energy: 1, and radius of gyration
            over length.
        axis: Direction of the beam, 0..2.
    """

    places: FloatArray
    motions: FloatArray
    length: float
    gyration: FloatArray
    axis: int


@dataclass(frozen=True)
class _PairedMode:
    """The mode of a model that is a mode of theory: its number from 0, and how alike they are."""

    index: int
    mac: float


def section_motions(
    points: FloatArray,
    displacements: FloatArray,
    *,
    axis: int,
    span: tuple[float, float],
    sides: tuple[float, float, float],
) -> _SectionMotions:
    """Rigid motions of a beam's sections that fit its modes best, slice by slice.

    Args:
        points: ``(n, 3)`` places [m].
        displacements: ``(m, n, 3)`` of each mode there.
        axis: Direction of the beam, 0..2.
        span: Where it begins and ends along the axis [m].
        sides: Of its box [m].
    """
    length = span[1] - span[0]
    along = np.asarray((points[:, axis] - span[0]) / length, dtype=np.float64)
    labels = _slice_labels(along)
    places, motions = [], []
    for label in range(int(labels.max()) + 1):
        rows = np.flatnonzero(labels == label)
        center = points[rows].mean(axis=0)
        fit = (
            np.linalg.pinv(rigid_map(points[rows], center))
            @ displacements[:, rows].reshape(len(displacements), -1).T
        )
        places.append(float(along[rows].mean()))
        motions.append(fit.T * np.repeat([1.0, length], 3))
    squares = np.array(sides) ** 2 / 12.0
    radii = np.sqrt(
        [
            squares.sum() - squares[axis] if turn == axis else squares[3 - axis - turn]
            for turn in range(3)
        ]
    )
    return _SectionMotions(
        np.array(places),
        np.stack(motions, axis=1),
        length,
        np.concatenate([np.ones(3), radii / length]),
        axis,
    )


def find_theory_shapes(
    sections: _SectionMotions, shapes: tuple[_NamedShape, ...], ends: EndConditions
) -> dict[str, _PairedMode]:
    """Return the mode of the model that each mode of theory goes with: the most alike pair first,
    then the most alike of what is left.

    A mode of the model goes with one shape only; shapes that nothing left resembles are missing: a
    model with few sections does not have them. The largest sum of MACs would be wrong here: it
    gives a first mode away to a third one that looks like it in a coarse model, and takes an
    overtone in its place.

    Args:
        sections: Motions of the beam's sections in each mode of the model.
        shapes: Modes of beam theory that are looked for.
        ends: How the beam is supported.

    Returns:
        By name of the shape, which mode it is and their MAC.

    Source: Allemang (2003) for the MAC.
    """
    weighted = (sections.motions * sections.gyration).reshape(len(sections.motions), -1)
    wanted = np.array(
        [(_theory_motions(sections, shape, ends) * sections.gyration).ravel() for shape in shapes]
    )
    macs = correlate_modes(wanted.T, weighted.T)
    found: dict[str, _PairedMode] = {}
    while macs.size and macs.max() >= LEAST_MAC:
        row, mode = (int(place) for place in np.unravel_index(np.argmax(macs), macs.shape))
        found[shapes[row].name] = _PairedMode(mode, float(macs[row, mode]))
        macs[row, :] = macs[:, mode] = 0.0
    return {shape.name: found[shape.name] for shape in shapes if shape.name in found}


def _slice_labels(along: FloatArray) -> IntArray:
    """Return which section each point belongs to: points at the same place where there are few
    places, else equal slices.
    """
    ordered = np.unique(np.round(along / SAME_PLACE)) * SAME_PLACE
    labels = (
        np.searchsorted(ordered, along - SAME_PLACE)
        if len(ordered) <= SLICES
        else (along * SLICES).astype(int).clip(0, SLICES - 1)
    )
    return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.int64)


def _theory_motions(
    sections: _SectionMotions, shape: _NamedShape, ends: EndConditions
) -> FloatArray:
    """Motion ``(n, 6)`` of the sections in a mode of theory."""
    motions = np.zeros((len(sections.places), 6))
    if shape.kind == "torsion":
        root = float(wave_numbers(ends, shape.number)[-1])
        motions[:, 3 + sections.axis] = np.sin(root * sections.places)
        return motions
    deflection, slope = euler_bernoulli_shape(ends, shape.number, sections.places)
    motions[:, shape.direction] = deflection
    turn = np.cross(np.eye(3)[sections.axis], np.eye(3)[shape.direction])
    motions[:, 3:] = np.outer(slope, turn)
    return motions


def read_shape(name: str, axis: int) -> _NamedShape:
    """Read the shape that a name such as ``X2`` or ``T1`` stands for on a beam along an axis."""
    letter, number = name[0], int(name[1:])
    if letter == "T":
        return _NamedShape(name, axis, "torsion", number)
    return _NamedShape(name, "XYZ".index(letter), "bending", number)
