"""What a fault campaign reports."""

from collections import Counter
from dataclasses import dataclass, field

from headstock.geometry.errors import HeadstockError


class CampaignError(HeadstockError):
    """A fault campaign found something torn, wrong or left behind."""


@dataclass
class CampaignOutcome:
    """Tally of a campaign, filled in while it runs.

    Attributes:
        name: Of the campaign.
        trials: How many were made.
        happened: How they ended, in words, and how often.
        faults: What should never happen, each with the trial it happened in.
        slowest_seconds: Longest trial, where trials are bounded.
        peak_mb: Largest memory of a trial, where it is bounded [MB].
        notes: Where a campaign had to make do with less.
    """

    name: str
    trials: int = 0
    happened: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest_seconds: float = 0.0
    peak_mb: float = 0.0
    notes: list[str] = field(default_factory=list)

    def note_trial(self, ending: str, *, seconds: float = 0.0) -> None:
        """Count a trial by how it ended."""
        self.trials += 1
        self.happened[ending] += 1
        self.slowest_seconds = max(self.slowest_seconds, seconds)
