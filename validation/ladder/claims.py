"""Statements about a ladder, held or not held, each with the number that decides it; None where a ladder has no model to decide by."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from headstock.validation.ladder.ladder_deviations import (
    Against,
    Rungs,
    deviations,
    ndof_within,
    nearest_rung,
    reference_value,
    worst_by_ndof,
    worst_of,
)

ROUNDOFF = 1e-6
ABOUT_EQUAL = 2.0  # nDOF of two models that may be compared


@dataclass(frozen=True)
class Claim:
    """A statement about a ladder and what became of it.

    Attributes:
        figure: Number of the paper's figure.
        models: Which models it is about.
        text: The statement.
        held: Whether the ladder shows it.
        decides: The number that decides, and where it was met.
        value: That number; None where there is none.
        note: What a reader should know.
    """

    figure: int
    models: str
    text: str
    held: bool
    decides: str
    value: float | None
    note: str = ""


def claim_below(
    rungs: Rungs, text: str, quantities: Sequence[str], limit: float, *, above: float = 0.0, note: str = ""
) -> Claim | None:
    """Every deviation from the analytic value is smaller than a limit from some nDOF on; a missing mode counts against it.

    Args:
        rungs: Which models.
        text: The statement.
        quantities: Of these quantities.
        limit: Relative deviation [-].
        above: Smallest nDOF that counts.
        note: What to say where it is not held and the reference is not to blame.
    """
    missing = [point for point in rungs.points if point.ndof >= above and any(name not in point.values for name in quantities)]
    found = deviations(rungs, quantities, above=above)
    if not found:
        return None
    worst = worst_of(found)
    held = abs(worst.value) < limit and not (missing and rungs.group == "modal")
    decides = (
        str(worst) if abs(worst.value) >= limit or held else f"a mode is missing at nDOF {missing[0].ndof} ({missing[0].kind})"
    )
    remark = "" if held else _blame_reference(rungs, worst.quantity, limit) or note
    return Claim(rungs.figure, rungs.models, text, held, decides, worst.value, remark)


def claim_above(
    rungs: Rungs, text: str, quantities: Sequence[str], limit: float, *, above: float, below: float, note: str = ""
) -> Claim | None:
    """In every model between two nDOF some deviation is larger than a limit; ``note`` is for where it is not."""
    worst = [d for ndof, d in worst_by_ndof(rungs, quantities, above=above).items() if ndof <= below]
    if not worst:
        return None
    least = min(worst, key=lambda deviation: abs(deviation.value))
    small = [deviation for deviation in worst if abs(deviation.value) <= limit]
    decides = str(least) if not small else f"{small[0]}; larger before"
    if small and small[0] is worst[0]:
        decides = str(small[0])
    reference = rungs.beam.references[least.quantity]
    off = reference.solid / reference.analytic - 1.0
    remark = (
        f"converged 3D elasticity itself lies at {100 * off:+.1f} %: {reference.note}"
        if abs(off) > limit
        else note
        if small
        else ""
    )
    return Claim(rungs.figure, rungs.models, text, not small, decides, (small or [least])[0].value, remark)


def claim_coarsest(rungs: Rungs, text: str, quantities: Sequence[str], limit: float) -> Claim | None:
    """In the smallest model some deviation is larger than a limit; the note says from which nDOF on none is."""
    worst = list(worst_by_ndof(rungs, quantities).values())
    if not worst:
        return None
    enough = ndof_within(rungs, quantities, limit)
    note = f"still in the largest model, nDOF {rungs.points[-1].ndof}" if enough is None else f"no longer from nDOF {enough} on"
    return Claim(rungs.figure, rungs.models, text, abs(worst[0].value) > limit, str(worst[0]), worst[0].value, note)


def claim_between(rungs: Rungs, text: str, quantities: Sequence[str], limits: tuple[float, float]) -> Claim | None:
    """The largest deviation of every model lies between two limits."""
    worst = list(worst_by_ndof(rungs, quantities).values())
    if not worst:
        return None
    outside = [deviation for deviation in worst if not limits[0] <= abs(deviation.value) <= limits[1]]
    shown = max(outside or worst, key=lambda d: max(limits[0] - abs(d.value), abs(d.value) - limits[1]))
    reference = rungs.beam.references[shown.quantity]
    off = reference.solid / reference.analytic - 1.0
    note = f"converged 3D elasticity itself lies at {100 * off:+.2f} %" if outside else ""
    return Claim(rungs.figure, rungs.models, text, not outside, str(shown), shown.value, note)


def claim_shrinking(rungs: Rungs, text: str, quantities: Sequence[str]) -> Claim | None:
    """No deviation grows from one model to the next; where nothing is left to shrink that is said."""
    steps = [
        (abs(fine.value) - abs(coarse.value), fine)
        for name in quantities
        for own in [deviations(rungs, [name])]
        for coarse, fine in itertools.pairwise(own)
    ]
    if not steps:
        return None
    growth, where = max(steps, key=lambda step: step[0])
    still = all(abs(step) < ROUNDOFF for step, _ in steps)
    note = (
        "nothing is left to shrink: exact beam springs give beam theory's value, shear included, with any number" if still else ""
    )
    decides = (
        f"largest growth {100 * growth:+.2g} points: {where}"
        if not still
        else f"unchanged: {worst_of(deviations(rungs, quantities))}"
    )
    return Claim(rungs.figure, rungs.models, text, growth < ROUNDOFF, decides, growth, note)


def claim_constant(rungs: Rungs, text: str, quantities: Sequence[str], limit: float, *, above: float) -> Claim | None:
    """From some nDOF on no deviation varies by more than a limit [-]; decided by the quantity that varies most."""
    by_quantity = [found for name in quantities if len(found := deviations(rungs, [name], above=above)) > 1]
    if not by_quantity:
        return None
    ends = [(min(found, key=lambda d: d.value), max(found, key=lambda d: d.value)) for found in by_quantity]
    least, most = max(ends, key=lambda pair: pair[1].value - pair[0].value)
    span = most.value - least.value
    decides = f"{100 * span:.2g} points: {least} to {most}"
    return Claim(rungs.figure, rungs.models, f"{text} (within {100 * limit:g} point)", span <= limit, decides, span)


def claim_smaller(better: Rungs, worse: Rungs, text: str, quantities: Sequence[str], *, above: float, below: float) -> Claim | None:
    """In a range of nDOF some models deviate less than others of about equal nDOF, in every quantity; a mode that is missing loses."""
    gaps = []
    for own in deviations(better, quantities, above=above):
        if own.point.ndof > below:
            continue
        other = nearest_rung(worse, own.point.ndof, own.quantity)
        if other is not None and 1.0 / ABOUT_EQUAL <= other.ndof / own.point.ndof <= ABOUT_EQUAL:
            (off,) = [d for d in deviations(worse, [own.quantity]) if d.point is other]
            gaps.append((abs(own.value) - abs(off.value), own, off))
    lacking = [
        point for point in better.points if above <= point.ndof <= below and any(name not in point.values for name in quantities)
    ]
    if not gaps:
        return None
    gap, own, off = max(gaps, key=lambda item: item[0])
    decides = f"{own} beside {off}" if not lacking else f"a mode is missing at nDOF {lacking[0].ndof} ({lacking[0].kind})"
    return Claim(better.figure, f"{better.models}, {worse.models}", text, gap < 0.0 and not lacking, decides, gap)


def claim_missing(rungs: Rungs, text: str, name: str) -> Claim | None:
    """The smallest model has not a certain mode."""
    if not rungs.points:
        return None
    smallest = rungs.points[0]
    if name not in smallest.values:
        decides = f"none resembles {name} at nDOF {smallest.ndof} ({smallest.kind})"
        return Claim(rungs.figure, rungs.models, text, True, decides, None)
    found = next(deviation for deviation in deviations(rungs, [name]) if deviation.point is smallest)
    return Claim(rungs.figure, rungs.models, text, False, f"{found}, MAC {smallest.macs[name]:.2f}", found.value)


def claim_softer(softer: Rungs, stiffer: Rungs, text: str, quantities: Sequence[str]) -> Claim | None:
    """The smallest of some models gives larger displacements than the smallest of others."""
    if not (softer.points and stiffer.points):
        return None
    ratios = {name: softer.points[0].values[name] / stiffer.points[0].values[name] for name in quantities}
    name = min(ratios, key=lambda key: ratios[key])
    decides = (
        f"{name} {ratios[name]:.3g} times that of {stiffer.models} (nDOF {softer.points[0].ndof} and {stiffer.points[0].ndof})"
    )
    return Claim(softer.figure, f"{softer.models}, {stiffer.models}", text, ratios[name] >= 1.0, decides, ratios[name])


def claim_alike(rungs: Rungs, others: Rungs, text: str, quantities: Sequence[str], limit: float, *, above: float) -> Claim | None:
    """Deviations of two kinds of models of about equal nDOF differ by less than a limit."""
    gaps = []
    for own in deviations(rungs, quantities, above=above):
        other = nearest_rung(others, own.point.ndof, own.quantity)
        if other is not None:
            gap = own.value - (other.values[own.quantity] / reference_value(rungs.beam, own.quantity, "analytic") - 1.0)
            gaps.append((gap, own, other))
    if not gaps:
        return None
    gap, own, other = max(gaps, key=lambda item: abs(item[0]))
    decides = f"{100 * gap:+.3g} points: {own} against {other.kind} at nDOF {other.ndof}"
    return Claim(rungs.figure, f"{others.models}, {rungs.models}", text, abs(gap) < limit, decides, gap)


def claim_ratio(many: Rungs, few: Rungs, text: str, quantities: Sequence[str], limit: float, *, least: float) -> Claim | None:
    """Some models need at least so many times the dofs of others to stay within a limit of the analytic values."""
    if not (many.points and few.points):
        return None
    needed = [ndof_within(rungs, quantities, limit) for rungs in (many, few)]
    models = f"{few.models}, {many.models}"
    if needed[1] is None:
        return Claim(many.figure, models, text, False, f"{few.models} does not stay within {100 * limit:g} %", None)
    if needed[0] is None:
        reach = many.points[-1].ndof
        ratio = reach / needed[1]
        decides = f"nDOF {needed[1]} against more than {reach}: over {ratio:.3g} times, for {100 * limit:g} %"
    else:
        ratio = needed[0] / needed[1]
        decides = f"nDOF {needed[1]} against {needed[0]}: {ratio:.3g} times, for {100 * limit:g} %"
    return Claim(many.figure, models, text, ratio >= least, decides, ratio)


def claim_reached(rungs: Rungs, text: str, quantities: Sequence[str], limit: float, *, against: Against) -> Claim | None:
    """The largest model lies within a limit of a reference, in every quantity."""
    if not rungs.points:
        return None
    finest = list(worst_by_ndof(rungs, quantities, against=against).values())[-1]
    enough = ndof_within(rungs, quantities, limit, against=against)
    decides = f"from nDOF {enough} on; {finest}" if enough is not None else str(finest)
    return Claim(rungs.figure, rungs.models, text, enough is not None, decides, finest.value)


def _blame_reference(rungs: Rungs, quantity: str, limit: float) -> str:
    """Says so where a right model cannot meet a limit, since the analytic value it is held against is off."""
    reference = rungs.beam.references[quantity]
    roads = (("beam theory with shear", reference.beam), ("converged 3D elasticity", reference.solid))
    off = {name: value / reference.analytic - 1.0 for name, value in roads}
    words = [f"{name} itself lies at {100 * share:+.2f} %" for name, share in off.items() if abs(share) >= limit]
    return f"{', '.join(words)}: {reference.note}" if words else ""
