"""What is shown of an analysis: one record for files, terminal and report."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from headstock.app.tables.table import Listing, PlainTable
from headstock.pipeline.results.results import Results


@dataclass(frozen=True)
class Shares:
    """Shares of parts that the terminal draws as bars, and of what they are."""

    label: str
    shares: Mapping[str, float]


type TerminalPart = Listing[Any] | Shares | str


@dataclass(frozen=True, eq=False)
class Section:
    """A section of the report.

    Attributes:
        identity: Its ``id`` in the page.
        link: Its name in the navigation; empty where that is the title.
        lead: First paragraph; empty for none.
        tables: Below the lead, each with its file.
        template: Writes what follows, such as ``views/path.html``; empty for none.
        names: What the template uses beside what every section may.
        script: A file of the report that it needs; empty for none.
        part_of: ``id`` of the section in which it is a part; empty for one of its own.
    """

    identity: str
    title: str
    link: str = ""
    lead: str = ""
    tables: Sequence[Listing[Any]] = ()
    template: str = ""
    names: Mapping[str, Any] = field(default_factory=dict)
    script: str = ""
    part_of: str = ""


def _show_nothing(_: Results) -> tuple[()]:
    """Return nothing to show."""
    return ()


@dataclass(frozen=True, kw_only=True)
class View:
    """What is shown of an analysis that a run has; each attribute takes the results of the run.

    Attributes:
        tables: For files; the report offers them, too.
        long_tables: For files only: a row per sample.
        files: Of other forms in the folder of the tables, by name.
        terminal: Tables, shares and lines in order.
        section: Of the report, or what makes it of a run; None for none.
    """

    tables: Callable[[Results], Iterable[PlainTable]] = _show_nothing
    long_tables: Callable[[Results], Iterable[PlainTable]] = _show_nothing
    files: Callable[[Results], Mapping[str, bytes]] = lambda _: {}
    terminal: Callable[[Results], Iterable[TerminalPart]] = _show_nothing
    section: Section | Callable[[Results], Section | None] | None = None

    def make_section(self, run: Results) -> Section | None:
        """Return the section of the report; None for none."""
        return self.section(run) if callable(self.section) else self.section
