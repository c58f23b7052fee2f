"""Numbers and tables of a page in HTML, and data that its scripts read."""

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence

from markupsafe import Markup

from headstock.app.drawings.figures import JOINT_COLOR
from headstock.app.tables.table import Column, drop_noise, find_unit, find_unit_scales
from headstock.app.texts.bounded_values import raise_digits, show_bound, show_bounded


def show_number(
    value: float | None, digits: int = 4, missing: str = "–", scale: float = 0.0
) -> Markup:
    """A number to so many significant digits, with its full value beside it for machines.

    Args:
        value: None where there is none.
        missing: Shown without a value.
        scale: Size of the numbers beside it, of which it may be the roundoff.
    """
    if value is None:
        return Markup('<span class="missing">{}</span>').format(missing)
    return write_data(value, format_number(drop_noise(value, scale), digits))


def format_number(value: float, digits: int = 4) -> str:
    """A number for readers: thousands apart, a true minus, tiny and huge ones with a power of
    ten.
    """
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f")
    if value == 0.0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        mantissa, _, exponent = f"{value:.{digits - 2}e}".partition("e")
        return f"{mantissa}·10{raise_digits(int(exponent))}".replace("-", "−")
    whole = len(str(int(abs(value)))) if abs(value) >= 1.0 else 0
    return f"{value:,.{max(0, digits - whole)}f}".replace(",", "\u202f").replace("-", "−")


def draw_rows[Row](
    columns: Sequence[Column[Row]],
    rows: Iterable[Row],
    identity: str,
    colors: Mapping[str, str] | None = None,
) -> Markup:
    """A table of the report, of the columns that it has there and that say something.

    Args:
        rows: As the columns take them.
        identity: ``id`` in the page.
        colors: Name in the first column to the colour of a dot before it.
    """
    rows = list(rows)
    shown = [
        column
        for column in columns
        if column.report and (column.missing or any(column.value(row) is not None for row in rows))
    ]
    scales, body, numeric = find_unit_scales(shown, rows), [], [False] * len(shown)
    for row in rows:
        cells = []
        for place, column in enumerate(shown):
            value = column.value(row)
            numeric[place] |= isinstance(value, int | float)
            cells.append(_row_cell(column, row, scales.get(find_unit(column), 0.0)))
        if colors is not None:
            dot = Markup('<td class="name"><span class="dot" style="background:{}"></span> {}</td>')
            cells[0] = dot.format(
                colors.get(str(shown[0].value(row)), JOINT_COLOR), shown[0].value(row)
            )
        body.append(Markup("<tr>{}</tr>\n").format(Markup("").join(cells)))
    heads = [
        Markup('<th class="number">{}</th>' if number else "<th>{}</th>").format(column.report)
        for column, number in zip(shown, numeric, strict=True)
    ]
    table = Markup(
        '<div class="scroll"><table id="{}"><thead><tr>{}</tr></thead><tbody>\n{}</tbody></table></div>'
    )
    return table.format(identity, Markup("").join(heads), Markup("").join(body))


def _row_cell[Row](column: Column[Row], row: Row, scale: float) -> Markup:
    value, error = column.value(row), None if column.error is None else column.error(row)
    if isinstance(value, str):
        return Markup("<td>{}</td>").format(value)
    if value is not None and error is not None:
        bound = Markup('<span class="soft">{}</span>').format(write_bound(error, value))
        return Markup('<td class="number">{} {}</td>').format(write_bounded(value, error), bound)
    if value is not None and column.show is not None:
        return Markup('<td class="number">{}</td>').format(
            write_data(value, typeset(column.show(value)))
        )
    return Markup('<td class="number">{}</td>').format(
        show_number(value, column.digits, column.missing or "–", scale)
    )


def write_bounded(value: float, error: float | None) -> Markup:
    """A value to the decimal at which its error ends."""
    return write_data(value, typeset(show_bounded(value, error)))


def write_bound(error: float | None, value: float | None, known: float | None = None) -> Markup:
    """An error beside its value; its number is rounded up, which its class says. Of one with unknown
    sources, what is known.
    """
    return write_error(error, show_bound(value, error, known))


def write_error(error: float | None, text: str) -> Markup:
    """Write the error behind a value; nothing where there is nothing to say."""
    if error is None or not math.isfinite(error) or not text:
        return Markup('<span class="missing">{}</span>').format(text)
    return Markup('± <data class="bound" value="{}">{}</data>').format(
        repr(error), typeset(text.removeprefix("± "))
    )


def typeset(text: str) -> str:
    """A plain number as readers know it: thousands apart, a true minus, a power of ten."""
    mantissa, exponent, power = text.partition("e")
    whole, point, decimals = mantissa.partition(".")
    whole = re.sub(r"(?<=\d)(?=(\d{3})+$)", "\u202f", whole)
    return (
        f"{whole}{point}{decimals}{f'·10{raise_digits(int(power))}' if exponent else ''}".replace(
            "-", "−"
        )
    )


def write_data(value: float, text: str) -> Markup:
    """Write a number as a text, with its full value for machines."""
    return Markup('<data value="{}">{}</data>').format(repr(value), text)


def script_json(content: Mapping[str, object]) -> str:
    """JSON that no browser takes for the end of the script element it stands in, nor for a line
    break in a script.
    """
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text
