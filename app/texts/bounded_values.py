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

from headstock.pipeline.answers.accuracy import AccuracySummary, ModelErrorsSummary
from headstock.pipeline.answers.frf import ResponseSummary
from headstock.pipeline.answers.lobes import BestSpeedSummary, LobesSummary
from headstock.pipeline.answers.transient import TransientSummary
from headstock.pipeline.numbers.estimates import (
    DISCRETISATION,
    INTERFACE,
    MODEL,
    REDUCTION,
    FrequencyErrors,
    known_part,
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


def largest_shares(modes: FrequencyErrors) -> dict[str, float]:
    """Return the largest part [Hz] of each source over the elastic modes of a pose where it is known."""
    shares = modes.get("error_share", [])[modes["rigid_count"] :]
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


def shares_begin(modes: FrequencyErrors) -> str:
    """Return the words before the largest shares of a pose: what ± covers, unless none is complete."""
    shares = modes.get("error_share", [])[modes["rigid_count"] :]
    complete = any(share and None not in share.values() for share in shares)
    return "± covers 95 % of errors, from" if complete else "known of ±, not all:"


def error_words(modes: FrequencyErrors) -> list[str]:
    """Say what is not in the errors of a pose's frequencies, and where there are none."""
    shares = modes.get("error_share", [])[modes["rigid_count"] :]

    def mark(source: str) -> str | None:
        """Mark modes whose error lacks a source; None where none does."""
        lacking = [share for share in shares if share.get(source, 0.0) is None]
        partly = any(known_part(share) is not None for share in lacking)
        wholly = any(known_part(share) is None for share in lacking)
        marks = [NO_BOUND] * wholly + [f"± .. {AND_MORE}"] * partly
        return ", ".join(marks) or None

    words = []
    if below := modes.get("modes_below", 0):
        words.append(
            f"{below} mode{'s' if below > 1 else ''} below the window of frequencies: not listed"
        )
    if len(sources := modes.get("damping_from", [])) > 1:
        words.append(f"damping ratios add up from {'; '.join(sources)}")
    if modes.get("interface_spread_hz"):
        words.append("interfaces: lowest and highest with every interface averaging or rigid")
    if modes.get("error_left_out"):
        words.append(f"not in ±: {'; '.join(modes['error_left_out'])}")
    if marked := mark(REDUCTION):
        words.append(
            f"{marked} : beyond the cut-off of the modes kept, where there is no bound; see the warnings"
        )
    if marked := mark(DISCRETISATION):
        words.append(f"{marked} : parts take part whose mesh error is not known")
    if marked := mark(MODEL):
        words.append(
            f"{marked} : with elastic bodies in place of rigid and segmented ones no mode has this shape"
        )
    if marked := mark(INTERFACE):
        words.append(
            f"{marked} : with deformation shapes at rigid joints no mode has this shape; see the warnings"
        )
    return words


def response_error_words(response: ResponseSummary) -> list[str]:
    """Say how far the lines of a frequency response may be off, by source, and what is not in it; empty
    where nothing is known.
    """
    found, left_out = response.get("error"), response.get("error_left_out")
    if not found:
        return [f"{NO_BOUND} : nothing is known of {'; '.join(left_out)}"] if left_out else []
    unknown = [
        WITHOUT_BOUND.get(source, f"nothing is known of {source}")
        for source, shares in found.items()
        if shares is None
    ]
    parts = [
        f"{source} {100 * shares['median_share']:.2g} % of a line in the median, at most {100 * shares['largest_share']:.2g} % at "
        f"{shares['largest_share_hz']:.4g} Hz"
        for source, shares in found.items()
        if isinstance(shares, dict)
    ]
    words = [f"{NO_BOUND} : {'; '.join(unknown)}"] if unknown else []
    if parts:
        words.append(f"± covers 95 % of errors, from {'; '.join(parts)}")
    if unknown and parts:
        words[-1] = f"known are {'; '.join(parts)}"
    bounded_to = found["bounded_to_hz"]
    if not unknown and isinstance(bounded_to, float) and bounded_to < response["to_hz"]:
        words.append(f"no bound above {bounded_to:.4g} Hz")
    if left_out:
        words.append(f"not in ±: {'; '.join(left_out)}")
    return words


def limit_error_words(lobes: Mapping[str, LobesSummary]) -> list[str]:
    """Directions without a limit, where the errors of the lowest limits come from, and what is not in
    them.
    """
    words = [
        f"pose {pose}, travel {own['name']}: no cut up to {found['deepest_mm']:g} mm chatters at a speed that was looked at"
        for pose, found in lobes.items()
        for own in found["directions"]
        if own["lowest"] is None
    ]
    directions = [own for found in lobes.values() for own in found["directions"]]
    largest, _ = largest_parts(
        (own["lowest"]["limit_depth_mm"], own["lowest_error_share"])
        for own in directions
        if own["lowest"] is not None
    )
    if largest:
        words.append(f"± of a lowest limit from {show_parts(largest)}")
    left_out = dict.fromkeys(words for own in directions for words in own["error_left_out"])
    if left_out:
        what = "not in ±" if largest else "no ± of the lowest limits"
        words.append(f"{what}: {'; '.join(left_out)}")
    return words


def show_best_depth(best: BestSpeedSummary) -> str:
    """Limit depth at a best speed [mm], with its ±; that it is above the deepest cut where there is
    none.
    """
    depth, error = best["limit_depth_mm"], best["error_mm"]
    if not best["limited"]:
        return f"above {depth:.3g}"
    return (
        f"{depth:.3g}"
        if error is None
        else f"{show_bounded(depth, error)} {show_bound(depth, error)}"
    )


def transient_words(transient: TransientSummary) -> list[str]:
    """Say what a settling time means, where the errors of peaks come from, and how the energy adds up."""
    words = [f"settled: within {100 * transient['settled_within']:g} % of the way, or of the peak"]
    largest, unknown = largest_parts(
        (output["peak"], output["error_share"]) for output in transient["outputs"].values()
    )
    known = {source: share for source, share in largest.items() if source not in unknown}
    if known:
        words.append(f"± of a peak, from {show_parts(known)}")
    if unknown:
        words.append(f"{NO_BOUND} : nothing is known of {', '.join(unknown)}")
    if transient["error_left_out"]:
        words.append(f"not in ±: {'; '.join(transient['error_left_out'])}")
    energy = transient["energy"]
    if energy is not None:
        words.append(
            f"energy: {energy['initial']:.3g} J at the beginning, {energy['work']:.3g} J of work, {energy['dissipated']:.3g} J dissipated,"
            f" {energy['final']:.3g} J left; the balance closes within {show_share(energy['error'])} of the largest"
        )
    if not transient["damped"]:
        words.append("nothing is damped, so nothing settles")
    return words


def model_words(models: ModelErrorsSummary) -> str:
    """Say what all rigid and segmented bodies together leave out."""
    changes = {
        name: abs(number["change"])
        for name, number in models["numbers"].items()
        if number["change"] is not None
    }
    most = max(changes, key=lambda name: changes[name], default="")
    lost = sum(number["change"] is None for number in models["numbers"].values())
    words = f"together up to {show_share(changes.get(most, 0.0))}" + (f" of {most}" if most else "")
    if lost:
        words += f"; {lost} of {len(models['numbers'])} numbers have no mode of their shape then"
    return f"{words}; part of every ± as `{MODEL}`"


def accuracy_words(
    accuracy: AccuracySummary, responses: Mapping[str, ResponseSummary] | None = None
) -> list[str]:
    """Say how settings were chosen for an accuracy: what was asked for, what is reached, with which
    settings, and that lines of frequency responses by pose are further off, where they are.
    """
    rounds, reached = accuracy["rounds"], accuracy["estimated"]
    if not any("owner" in each for each in rounds):
        return [
            f"accuracy {100.0 * accuracy['requested']:g} %: nothing to choose, since no number has an error of a mesh or of modes left out"
        ]
    last = rounds[-1]["quantity"]
    settings = "; ".join(f"{name}: {words}" for name, words in accuracy["settings"].items())
    state = "met" if accuracy["met"] else "not met"
    count = f"{len(rounds)} round{'s' if len(rounds) != 1 else ''}"
    words = f"accuracy {100.0 * accuracy['requested']:g} % {state} in {count}: {last} within {_show_reached(reached)}, the others closer"
    if (own := accuracy.get("responses")) is not None:
        words += (
            f"; peaks and static levels of frequency responses {'met' if own['met'] else 'did not meet'} it:"
            f" {own['quantity']} within {_show_reached(own['error'])}"
        )
    share, at_hz, pose = max(_line_errors(responses or {}), default=(0.0, 0.0, ""))
    if share > accuracy["requested"]:
        words += (
            f"; single lines of the frequency response are no part of it: up to {100.0 * share:.2g} % off"
            f" at {at_hz:.4g} Hz in pose {pose}"
        )
    lines = [
        f"  {name}: {body['model']}; {body['why']}"
        + (f". Next: {body['next']}" if body["next"] else "")
        for name, body in accuracy.get("models", {}).items()
    ]
    return [words, *(lines or filter(None, [settings]))]


def _show_reached(share: float | None) -> str:
    return "an unknown amount" if share is None else f"{100.0 * share:.2g} %"


def _line_errors(responses: Mapping[str, ResponseSummary]) -> list[tuple[float, float, str]]:
    """Largest share of a line by source, its frequency [Hz] and the pose."""
    return [
        (shares["largest_share"], shares["largest_share_hz"], pose)
        for pose, response in responses.items()
        for shares in (response.get("error") or {}).values()
        if isinstance(shares, dict)
    ]
