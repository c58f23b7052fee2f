"""The one type every analysis takes: a linear second-order system with named inputs and outputs."""

from dataclasses import dataclass

from headstock.geometry.frames import FloatArray


@dataclass(frozen=True, eq=False)
class SecondOrderSystem:
    """``M q'' + C q' + K q = B f``, ``y = B^T q`` for collocated ports and ``y = L q`` in general.

    Attributes:
        mass: ``(n, n)`` symmetric, positive semidefinite.
        damping: ``(n, n)`` or None.
        stiffness: ``(n, n)``; symmetric unless control or gyroscopic terms are in it.
        inputs: Port label such as ``("tcp", "z")`` to generalised load ``(n,)`` of a unit load there.
        outputs: Port label to row ``(n,)`` that gives the motion there.
        labels: A name for each dof.
    """

    mass: FloatArray
    damping: FloatArray | None
    stiffness: FloatArray
    inputs: dict[tuple[str, str], FloatArray]
    outputs: dict[tuple[str, str], FloatArray]
    labels: tuple[str, ...]
