"""What parts of a machine's model move and cost, as blocks and sentences on a terminal."""

import textwrap
from collections.abc import Sequence

from headstock.pipeline.numbers.estimates import show_share
from headstock.studies.kind_changes import Change
from headstock.studies.model_worth import ModelFinding, RunPrice

COLUMNS = 100
SHOWN = 4  # answers per change
IDLE = 1e-5  # largest change of what is listed together at the end


def print_findings(findings: Sequence[ModelFinding]) -> None:
    """A block per change of the model that moves anything, those that move most for their price
    first, then a line per change; those that move nothing to speak of share one.
    """
    tried = [each for each in findings if not each.obstacle]
    if not findings:
        return
    print("\nModels, one change at a time; processor seconds with meshing and reduction")
    if tried:
        print(f"as written: {_show_price(tried[0].written)}")
    idle = [each for each in tried if each.worth < IDLE]
    for each in [each for each in tried if each not in idle]:
        print(f"\n{each.trial.name} ({_show_price(each.tried)})")
        for what, modes in (("lacks", each.missing), ("adds", each.added)):
            for mode in modes[:SHOWN]:
                print(f"  {what} {mode}")
            if len(modes) > SHOWN:
                print(f"  {what} {len(modes) - SHOWN} more")
        for change in [change for change in each.changes if change.share > IDLE][:SHOWN]:
            # its modes are named above
            if change.without is not None and change.present is not None:
                print(f"  {change.label:<28} {show_share(change.share):>9}   {_describe(change)}")
    print("\nSummary of models, worth over price")
    for each in [each for each in findings if each not in idle]:
        _print_entry(each.trial.name, each.verdict)
    if idle:
        _print_entry(f"less than {show_share(IDLE)}", "; ".join(each.trial.name for each in idle))


def _print_entry(head: str, words: str) -> None:
    """A line, or a head with indented lines below it where one would be too long."""
    line = f"  {head}: {words}"
    print(line if len(line) <= COLUMNS else f"  {head}:\n{_indent(words)}")


def _indent(words: str) -> str:
    return textwrap.fill(words, COLUMNS, initial_indent="      ", subsequent_indent="      ")


def _show_price(price: RunPrice) -> str:
    """Processor time with two digits, and peak memory."""
    seconds = price.cpu_seconds
    time = f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"
    return f"{time}, {price.peak_memory_mb:.0f} MB"


def _describe(change: Change) -> str:
    shown = change.summarise()
    written, tried = (
        f"{value:.5g}" for value in (shown["present"], shown["without"]) if value is not None
    )
    return f"{written} → {tried} {shown['unit']} ({change.place})"
