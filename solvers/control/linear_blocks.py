"""Small linear blocks ``x' = A x + B u``, ``y = C x + D u``, and how they are put together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray


@dataclass(frozen=True, eq=False)
class LinearBlock:
    """A linear system without names.

    Attributes:
        a: ``(n, n)``.
        b: ``(n, n_inputs)``.
        c: ``(n_outputs, n)``.
        d: ``(n_outputs, n_inputs)``.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray

    @staticmethod
    def gain(*factors: float) -> "LinearBlock":
        """A weighted sum of inputs, without states."""
        count = len(factors)
        return LinearBlock(np.zeros((0, 0)), np.zeros((0, count)), np.zeros((1, 0)), np.array([factors], dtype=float))


def connect_in_series(first: LinearBlock, second: LinearBlock) -> LinearBlock:
    """The second block fed by the first."""
    a = np.block([[first.a, np.zeros((len(first.a), len(second.a)))], [second.b @ first.c, second.a]])
    return LinearBlock(
        a=a,
        b=np.vstack([first.b, second.b @ first.d]),
        c=np.hstack([second.d @ first.c, second.c]),
        d=second.d @ first.d,
    )


def stack_blocks(blocks: Sequence[LinearBlock]) -> LinearBlock:
    """Blocks side by side, none of which sees another."""
    parts = ("a", "b", "c", "d")
    return LinearBlock(*(np.asarray(scipy.linalg.block_diag(*(getattr(block, part) for block in blocks))) for part in parts))
