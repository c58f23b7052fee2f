"""The one type every analysis takes: a linear second-order system with named inputs and outputs."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray

ComplexArray = NDArray[np.complexfloating[Any, Any]]
Port = tuple[str, str]
Motion = Literal["receptance", "mobility", "accelerance"]


@dataclass(frozen=True, eq=False)
class SecondOrderSystem:
    """``M q'' + C q' + K q = B f``, ``y = B^T q`` for collocated ports and ``y = L q`` in general.

    At a frequency above zero the stiffness is ``K + i H``; at rest and in time there is no ``H``
    (``damping_models.equivalent_viscous`` puts a viscous damping in its place).

    Attributes:
        mass: ``(n, n)`` symmetric, positive semidefinite.
        damping: ``(n, n)`` viscous, or None.
        stiffness: ``(n, n)``; symmetric unless control or gyroscopic terms are in it.
        inputs: Port label such as ``("tcp", "z")`` to generalised load ``(n,)`` of a unit load there.
        outputs: Port label to row ``(n,)`` that gives the motion there.
        labels: A name for each dof.
        hysteretic: ``(n, n)`` imaginary part ``H`` of the complex stiffness (loss factor times stiffness), or None.
    """

    mass: FloatArray
    damping: FloatArray | None
    stiffness: FloatArray
    inputs: dict[Port, FloatArray]
    outputs: dict[Port, FloatArray]
    labels: tuple[str, ...]
    hysteretic: FloatArray | None = None
