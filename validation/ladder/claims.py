"""Statements of Kono, Lorenzer, Weikert and Wegener about their two beams (section 3), each with the number that decides it.

A few more say what Headstock's own models must show. A statement for which there is no model is None.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from headstock.validation.ladder.points import (
    LINEAR,
    QUADRATIC,
    Against,
    LadderPoint,
    Rungs,
    deviations,
    ndof_within,
    nearest_rung,
    pick_rungs,
    reference_value,
    worst_by_ndof,
    worst_of,
)
from headstock.validation.ladder.references import Group, LadderBeam
from headstock.validation.parts.closed_form_cases import PATCH

ROUNDOFF = 1e-6
ABOUT_EQUAL = 2.0  # nDOF of two models that may be compared
FORCES = ("dx(Fx)", "dy(Fy)", "dz(Fz)", "dy(Ma)", "dx(Mb)")
TORSION = ("dx(Mc)",)
AT_CENTRE, ABOVE, TILT = "dx(Fx), h_F = 0", "dx(Fx), h_F = 100 mm", "dz(Fx), h_F = 100 mm"
SOLID_LIMIT, BEAM_LIMIT = 3e-3, 2e-3
ALMOST = 0.01  # what counts as "almost constant" of a deviation: one point
MANY = 1e9
ACROSS = "these elements get smaller across the section too, which lets it warp"
PLAIN = "plain linear elements lock in bending; the paper's must have had bending shapes: see wilson8"


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
    """In every model between two nDOF some deviation is larger than a limit; ``note`` is for where it is not.

    Args:
        rungs: Models by rising nDOF.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
        limit: Relative deviation that is to be exceeded [-].
        above: Least nDOF.
        below: Largest nDOF.
        note: Remark for where it is not exceeded.
    """
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
    """In the smallest model some deviation is larger than a limit; the note says from which nDOF on none is.

    Args:
        rungs: Models by rising nDOF.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
        limit: Relative deviation that is to be exceeded [-].
    """
    worst = list(worst_by_ndof(rungs, quantities).values())
    if not worst:
        return None
    enough = ndof_within(rungs, quantities, limit)
    note = f"still in the largest model, nDOF {rungs.points[-1].ndof}" if enough is None else f"no longer from nDOF {enough} on"
    return Claim(rungs.figure, rungs.models, text, abs(worst[0].value) > limit, str(worst[0]), worst[0].value, note)


def claim_between(rungs: Rungs, text: str, quantities: Sequence[str], limits: tuple[float, float]) -> Claim | None:
    """The largest deviation of every model lies between two limits.

    Args:
        rungs: Models by rising nDOF.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
        limits: Least and largest relative deviation [-].
    """
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
    """No deviation grows from one model to the next; where nothing is left to shrink that is said.

    Args:
        rungs: Models by rising nDOF.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
    """
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
    """From some nDOF on no deviation varies by more than a limit [-]; decided by the quantity that varies most.

    Args:
        rungs: Models by rising nDOF.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
        limit: Largest variation of a relative deviation [-].
        above: Least nDOF.
    """
    by_quantity = [found for name in quantities if len(found := deviations(rungs, [name], above=above)) > 1]
    if not by_quantity:
        return None
    ends = [(min(found, key=lambda d: d.value), max(found, key=lambda d: d.value)) for found in by_quantity]
    least, most = max(ends, key=lambda pair: pair[1].value - pair[0].value)
    span = most.value - least.value
    decides = f"{100 * span:.2g} points: {least} to {most}"
    return Claim(rungs.figure, rungs.models, f"{text} (within {100 * limit:g} point)", span <= limit, decides, span)


def claim_smaller(better: Rungs, worse: Rungs, text: str, quantities: Sequence[str], *, above: float, below: float) -> Claim | None:
    """In a range of nDOF some models deviate less than others of about equal nDOF, in every quantity; a mode that is missing loses.

    Args:
        better: Models that are to deviate less.
        worse: Those that are to deviate more.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
        above: Least nDOF.
        below: Largest nDOF.
    """
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
    """The smallest model has not a certain mode.

    Args:
        rungs: Models by rising nDOF.
        text: The statement, in the paper's words.
        name: Of the mode.
    """
    if not rungs.points:
        return None
    smallest = rungs.points[0]
    if name not in smallest.values:
        decides = f"none resembles {name} at nDOF {smallest.ndof} ({smallest.kind})"
        return Claim(rungs.figure, rungs.models, text, True, decides, None)
    found = next(deviation for deviation in deviations(rungs, [name]) if deviation.point is smallest)
    return Claim(rungs.figure, rungs.models, text, False, f"{found}, MAC {smallest.macs[name]:.2f}", found.value)


def claim_softer(softer: Rungs, stiffer: Rungs, text: str, quantities: Sequence[str]) -> Claim | None:
    """The smallest of some models gives larger displacements than the smallest of others.

    Args:
        softer: Models whose smallest is to give larger displacements.
        stiffer: Those whose smallest is to give less.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
    """
    if not (softer.points and stiffer.points):
        return None
    ratios = {name: softer.points[0].values[name] / stiffer.points[0].values[name] for name in quantities}
    name = min(ratios, key=lambda key: ratios[key])
    decides = (
        f"{name} {ratios[name]:.3g} times that of {stiffer.models} (nDOF {softer.points[0].ndof} and {stiffer.points[0].ndof})"
    )
    return Claim(softer.figure, f"{softer.models}, {stiffer.models}", text, ratios[name] >= 1.0, decides, ratios[name])


def claim_alike(rungs: Rungs, others: Rungs, text: str, quantities: Sequence[str], limit: float, *, above: float) -> Claim | None:
    """Deviations of two kinds of models of about equal nDOF differ by less than a limit.

    Args:
        rungs: Models by rising nDOF.
        others: Models of about equal nDOF.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
        limit: Largest difference of two relative deviations [-].
        above: Least nDOF.
    """
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
    """Some models need at least so many times the dofs of others to stay within a limit of the analytic values.

    Args:
        many: Models that need more dofs.
        few: Models that need fewer.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
        limit: Largest relative deviation [-].
        least: Least ratio of the nDOF needed [-].
    """
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
    """The largest model lies within a limit of a reference, in every quantity.

    Args:
        rungs: Models by rising nDOF.
        text: The statement, in the paper's words.
        quantities: Names of the quantities it is about.
        limit: Largest relative deviation [-].
        against: Reference: the paper's analytic value, Timoshenko's, or that of converged 3D elasticity.
    """
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


def judge_ladder(beam: LadderBeam, points: Sequence[LadderPoint]) -> list[Claim]:
    """Every statement about a beam that its ladder has models to decide by, in the order of the paper's figures."""
    judge = _judge_cantilever if beam.name == "kono-cantilever" else _judge_fixed_beam
    return _decided(judge(beam, points))


def judge_own(beam: LadderBeam, points: Sequence[LadderPoint]) -> list[Claim]:
    """What the paper does not say: second-order elements reach converged 3D elasticity, segments reach beam theory with shear."""
    found: list[Claim | None] = []
    groups: tuple[Group, ...] = ("static", "modal")
    for group in groups:
        names = [name for name, reference in beam.references.items() if reference.group == group]
        text = f"second-order elements come within {100 * SOLID_LIMIT:g} % of converged 3D elasticity"
        fine = [pick_rungs(beam, points, group, kind) for kind in QUADRATIC]
        found += [claim_reached(rungs, text, names, SOLID_LIMIT, against="solid") for rungs in fine]
        # the loaded patch holds a part of the span against twist, at most all that lies under it
        limit = BEAM_LIMIT + (PATCH / beam.size[beam.axis] if beam.ends == "clamped-clamped" and group == "static" else 0.0)
        text = f"segments come within {100 * limit:.2g} % of beam theory with shear and free warping"
        found.append(claim_reached(pick_rungs(beam, points, group, "segmented"), text, names, limit, against="beam"))
    return _decided(found)


def _decided(claims: Sequence[Claim | None]) -> list[Claim]:
    return sorted((claim for claim in claims if claim is not None), key=lambda claim: claim.figure)


def _judge_cantilever(beam: LadderBeam, points: Sequence[LadderPoint]) -> list[Claim | None]:
    modes = [name for name, reference in beam.references.items() if reference.group == "modal"]
    loads = [*FORCES, *TORSION]
    segments = pick_rungs(beam, points, "static", "segmented")
    found = [
        claim_below(segments, "every deviation < 10 % from nDOF 30", loads, 0.10, above=30),
        claim_below(segments, "every deviation < 4 % from nDOF 90", loads, 0.04, above=90),
        claim_shrinking(segments, "deviations shrink as nDOF grows", loads),
        claim_constant(segments, "deviations almost constant above nDOF 60", FORCES[:2], ALMOST, above=60),
    ]
    for rungs in (pick_rungs(beam, points, "static", kind) for kind in LINEAR):
        found += [
            claim_softer(segments, rungs, "small segmented models are softer than small FE models", loads),
            claim_below(rungs, "< 10 % from nDOF 40, dx(Mc) apart", FORCES, 0.10, above=40, note=PLAIN),
            claim_below(rungs, "< 2 % from nDOF 200, dx(Mc) apart", FORCES, 0.02, above=200, note=PLAIN),
            claim_above(rungs, "dx(Mc) still > 10 % above nDOF 500", TORSION, 0.10, above=500, below=2000, note=ACROSS),
            claim_alike(rungs, segments, "differ by < 5 % above nDOF 100, dx(Mc) apart", FORCES, 0.05, above=100),
        ]
    segments = pick_rungs(beam, points, "modal", "segmented")
    found += [
        claim_below(segments, "every deviation < 20 % from nDOF 60", modes, 0.20, above=60),
        claim_below(segments, "every deviation < 16 % above nDOF 200", modes, 0.16, above=200),
        claim_missing(segments, "X3 is missing at the smallest nDOF", "X3"),
    ]
    for rungs in (pick_rungs(beam, points, "modal", kind) for kind in LINEAR):
        found += [
            claim_below(rungs, "every deviation < 20 % from nDOF 100", modes, 0.20, above=100, note=PLAIN),
            claim_below(rungs, "every deviation < 15 % above nDOF 200", modes, 0.15, above=200, note=PLAIN),
            claim_missing(rungs, "X3 is missing at the smallest nDOF", "X3"),
            claim_smaller(
                segments, rungs, "segments deviate less in X2 and X3 from nDOF 40 to 100", ["X2", "X3"], above=40, below=100
            ),
            claim_alike(rungs, segments, "differ by < 10 % above nDOF 100", modes, 0.10, above=100),
        ]
    return found


def _judge_fixed_beam(beam: LadderBeam, points: Sequence[LadderPoint]) -> list[Claim | None]:
    shifts, bending = [AT_CENTRE, ABOVE], ["X1", "X2"]
    segments = pick_rungs(beam, points, "static", "segmented")
    found = [
        claim_below(segments, "dx within 10 % from nDOF 90", shifts, 0.10, above=90),
        claim_below(segments, "dx and dz within 3 % above nDOF 300", [*shifts, TILT], 0.03, above=300),
        claim_shrinking(segments, "deviations of dx shrink as nDOF grows", shifts),
        claim_constant(segments, "deviations of dx almost constant above nDOF 200", shifts, ALMOST, above=200),
    ]
    linear = [pick_rungs(beam, points, "static", kind) for kind in LINEAR]
    found += [claim_coarsest(rungs, "> 70 % without midside nodes, on the coarsest mesh", shifts, 0.70) for rungs in linear]
    for rungs in (pick_rungs(beam, points, "static", kind) for kind in QUADRATIC):
        found += [
            claim_between(rungs, "12 to 40 % with midside nodes", shifts, (0.12, 0.40)),
            claim_above(rungs, "still > 10 % at h_F = 100 mm near nDOF 10 000", [ABOVE], 0.10, above=7e3, below=2e4),
            claim_ratio(rungs, segments, "segments need 1/30 of the nDOF, or fewer", shifts, 0.10, least=30.0),
        ]
    segments = pick_rungs(beam, points, "modal", "segmented")
    found += [
        claim_below(segments, "every deviation < 20 % from nDOF 60", ["X1", "T1", "X2"], 0.20, above=60),
        claim_below(segments, "every deviation < 3 % above nDOF 400", ["X1", "T1", "X2"], 0.03, above=400),
    ]
    for rungs in (pick_rungs(beam, points, "modal", kind) for kind in LINEAR):
        found += [
            claim_above(rungs, "T1 still > 20 % above nDOF 1000", ["T1"], 0.20, above=1e3, below=MANY),
            claim_below(rungs, "X1 and X2 < 20 % from nDOF 210", bending, 0.20, above=210, note=PLAIN),
            claim_below(rungs, "X1 and X2 < 3 % above nDOF 800", bending, 0.03, above=800, note=PLAIN),
            claim_ratio(rungs, segments, "segments need half the nDOF, or fewer", bending, 0.03, least=2.0),
        ]
    return found
