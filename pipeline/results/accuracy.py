"""How settings were chosen for a stated accuracy, as a result."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NotRequired, TypedDict

from headstock.pipeline.results.answers import Answer


class RoundSummary(TypedDict):
    """The entry of a round; without an owner where no component is meshed, without changes where
    the search ended with it.
    """

    quantity: str
    error: float | None
    reason: str
    owner: NotRequired[str]
    source: NotRequired[str]
    changes: NotRequired[dict[str, str]]


class AccuracySummary(TypedDict):
    """The entry ``accuracy``."""

    requested: float
    estimated: float | None
    met: bool
    reason: str
    rounds: list[RoundSummary]
    settings: dict[str, str]


@dataclass(frozen=True)
class AccuracyRound:
    """A round of a search for settings.

    Attributes:
        quantity: The number that is furthest off.
        error: By how much of it; None where nobody knows.
        reason: Why something is refined, in plain words.
        owner: Component that makes most of the error, and how; None where no component is meshed.
        changes: Component to what is changed of its settings; None where the search ends.
    """

    quantity: str
    error: float | None
    reason: str
    owner: tuple[str, str] | None = None
    changes: Mapping[str, str] | None = None

    def summarise(self) -> RoundSummary:
        """As it stands in ``summary.json``."""
        summary: RoundSummary = {
            "quantity": self.quantity,
            "error": self.error,
            "reason": self.reason,
        }
        if self.owner is not None:
            summary["owner"], summary["source"] = self.owner
        if self.changes is not None:
            summary["changes"] = dict(self.changes)
        return summary


@dataclass(frozen=True)
class AccuracyAnswer(Answer):
    """How a search for settings went.

    Attributes:
        requested: Largest relative error allowed.
        rounds: One and more.
        settings: Component to its mesh and modes in the end, in the words of a scene.
        reason: Why the accuracy was not reached; empty when it was.
    """

    requested: float
    rounds: tuple[AccuracyRound, ...]
    settings: dict[str, str]
    reason: str = ""

    @property
    def met(self) -> bool:
        """The accuracy was reached."""
        return not self.reason

    @property
    def estimated(self) -> float | None:
        """Relative error of the worst number in the last round."""
        return self.rounds[-1].error

    def summarise(self) -> AccuracySummary:
        """As it stands in ``summary.json``."""
        return {
            "requested": self.requested,
            "estimated": self.estimated,
            "met": self.met,
            "reason": self.reason,
            "rounds": [one.summarise() for one in self.rounds],
            "settings": self.settings,
        }
