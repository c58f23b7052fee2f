"""The interface of every answer of an analysis; how it reads in ``summary.json`` its own
``summarise`` says.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Self

from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.numbers.estimates import Estimate, combine_estimates
from headstock.pipeline.numbers.numbers import Key, Number, Numbers, Series

type Entry = dict[str, Any]  # a table of ``summary.json``


@dataclass(frozen=True, eq=False)
class Answer:
    """What a stage found; the stages of several poses find one each.

    Attributes:
        errors: ± of its numbers, beside them.
        entry: Its key in ``summary.json``.
        keys: The keys there, for :func:`headstock.pipeline.results.summary_keys._parse_keys`.
        units: Pattern of the path of a data set in ``results.h5`` to its unit.
    """

    entry: ClassVar[str]
    keys: ClassVar[str]
    units: ClassVar[dict[str, str]] = {}
    errors: Mapping[Key, Estimate] = field(default_factory=dict, kw_only=True)

    @property
    def place(self) -> str:
        """Pose or point that it belongs to; empty for an answer of the whole run."""
        owner = getattr(self, "pose", "")
        return owner if isinstance(owner, str) else str(owner.name)

    def summarise(self) -> Entry:
        """Return it as it stands in ``summary.json``."""
        raise NotImplementedError

    @classmethod
    def gather(cls, answers: Sequence[Self]) -> Entry:
        """Return what a summary holds of all answers of the kind, by its keys."""
        if not answers:
            return {}
        if not answers[0].place:
            return {cls.entry: answers[-1].summarise()}
        return {cls.entry: {answer.place: answer.summarise() for answer in answers}}

    def list_numbers(self) -> Iterable[Number]:
        """Yield every number with its ±; there are none in some."""
        return ()

    def index_numbers(self) -> dict[Key, Number]:
        """Return every number with its ±, by key."""
        return {number.key: number for number in self.list_numbers()}

    @property
    def numbers(self) -> Numbers:
        """Every number with its ±, by key."""
        return Numbers.collect(self.list_numbers())

    def error_of(self, key: Key) -> Estimate:
        """Return the ± of a number, without shares where there is none."""
        return self.errors.get(key, Estimate())

    def with_errors(self, new: Mapping[Key, Estimate], how: Literal["add", "replace"]) -> Self:
        """Return the answer with other ±.

        Args:
            new: ± of some of its numbers, or a part of it.
            how: Parts are added to what is known, or all of ± is replaced.
        """
        if how == "add":
            new = {
                key: combine_estimates([self.error_of(key), error]) for key, error in new.items()
            }
        return replace(self, errors={**self.errors, **new})

    def list_series(self) -> Iterable[Series]:
        """Yield every line, grid and curve; there are none in most."""
        return ()

    def fill(self, file: "h5py.File") -> None:
        """Write the arrays of the answer; there are none in most."""


def find_answers[T: Answer](answers: Iterable[Answer], kind: type[T]) -> tuple[T, ...]:
    """Those of one kind, in the order of their stages."""
    return tuple(answer for answer in answers if isinstance(answer, kind))
