"""Results in a few lines, as Python and notebooks show them."""

import html
from collections.abc import Sequence
from dataclasses import dataclass, field

MOST_ROWS = 20  # of a table in a notebook


@dataclass(frozen=True)
class ShortForm:
    """What is shown of a result.

    Attributes:
        facts: What they are about, and a few words each.
        head: Of its table; empty without one.
    """

    title: str
    facts: Sequence[tuple[str, str]]
    head: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = field(default=())

    def text(self) -> str:
        """Return the title and a line per fact."""
        return "\n".join([self.title, *(f"  {name}: {words}" for name, words in self.facts)])

    def html(self) -> str:
        """Return title, facts and the first rows of the table as HTML."""
        facts = "".join(
            f"<li><b>{html.escape(name)}</b>: {html.escape(words)}</li>"
            for name, words in self.facts
        )
        found = f"<p><b>{html.escape(self.title)}</b></p><ul>{facts}</ul>"
        if not self.head:
            return found
        head = "".join(f"<th>{html.escape(name)}</th>" for name in self.head)
        rows = "".join(
            f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>"
            for row in self.rows[:MOST_ROWS]
        )
        more = len(self.rows) - MOST_ROWS
        rest = f"<p>and {more} more rows: to_pandas has them all</p>" if more > 0 else ""
        return f"{found}<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{rest}"


class Displayed:
    """A result that Python and notebooks show in its short form."""

    def _short_form(self) -> ShortForm:
        raise NotImplementedError

    def __repr__(self) -> str:
        return self._short_form().text()

    def _repr_html_(self) -> str:
        """Return it as a notebook shows it."""
        return self._short_form().html()


def show_short(value: object) -> str:
    """Return a number with six digits at most, or a text; a dash for nothing."""
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def list_few(names: Sequence[str], most: int = 6) -> str:
    """Return the first names, and how many there are where they are more."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown}, ... ({len(names)})"
