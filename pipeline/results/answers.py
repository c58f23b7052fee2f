"""What every answer of an analysis can do, whatever it holds: be read in ``summary.json`` and in ``results.h5``."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import h5py

from headstock.pipeline.storage.json_texts import Json


class Answer:
    """What a stage found, frozen; the stages of several poses find one each.

    Attributes:
        units: Pattern of the path of a data set in ``results.h5`` to its unit.
    """

    units: ClassVar[dict[str, str]] = {}

    @classmethod
    def summarise(cls, found: Sequence[Self]) -> Json:
        """The keys of ``summary.json`` that tell all answers of this kind.

        Raises:
            AccuracyError: A result is not a finite number.
        """
        raise NotImplementedError

    def fill(self, file: h5py.File) -> None:
        """Write the arrays of the answer; there are none in most."""


@dataclass(frozen=True, eq=False)
class SummarisedAnswer(Answer):
    """An answer that is all in the summary.

    Attributes:
        key: In ``summary.json``.
        content: What stands there.
        pose: In which it was found; None where the analysis has no pose of its own.
    """

    key: str
    content: Json
    pose: str | None = None

    @classmethod
    def summarise(cls, found: Sequence[Self]) -> Json:
        """Each under its key, those of poses by pose."""
        summary: Json = {}
        for answer in found:
            if answer.pose is None:
                summary[answer.key] = answer.content
            else:
                summary.setdefault(answer.key, {})[answer.pose] = answer.content
        return summary


def find_answers[T: Answer](answers: Iterable[Answer], kind: type[T]) -> tuple[T, ...]:
    """Those of one kind, in the order of their stages."""
    return tuple(answer for answer in answers if isinstance(answer, kind))


def summarise_answers(answers: Sequence[Answer]) -> Json:
    """The keys of ``summary.json`` that all answers together make.

    Raises:
        AccuracyError: A result is not a finite number.
    """
    summary: Json = {}
    for kind in dict.fromkeys(type(answer) for answer in answers):
        summary |= kind.summarise(find_answers(answers, kind))
    return summary
