"""Test data: measured points, frequency responses and mode shapes, whatever file they came in.

Everything is SI, in the axes of the test: placing them on a model is a later step.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from headstock.geometry.frames import FloatArray

IntArray = npt.NDArray[np.int64]
ComplexArray = npt.NDArray[np.complex128]
type Vector = tuple[float, float, float]


def as_vector(values: Iterable[float]) -> Vector:
    """Three numbers as Python's, without a negative zero."""
    x, y, z = (float(value) + 0.0 for value in values)
    return x, y, z


@dataclass(frozen=True)
class TestPoint:
    """A point of a test.

    Attributes:
        name: Number or label, as the file writes it.
        position: In the axes of the test [m].
        axes: Columns are the local x y z in the axes of the test, row by row; identity when the
            point has no coordinate system of its own.
        part: Part on which the point lies, where the file says so.
    """

    __test__ = False  # not a test case, for pytest

    name: str
    position: Vector
    axes: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    part: str | None = None


@dataclass(frozen=True)
class TestChannel:
    """A direction in which a point was measured or excited.

    Attributes:
        direction: Unit vector in the axes of the test.
    """

    __test__ = False

    point: str
    direction: Vector


def same_line(motion: TestChannel, force: TestChannel, tolerance: float) -> float:
    """Return 1 for channels at one point along one line, -1 where they are against each other, 0 for
    others.

    Args:
        tolerance: Of the cosine between both.
    """
    cosine = float(np.dot(motion.direction, force.direction))
    same = motion.point == force.point and abs(cosine) > 1.0 - tolerance
    return float(np.sign(cosine)) if same else 0.0


@dataclass(frozen=True, eq=False)
class MeasuredResponses:
    """Measured frequency responses.

    Attributes:
        frequencies_hz: ``(l,)`` increasing.
        motions: ``m`` channels.
        forces: ``f`` channels.
        values: ``(l, m, f)`` displacement over force [m/N]; nan for a pair that was not measured.
        deviations: ``(l, m, f)`` standard deviations of the values [m/N], from coherence or repeated
            measurements; None where unknown.
    """

    frequencies_hz: FloatArray
    motions: tuple[TestChannel, ...]
    forces: tuple[TestChannel, ...]
    values: ComplexArray
    deviations: FloatArray | None = None

    def pick(
        self,
        *,
        lines: Sequence[int] | IntArray | None = None,
        motions: Sequence[int] | IntArray | None = None,
        forces: Sequence[int] | IntArray | None = None,
    ) -> "MeasuredResponses":
        """Return some of them by their indices; all where None."""
        chosen = [
            np.arange(size) if some is None else np.asarray(some, dtype=np.int64)
            for some, size in zip((lines, motions, forces), self.values.shape, strict=True)
        ]
        part = np.ix_(*chosen)
        return MeasuredResponses(
            self.frequencies_hz[chosen[0]],
            tuple(self.motions[index] for index in chosen[1]),
            tuple(self.forces[index] for index in chosen[2]),
            self.values[part],
            None if self.deviations is None else self.deviations[part],
        )

    def exchange(self) -> "MeasuredResponses":
        """Return them with motions and forces exchanged, which reciprocity allows."""
        deviations = None if self.deviations is None else self.deviations.transpose(0, 2, 1)
        values = self.values.transpose(0, 2, 1)
        return MeasuredResponses(self.frequencies_hz, self.forces, self.motions, values, deviations)


@dataclass(frozen=True, eq=False)
class MeasuredModes:
    """Measured poles and shapes.

    Attributes:
        frequencies_hz: ``(k,)`` undamped natural frequencies, increasing.
        damping: ``(k,)`` damping ratios; nan where unknown.
        channels: Where and in which direction the shapes were measured: what was not is left out.
        shapes: ``(c, k)`` displacement.
        scaled: The shapes have modal mass one [kg^-1/2], in the convention ``H = sum of phi phi^T / (s -
            p) / (2 i omega_d)`` and its conjugate; otherwise their sizes mean nothing.
    """

    frequencies_hz: FloatArray
    damping: FloatArray
    channels: tuple[TestChannel, ...]
    shapes: ComplexArray
    scaled: bool = False


@dataclass(frozen=True, eq=False)
class TestData:
    """What a test says.

    Attributes:
        lines: Names of points that are joined by lines in pictures.
        responses: Frequency responses; None without.
        modes: Poles and shapes; None without.
        remarks: What the reader assumed: units, axes, signs, numbering.
    """

    __test__ = False

    points: dict[str, TestPoint] = field(default_factory=dict)
    lines: tuple[tuple[str, ...], ...] = ()
    responses: MeasuredResponses | None = None
    modes: MeasuredModes | None = None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class TableRow:
    """A row of a table of places.

    Attributes:
        line: Of the file.
        name: Label, or the number of the row where the table names none.
        component: Name; empty where the table has no such column.
        position: [m].
        directions: As written; empty where the table has no such column.
        mass: [kg]; None where the table has no such column.
        measured: Unit vectors of what was measured or excited there; of files of test data.
    """

    line: int
    name: str
    component: str
    position: Vector
    directions: str
    mass: float | None
    measured: tuple[Vector, ...] = ()
