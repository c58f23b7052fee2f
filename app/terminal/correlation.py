"""A measured machine beside its model as the terminal shows it."""

from collections.abc import Sequence
from pathlib import Path

from headstock.app.tables.correlation import (
    describe_response_errors,
    list_correlation_tables,
    shorten,
)
from headstock.app.terminal.console import counted, make_console, print_remarks
from headstock.app.terminal.summary import print_part
from headstock.studies.correlation.correlation import Correlation


def print_correlation(found: Correlation, folder: Path, files: Sequence[str]) -> None:
    """Print the verdict first, then the tables behind it, at last the names of files in a folder."""
    console = make_console()
    for number, sentence in enumerate(found.verdict):
        console.say(sentence, style="bold" if not number else None)
    print_remarks(found.warnings)
    for remark in found.remarks:
        console.say(f"note: {remark}")
    for listing in list_correlation_tables(found):
        shown, more = shorten(listing)
        print_part(console, shown)
        if more:
            console.say(f"  and {counted(more, 'row')} more in {listing.name}.csv")
    if found.responses is not None:
        console.say(f"responses computed with {found.responses.damping}")
        console.say(describe_response_errors(found.responses))
    console.say(f"results in {folder} ({', '.join(files)})", style="bold")
