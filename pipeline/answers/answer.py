"""The interface of every answer of an analysis; how it reads in ``summary.json`` its own
``summarise`` says.
"""

from collections.abc import Iterable
from typing import ClassVar

from headstock.meshing.process.libraries import h5py


class Answer:
    """What a stage found, frozen; the stages of several poses find one each.

    Attributes:
        units: Pattern of the path of a data set in ``results.h5`` to its unit.
    """

    units: ClassVar[dict[str, str]] = {}

    def fill(self, file: "h5py.File") -> None:
        """Write the arrays of the answer; there are none in most."""


def find_answers[T: Answer](answers: Iterable[Answer], kind: type[T]) -> tuple[T, ...]:
    """Those of one kind, in the order of their stages."""
    return tuple(answer for answer in answers if isinstance(answer, kind))
