"""How values and their errors read: one rounding rule, ``77.4 ± 0.6``, for terminal, report and
CSV; and what is in an error.

An error keeps two digits where it begins with 1 or 2, else one, and is never rounded down; its
value ends at the same decimal. A value has at most five significant digits: an error below its last
one is shown as less than that digit. Where no error is known it has three, whatever model it is of.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_HALF_EVEN, Decimal

from headstock.pipeline.answers.accuracy import AccuracyAnswer, ModelErrorsAnswer
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.lobes import MM, DirectionLobes, PoseLobes
from headstock.pipeline.answers.transient import TransientAnswer, peak_key
from headstock.pipeline.numbers.estimates import (
    DISCRETISATION,
    FIT,
    INTERFACE,
    MODEL,
    REDUCTION,
    known_part,
    list_left_out,
    show_share,
)

MOST_DIGITS = 5  # significant ones of a value, however small its error is
UNKNOWN_DIGITS = 3  # of a value whose error nobody knows
LARGE_FIRST_DIGIT = 3  # an error that begins with it or more keeps one digit
# power of ten of the last digit; below it numbers are written with an exponent
LEAST_POSITIONAL = -9
NO_BOUND = "± ?"
AND_MORE = "+ ?"  # behind the part of an error that is known, where other sources are not
WITHOUT_BOUND = {
    REDUCTION: "no bound of the reduction error: the range lies beyond the cut-off of the modes kept",
    DISCRETISATION: "nothing is known of the discretisation error",
}
# of modes whose ± has no part from a source
LACKING = {
    REDUCTION: "beyond the cut-off of the modes kept, where there is no bound; see the warnings",
    DISCRETISATION: "parts take part whose mesh error is not known",
    MODEL: "with elastic bodies in place of rigid and segmented ones no mode has this shape",
    FIT: "with parameters at the ends of their intervals no mode has this shape",
    INTERFACE: "with deformation shapes at rigid joints no mode has this shape; see the warnings",
}
FREE = "free"  # in place of a compliance that a free motion of the machine leaves open


def bound_size(value: float | None, error: float | None) -> float | None:
    """Return the number behind ±: the error rounded up by the rule, at least the last digit
    that the value may have.
    """
    size = None if value is None else _round(value, error).size
    return None if size is None else float(size)


def show_bound(value: float | None, error: float | None, known: float | None = None) -> str:
    """``± 0.6``, ``± <0.001`` below the last digit that the value may have, ``± ?`` where no error
    is known, ``± 0.6 + ?`` where a part of it is; nothing without value.

    Args:
        value: What may be off.
        error: By how much; None where a source has no bound.
        known: Sum of the sources that have one.
    """
    if value is None:
        return ""
    found = _round(value, error)
    if found.size is None and known is not None and math.isfinite(known):
        return f"{show_bound(value, known)} {AND_MORE}"
    return NO_BOUND if found.size is None else f"± {'<' if found.below else ''}{_write(found.size)}"


def show_bounded(value: float, error: float | None = None) -> str:
    """A value to the decimal at which its error ends; a dash for none."""
    if not math.isfinite(value):
        return "-"
    last = _round(value, error).last
    return (
        "0"
        if last is None
        else _write(Decimal(repr(float(value))).quantize(last, rounding=ROUND_HALF_EVEN))
    )


def show_digits(value: float, digits: int) -> str:
    """A number to so many significant digits, with their zeros and without a bare point: ``99.50``,
    ``1010``.
    """
    exact = Decimal(repr(float(value)))
    return (
        _write(exact.quantize(Decimal(1).scaleb(exact.adjusted() - digits + 1))) if exact else "0"
    )


def show_error(error: float | None) -> str:
    """An error by itself, rounded as behind ±."""
    size = _round(0.0, error).size
    return "?" if size is None else _write(size)


def raise_digits(power: int) -> str:
    """A power of ten as an exponent is typeset: ``⁻³``."""
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def show_compliances(
    matrix: Sequence[Sequence[float | None]], column: int, errors: Mapping[str, float | None]
) -> list[str]:
    """Motions in x, y and z under a force in one direction; across the force as coarse as along
    either direction.

    Args:
        matrix: ``(3, 3)`` compliances, a column per force; None where a free motion leaves it open.
        errors: Direction to how far the compliance along it may be off; those that are missing are
            not known.
    """
    along = [(matrix[place][place], errors.get(direction)) for place, direction in enumerate("xyz")]
    lasts = [None if value is None else _round(value, error).last for value, error in along]
    shown = []
    for row, values in enumerate(matrix):
        known, value = (
            [last for last in (lasts[row], lasts[column]) if last is not None],
            values[column],
        )
        if value is None:
            shown.append(FREE)
        else:
            exact = Decimal(repr(float(value)))
            shown.append(
                _write(exact.quantize(max(known), ROUND_HALF_EVEN))
                if known
                else show_bounded(value)
            )
    return shown


def show_damped(hz: float | None, error: float | None, *, rigid: bool) -> tuple[str, str]:
    """Frequency of the damped oscillation of a mode [Hz], and what stands behind it.

    Args:
        hz: Of the oscillation; zero where the mode is overdamped, None where nothing damps.
        error: How far it may be off; None where that is not known.
        rigid: A rigid-body mode, whose error is not shown.
    """
    if not hz:
        return "-" if hz is None else "overdamped", ""
    return show_bounded(hz, error), "" if rigid else show_bound(hz, error)


def show_damping(ratio: float | None) -> str:
    """A damping ratio in per cent, to three digits."""
    if ratio is None:
        return "-"
    return f"{show_digits(100.0 * ratio, 3)} %"


def show_damping_error(ratio: float | None, error: float | None, *, rigid: bool) -> tuple[str, str]:
    """Damping ratio of a mode in per cent, and what stands behind it.

    Args:
        ratio: Damping ratio; None where nothing damps.
        error: How far it may be off; zero where the scene gives the ratio.
        rigid: A rigid-body mode, whose error is not shown.
    """
    if ratio is None:
        return "-", ""
    if error == 0.0:  # as the scene gives it
        return show_damping(ratio), "± 0"
    percent, off = 100.0 * ratio, None if error is None else 100.0 * error
    known = "" if rigid else show_bound(percent, off)
    shown = show_bounded(percent, off) if known and off is not None else show_digits(percent, 3)
    return f"{shown} %", f"{known} %" if known and known != NO_BOUND else known


@dataclass(frozen=True)
class _Rounded:
    """An error as it is printed (None: not known), whether it is below what is printed, and the
    last digit of its value.
    """

    size: Decimal | None
    below: bool
    last: Decimal | None


def _round(value: float, error: float | None) -> _Rounded:
    if error is None or not math.isfinite(error):
        return _Rounded(None, below=False, last=_last_digit(value, UNKNOWN_DIGITS))
    # nine digits: a unit of roundoff is no reason to round up
    exact, finest = Decimal(f"{abs(error):.9e}"), _last_digit(value)
    if finest is not None and exact < finest:
        return _Rounded(finest, below=True, last=finest)
    if not exact:
        return _Rounded(Decimal(0), below=False, last=None)
    size = exact
    for _ in range(2):  # 0.296 rises to 0.30, which begins with 3: 0.3
        digit = _error_digit(size)
        size = size.quantize(
            digit if finest is None else max(digit, finest), rounding=ROUND_CEILING
        )
    return _Rounded(size, below=False, last=Decimal(1).scaleb(int(size.as_tuple().exponent)))


def _error_digit(error: Decimal) -> Decimal:
    """The last digit that is worth printing of an error."""
    place = error.adjusted()
    return Decimal(1).scaleb(place - 1 if error.scaleb(-place) < LARGE_FIRST_DIGIT else place)


def _last_digit(value: float, digits: int = MOST_DIGITS) -> Decimal | None:
    return Decimal(1).scaleb(Decimal(repr(float(value))).adjusted() - digits + 1) if value else None


def _write(number: Decimal) -> str:
    if not number:
        return "0"
    return f"{number:e}" if int(number.as_tuple().exponent) < LEAST_POSITIONAL else f"{number:f}"


def show_span(span: Sequence[float] | None) -> str:
    """Lowest and highest frequency with averaging and rigid interfaces."""
    return "-" if span is None else f"{span[0]:.4g} .. {span[1]:.4g}"


type Shares = Sequence[Mapping[str, float | None]]  # of ± of each number, by source


def largest_shares(shares: Shares) -> dict[str, float]:
    """Return the largest part [Hz] of each source over the elastic modes of a pose where it is known."""
    return largest_parts((1.0, parts) for parts in shares)[0]


def largest_parts(
    numbers: Iterable[tuple[float, Mapping[str, float | None]]],
) -> tuple[dict[str, float], list[str]]:
    """Return the largest part of ± by source, relative to its number, and sources without a bound.

    Args:
        numbers: Each with the parts of its ± by source, in its unit; None where nothing is known. Zero
            has no relative part.
    """
    largest: dict[str, float] = {}
    unknown: dict[str, None] = {}
    for number, parts in numbers:
        for source, size in parts.items():
            if size is None:
                unknown[source] = None
            else:
                share = size / abs(number) if number else 0.0
                largest[source] = max(largest.get(source, 0.0), share)
    return largest, list(unknown)


def show_parts(largest: Mapping[str, float]) -> str:
    """Write largest parts of ± by source."""
    return ", ".join(f"{source} up to {show_share(share)}" for source, share in largest.items())


def shares_begin(shares: Shares) -> str:
    """Return the words before the largest shares of a pose: what ± covers, unless none is complete."""
    complete = any(share and None not in share.values() for share in shares)
    return "± covers 95 % of errors, from" if complete else "known of ±, not all:"


def share_words(shares: Shares) -> list[str]:
    """Say how much of ± each source makes at most; nothing where none is known."""
    found = ", ".join(
        f"{source} up to {show_error(size)} Hz" for source, size in largest_shares(shares).items()
    )
    return [f"{shares_begin(shares)} {found}"] if found else []


def error_words(shares: Shares, left_out: Sequence[str]) -> list[str]:
    """Say what is not in the errors of frequencies of elastic modes, and where there are none."""

    def mark(source: str) -> str | None:
        """Mark modes whose error lacks a source; None where none does."""
        lacking = [share for share in shares if share.get(source, 0.0) is None]
        partly = any(known_part(share) is not None for share in lacking)
        wholly = any(known_part(share) is None for share in lacking)
        marks = [NO_BOUND] * wholly + [f"± .. {AND_MORE}"] * partly
        return ", ".join(marks) or None

    return left_out_words(left_out) + [
        f"{marked} : {why}" for source, why in LACKING.items() if (marked := mark(source))
    ]


def left_out_words(left_out: Sequence[str], *, known: bool = True) -> list[str]:
    """Say what is not in ±; nothing where all is.

    Args:
        known: Something is known of ±.
    """
    begin = "not in ±:" if known else f"{NO_BOUND} : nothing is known of"
    return [f"{begin} {'; '.join(left_out)}"] if left_out else []


def response_error_words(response: PoseResponse) -> list[str]:
    """Say how far the lines of a frequency response may be off, by source, and what is not in it; empty
    where nothing is known.
    """
    errors = response.curves.line_errors
    if errors is None:
        return left_out_words(response.error_left_out, known=False)
    unknown = [
        WITHOUT_BOUND.get(source, f"nothing is known of {source}")
        for source, shares in errors.sources.items()
        if shares is None
    ]
    parts = [
        f"{source} {100 * shares.median_share:.2g} % of a line in the median, at most {100 * shares.largest_share:.2g} % at "
        f"{shares.largest_share_hz:.4g} Hz"
        for source, shares in errors.sources.items()
        if shares is not None
    ]
    words = [f"{NO_BOUND} : {'; '.join(unknown)}"] if unknown else []
    if parts:
        begin = "known are" if unknown else "± covers 95 % of errors, from"
        words.append(f"{begin} {'; '.join(parts)}")
    if not unknown and errors.bounded_to_hz < response.curves.frequencies_hz[-1]:
        words.append(f"no bound above {errors.bounded_to_hz:.4g} Hz")
    return words + left_out_words(response.error_left_out)


def limit_error_words(lobes: Sequence[PoseLobes]) -> list[str]:
    """Directions without a limit, where the errors of the lowest limits come from, and what is not in
    them.
    """
    words = [
        f"pose {found.pose}, travel {own.name}: no cut up to {MM * found.deepest:g} mm chatters at a speed that was looked at"
        for found in lobes
        for own in found.directions
        if own.lowest is None
    ]
    directions = [own for found in lobes for own in found.directions]
    largest, _ = largest_parts(
        (float(own.depths[own.lowest.place]), own.lowest_errors[0].shares)
        for own in directions
        if own.lowest is not None
    )
    if largest:
        words.append(f"± of a lowest limit from {show_parts(largest)}")
    left_out = dict.fromkeys(words for own in directions for words in own.left_out)
    if left_out:
        what = "not in ±" if largest else "no ± of the lowest limits"
        words.append(f"{what}: {'; '.join(left_out)}")
    return words


def show_best_depth(direction: DirectionLobes, best: int) -> str:
    """Limit depth at a best speed [mm], with its ±; that it is above the deepest cut where there is
    none.
    """
    depth, error = float(MM * direction.depths[best]), float(MM * direction.errors[best])
    if not direction.limited[best]:
        return f"above {depth:.3g}"
    if not math.isfinite(error):
        return f"{depth:.3g}"
    return f"{show_bounded(depth, error)} {show_bound(depth, error)}"


def transient_words(found: TransientAnswer) -> list[str]:
    """Say what a settling time means, where the errors of peaks come from, and how the energy adds up."""
    words = [f"settled: within {100 * found.settled:g} % of the way, or of the peak"]
    largest, unknown = largest_parts(
        (figures.peak, found.error_of(peak_key(found.curves.pose, channel)).shares)
        for channel, figures in zip(found.curves.outputs, found.figures, strict=True)
    )
    known = {source: share for source, share in largest.items() if source not in unknown}
    if known:
        words.append(f"± of a peak, from {show_parts(known)}")
    if unknown:
        words.append(f"{NO_BOUND} : nothing is known of {', '.join(unknown)}")
    words += left_out_words(list_left_out(found.errors.values()))
    energy = found.energy
    if energy is not None:
        words.append(
            f"energy: {energy.initial:.3g} J at the beginning, {energy.work:.3g} J of work, {energy.dissipated:.3g} J dissipated,"
            f" {energy.final:.3g} J left; the balance closes within {show_share(energy.error)} of the largest"
        )
    if not found.damped:
        words.append("nothing is damped, so nothing settles")
    return words


def model_words(models: ModelErrorsAnswer) -> str:
    """Say what all rigid and segmented bodies together leave out."""
    changes = {
        str(key): abs(change) for key, change in models.changes.items() if change is not None
    }
    most = max(changes, key=lambda name: changes[name], default="")
    lost = len(models.changes) - len(changes)
    words = f"together up to {show_share(changes.get(most, 0.0))}" + (f" of {most}" if most else "")
    if lost:
        words += f"; {lost} of {len(models.changes)} numbers have no mode of their shape then"
    return f"{words}; part of every ± as `{MODEL}`"


def accuracy_words(found: AccuracyAnswer, responses: Iterable[PoseResponse] = ()) -> list[str]:
    """Say how settings were chosen for an accuracy: what was asked for, what is reached, with which
    settings, and that lines of frequency responses are further off, where they are.
    """
    rounds, asked = found.rounds, f"accuracy {100.0 * found.requested:g} %"
    if not any(each.owner and each.owner[0] is not None for each in rounds):
        return [
            f"{asked}: nothing to choose, since no number has an error of a mesh or of modes left out"
        ]
    settings = "; ".join(f"{name}: {words}" for name, words in found.settings.items())
    state = "met" if found.met else "not met"
    count = f"{len(rounds)} round{'s' if len(rounds) != 1 else ''}"
    words = f"{asked} {state} in {count}: {rounds[-1].quantity} within {_show_reached(found.estimated)}, the others closer"
    if (own := found.responses) is not None:
        words += (
            f"; peaks and static levels of frequency responses {'met' if own.met else 'did not meet'} it:"
            f" {own.quantity} within {_show_reached(own.error)}"
        )
    share, at_hz, pose = max(_list_line_errors(responses), default=(0.0, 0.0, ""))
    if share > found.requested:
        words += (
            f"; single lines of the frequency response are no part of it: up to {100.0 * share:.2g} % off"
            f" at {at_hz:.4g} Hz in pose {pose}"
        )
    lines = [
        f"  {name}: {body.model}; {body.why}"
        + (f". Next: {body.following}" if body.following else "")
        for name, body in found.models.items()
    ]
    return [words, *(lines or filter(None, [settings]))]


def _show_reached(share: float | None) -> str:
    return "an unknown amount" if share is None else f"{100.0 * share:.2g} %"


def _list_line_errors(responses: Iterable[PoseResponse]) -> list[tuple[float, float, str]]:
    """Largest share of a line by source, its frequency [Hz] and the pose."""
    return [
        (shares.largest_share, shares.largest_share_hz, response.curves.pose)
        for response in responses
        if (errors := response.curves.line_errors) is not None
        for shares in errors.sources.values()
        if shares is not None
    ]
