"""Statements of Kono, Lorenzer, Weikert and Wegener about their two beams (section 3), each with
the number that decides it.

A few more say what Headstock's own models must show. A statement for which there is no model is
None.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.validation.parts.closed_form_cases import PATCH
from headstock.validation.refinement.points import (
    LINEAR,
    QUADRATIC,
    Against,
    RefinementPoint,
    RefinementSeries,
    deviations,
    ndof_within,
    nearest_rung,
    pick_series,
    reference_value,
    worst_by_ndof,
    worst_of,
)
from headstock.validation.refinement.references import Group, ReferenceBeam

ROUNDOFF = 1e-6
ABOUT_EQUAL = 2.0  # nDOF of two models that may be compared
FORCES = ("dx(Fx)", "dy(Fy)", "dz(Fz)", "dy(Ma)", "dx(Mb)")
TORSION = ("dx(Mc)",)
AT_CENTRE, ABOVE, TILT = "dx(Fx), h_F = 0", "dx(Fx), h_F = 100 mm", "dz(Fx), h_F = 100 mm"
SOLID_LIMIT, BEAM_LIMIT = 3e-3, 2e-3
ALMOST = 0.01  # what counts as "almost constant" of a deviation: one point
MANY = 1e9
UNCHANGED = "nothing is left to shrink: exact beam springs give beam theory's value, shear included, with any number"
ACROSS = "these elements get smaller across the section too, which lets it warp"
PLAIN = (
    "plain linear elements lock in bending; the paper's must have had bending shapes: see wilson8"
)


@dataclass(frozen=True)
class EvaluatedStatement:
    """A statement about a series of models and what became of it.

    Attributes:
        figure: Number of the paper's figure.
        confirmed: Whether the series shows it.
        decides: The number that decides, and where it was met.
        value: That number; None where there is none.
        note: What a reader should know.
    """

    figure: int
    models: str
    text: str
    confirmed: bool
    decides: str
    value: float | None
    note: str = ""


@dataclass(frozen=True, eq=False)
class _Statement:
    """What is said of some models; each method decides it in one way.

    Attributes:
        series: Models by rising nDOF.
        text: The statement, in the paper's words.
    """

    series: RefinementSeries
    text: str
    quantities: Sequence[str]

    def below(
        self, limit: float, *, above: float = 0.0, note: str = ""
    ) -> EvaluatedStatement | None:
        """Check that every deviation from the analytic value is smaller than a limit from some nDOF on;
        a missing mode counts against it.

        Args:
            limit: Relative deviation [-].
            above: Smallest nDOF that counts.
            note: What to say where it is not confirmed and the reference is not to blame.
        """
        missing, found = self._lacking(above), deviations(self.series, self.quantities, above=above)
        if not found:
            return None
        worst = worst_of(found)
        confirmed = abs(worst.value) < limit and not (missing and self.series.group == "modal")
        decides = (
            str(worst) if abs(worst.value) >= limit or confirmed else _name_missing(missing[0])
        )
        return self._decide(
            confirmed,
            decides,
            worst.value,
            "" if confirmed else self._blame_reference(worst.quantity, limit) or note,
        )

    def exceeds(
        self, limit: float, *, above: float, below: float, note: str = ""
    ) -> EvaluatedStatement | None:
        """In every model between two nDOF some deviation is larger than a limit; ``note`` is for
        where it is not.

        Args:
            limit: Relative deviation that is to be exceeded [-].
            note: Remark for where it is not exceeded.
        """
        worst = [
            d
            for ndof, d in worst_by_ndof(self.series, self.quantities, above=above).items()
            if ndof <= below
        ]
        if not worst:
            return None
        least = min(worst, key=lambda deviation: abs(deviation.value))
        small = [deviation for deviation in worst if abs(deviation.value) <= limit]
        decides = (
            str(least)
            if not small
            else str(small[0])
            if small[0] is worst[0]
            else f"{small[0]}; larger before"
        )
        remark = note if small else ""
        if abs(self._solid_off(least.quantity)) > limit:
            remark = f"{self._name_solid(least.quantity, digits=1)}: {self.series.beam.references[least.quantity].note}"
        return self._decide(not small, decides, (small or [least])[0].value, remark)

    def coarsest_exceeds(self, limit: float) -> EvaluatedStatement | None:
        """In the smallest model some deviation is larger than a limit [-]; the note says from which
        nDOF on none is.
        """
        worst = list(worst_by_ndof(self.series, self.quantities).values())
        if not worst:
            return None
        enough, last = ndof_within(self.series, self.quantities, limit), self.series.points[-1].ndof
        note = (
            f"still in the largest model, nDOF {last}"
            if enough is None
            else f"no longer from nDOF {enough} on"
        )
        return self._decide(abs(worst[0].value) > limit, str(worst[0]), worst[0].value, note)

    def between(self, low: float, high: float) -> EvaluatedStatement | None:
        """Check that the largest deviation of every model lies between two limits [-]."""
        worst = list(worst_by_ndof(self.series, self.quantities).values())
        if not worst:
            return None
        outside = [deviation for deviation in worst if not low <= abs(deviation.value) <= high]
        shown = max(outside or worst, key=lambda d: max(low - abs(d.value), abs(d.value) - high))
        return self._decide(
            not outside,
            str(shown),
            shown.value,
            self._name_solid(shown.quantity, digits=2) if outside else "",
        )

    def shrinks(self) -> EvaluatedStatement | None:
        """No deviation grows from one model to the next; says where nothing is left to shrink."""
        by_quantity = [deviations(self.series, [name]) for name in self.quantities]
        steps = [
            (abs(fine.value) - abs(coarse.value), fine)
            for own in by_quantity
            for coarse, fine in itertools.pairwise(own)
        ]
        if not steps:
            return None
        growth, where = max(steps, key=lambda step: step[0])
        if all(abs(step) < ROUNDOFF for step, _ in steps):
            decides = f"unchanged: {worst_of(deviations(self.series, self.quantities))}"
            return self._decide(growth < ROUNDOFF, decides, growth, UNCHANGED)
        return self._decide(
            growth < ROUNDOFF, f"largest growth {100 * growth:+.2g} points: {where}", growth
        )

    def constant(self, limit: float, *, above: float) -> EvaluatedStatement | None:
        """From some nDOF on no deviation varies by more than a limit [-]; decided by the quantity
        that varies most.
        """
        by_quantity = [
            found
            for name in self.quantities
            if len(found := deviations(self.series, [name], above=above)) > 1
        ]
        if not by_quantity:
            return None
        ends = [
            (min(found, key=lambda d: d.value), max(found, key=lambda d: d.value))
            for found in by_quantity
        ]
        least, most = max(ends, key=lambda pair: pair[1].value - pair[0].value)
        span = most.value - least.value
        said = dataclasses.replace(self, text=f"{self.text} (within {100 * limit:g} point)")
        return said._decide(span <= limit, f"{100 * span:.2g} points: {least} to {most}", span)

    def smaller_than(
        self, worse: RefinementSeries, *, above: float, below: float
    ) -> EvaluatedStatement | None:
        """In a range of nDOF these models deviate less than others of about equal nDOF, in every
        quantity; a missing mode loses.

        Args:
            worse: Models that are to deviate more.
        """
        gaps = []
        for own in deviations(self.series, self.quantities, above=above):
            other = nearest_rung(worse, own.point.ndof, own.quantity)
            if (
                own.point.ndof <= below
                and other is not None
                and 1.0 / ABOUT_EQUAL <= other.ndof / own.point.ndof <= ABOUT_EQUAL
            ):
                (off,) = [d for d in deviations(worse, [own.quantity]) if d.point is other]
                gaps.append((abs(own.value) - abs(off.value), own, off))
        if not gaps:
            return None
        lacking = self._lacking(above, below)
        gap, own, off = max(gaps, key=lambda item: item[0])
        decides = f"{own} beside {off}" if not lacking else _name_missing(lacking[0])
        return self._decide(
            gap < 0.0 and not lacking, decides, gap, models=f"{self.series.models}, {worse.models}"
        )

    def coarsest_lacks(self) -> EvaluatedStatement | None:
        """Check that the smallest model lacks a certain mode."""
        if not self.series.points:
            return None
        (name,), smallest = self.quantities, self.series.points[0]
        if name not in smallest.values:
            return self._decide(
                True, f"none resembles {name} at nDOF {smallest.ndof} ({smallest.kind})", None
            )
        found = next(
            deviation
            for deviation in deviations(self.series, [name])
            if deviation.point is smallest
        )
        return self._decide(False, f"{found}, MAC {smallest.macs[name]:.2f}", found.value)

    def softer_than(self, stiffer: RefinementSeries) -> EvaluatedStatement | None:
        """Check that the smallest of these models moves more than the smallest of others."""
        if not (self.series.points and stiffer.points):
            return None
        own, other = self.series.points[0], stiffer.points[0]
        ratios = {name: own.values[name] / other.values[name] for name in self.quantities}
        name = min(ratios, key=lambda key: ratios[key])
        decides = f"{name} {ratios[name]:.3g} times that of {stiffer.models} (nDOF {own.ndof} and {other.ndof})"
        return self._decide(
            ratios[name] >= 1.0,
            decides,
            ratios[name],
            models=f"{self.series.models}, {stiffer.models}",
        )

    def like(
        self, others: RefinementSeries, limit: float, *, above: float
    ) -> EvaluatedStatement | None:
        """Deviations of two kinds of models of about equal nDOF differ by less than a limit.

        Args:
            others: Models of about equal nDOF.
            limit: Largest difference of two relative deviations [-].
        """
        gaps = []
        for own in deviations(self.series, self.quantities, above=above):
            other = nearest_rung(others, own.point.ndof, own.quantity)
            if other is not None:
                gap = own.value - (
                    other.values[own.quantity]
                    / reference_value(self.series.beam, own.quantity, "analytic")
                    - 1.0
                )
                gaps.append((gap, own, other))
        if not gaps:
            return None
        gap, own, other = max(gaps, key=lambda item: abs(item[0]))
        decides = f"{100 * gap:+.3g} points: {own} against {other.kind} at nDOF {other.ndof}"
        return self._decide(
            abs(gap) < limit, decides, gap, models=f"{others.models}, {self.series.models}"
        )

    def costlier_than(
        self, few: RefinementSeries, limit: float, *, least: float
    ) -> EvaluatedStatement | None:
        """These models need at least so many times the dofs of others to stay within a limit of the
        analytic values.

        Args:
            few: Models that need fewer dofs.
            limit: Largest relative deviation [-].
            least: Least ratio of the nDOF needed [-].
        """
        if not (self.series.points and few.points):
            return None
        needed, enough = (
            ndof_within(series, self.quantities, limit) for series in (self.series, few)
        )
        models = f"{few.models}, {self.series.models}"
        share = f"{100 * limit:g} %"
        last = self.series.points[-1].ndof
        if enough is None:
            return self._decide(
                False, f"{few.models} does not stay within {share}", None, models=models
            )
        ratio = (last if needed is None else needed) / enough
        many = f"more than {last}: over" if needed is None else f"{needed}:"
        return self._decide(
            ratio >= least,
            f"nDOF {enough} against {many} {ratio:.3g} times, for {share}",
            ratio,
            models=models,
        )

    def reaches(self, limit: float, *, against: Against) -> EvaluatedStatement | None:
        """Check that the largest model lies within a limit [-] of a reference, in every quantity."""
        if not self.series.points:
            return None
        finest = list(worst_by_ndof(self.series, self.quantities, against=against).values())[-1]
        enough = ndof_within(self.series, self.quantities, limit, against=against)
        decides = f"from nDOF {enough} on; {finest}" if enough is not None else str(finest)
        return self._decide(enough is not None, decides, finest.value)

    def _decide(
        self,
        confirmed: bool,
        decides: str,
        value: float | None,
        note: str = "",
        *,
        models: str = "",
    ) -> EvaluatedStatement:
        return EvaluatedStatement(
            self.series.figure,
            models or self.series.models,
            self.text,
            confirmed,
            decides,
            value,
            note,
        )

    def _lacking(self, above: float, below: float = np.inf) -> list[RefinementPoint]:
        """Models between two nDOF that miss a quantity."""
        inside = [point for point in self.series.points if above <= point.ndof <= below]
        return [
            point for point in inside if any(name not in point.values for name in self.quantities)
        ]

    def _solid_off(self, quantity: str) -> float:
        """Deviation of converged 3D elasticity from the analytic value [-]."""
        reference = self.series.beam.references[quantity]
        return reference.solid / reference.analytic - 1.0

    def _name_solid(self, quantity: str, *, digits: int) -> str:
        return f"converged 3D elasticity itself lies at {100 * self._solid_off(quantity):+.{digits}f} %"

    def _blame_reference(self, quantity: str, limit: float) -> str:
        """Says so where a right model cannot meet a limit, since the analytic value it is compared
        with is off.
        """
        reference = self.series.beam.references[quantity]
        off = {"beam theory with shear": reference.beam / reference.analytic - 1.0}
        off["converged 3D elasticity"] = self._solid_off(quantity)
        words = [
            f"{name} itself lies at {100 * share:+.2f} %"
            for name, share in off.items()
            if abs(share) >= limit
        ]
        return f"{', '.join(words)}: {reference.note}" if words else ""


def _name_missing(point: RefinementPoint) -> str:
    return f"a mode is missing at nDOF {point.ndof} ({point.kind})"


def evaluate_statements(
    beam: ReferenceBeam, points: Sequence[RefinementPoint]
) -> list[EvaluatedStatement]:
    """Check every statement about a beam that its series has models to decide by, in the order of
    the paper's figures.
    """
    evaluate = _evaluate_cantilever if beam.name == "kono-cantilever" else _evaluate_fixed_beam
    return _decided(evaluate(beam, points))


def evaluate_own(
    beam: ReferenceBeam, points: Sequence[RefinementPoint]
) -> list[EvaluatedStatement]:
    """Check what the paper does not say: second-order elements reach converged 3D elasticity,
    segments reach beam theory with shear.
    """
    found: list[EvaluatedStatement | None] = []
    groups: tuple[Group, ...] = ("static", "modal")
    for group in groups:
        names = [name for name, reference in beam.references.items() if reference.group == group]
        text = (
            f"second-order elements come within {100 * SOLID_LIMIT:g} % of converged 3D elasticity"
        )
        fine = [pick_series(beam, points, group, kind) for kind in QUADRATIC]
        found += [
            _Statement(series, text, names).reaches(SOLID_LIMIT, against="solid") for series in fine
        ]
        # the loaded patch holds a part of the span against twist, at most all that lies under it
        limit = BEAM_LIMIT + (
            PATCH / beam.size[beam.axis]
            if beam.ends == "clamped-clamped" and group == "static"
            else 0.0
        )
        text = (
            f"segments come within {100 * limit:.2g} % of beam theory with shear and free warping"
        )
        found.append(
            _Statement(pick_series(beam, points, group, "segmented"), text, names).reaches(
                limit, against="beam"
            )
        )
    return _decided(found)


def _decided(claims: Sequence[EvaluatedStatement | None]) -> list[EvaluatedStatement]:
    return sorted((claim for claim in claims if claim is not None), key=lambda claim: claim.figure)


def _evaluate_cantilever(
    beam: ReferenceBeam, points: Sequence[RefinementPoint]
) -> list[EvaluatedStatement | None]:
    modes = [name for name, reference in beam.references.items() if reference.group == "modal"]
    loads = [*FORCES, *TORSION]
    segments = pick_series(beam, points, "static", "segmented")
    found = [
        _Statement(segments, "every deviation < 10 % from nDOF 30", loads).below(0.10, above=30),
        _Statement(segments, "every deviation < 4 % from nDOF 90", loads).below(0.04, above=90),
        _Statement(segments, "deviations shrink as nDOF grows", loads).shrinks(),
        _Statement(segments, "deviations almost constant above nDOF 60", FORCES[:2]).constant(
            ALMOST, above=60
        ),
    ]
    for series in (pick_series(beam, points, "static", kind) for kind in LINEAR):
        found += [
            _Statement(
                segments, "small segmented models are softer than small FE models", loads
            ).softer_than(series),
            _Statement(series, "< 10 % from nDOF 40, dx(Mc) apart", FORCES).below(
                0.10, above=40, note=PLAIN
            ),
            _Statement(series, "< 2 % from nDOF 200, dx(Mc) apart", FORCES).below(
                0.02, above=200, note=PLAIN
            ),
            _Statement(series, "dx(Mc) still > 10 % above nDOF 500", TORSION).exceeds(
                0.10, above=500, below=2000, note=ACROSS
            ),
            _Statement(series, "differ by < 5 % above nDOF 100, dx(Mc) apart", FORCES).like(
                segments, 0.05, above=100
            ),
        ]
    segments = pick_series(beam, points, "modal", "segmented")
    found += [
        _Statement(segments, "every deviation < 20 % from nDOF 60", modes).below(0.20, above=60),
        _Statement(segments, "every deviation < 16 % above nDOF 200", modes).below(0.16, above=200),
        _Statement(segments, "X3 is missing at the smallest nDOF", ["X3"]).coarsest_lacks(),
    ]
    for series in (pick_series(beam, points, "modal", kind) for kind in LINEAR):
        found += [
            _Statement(series, "every deviation < 20 % from nDOF 100", modes).below(
                0.20, above=100, note=PLAIN
            ),
            _Statement(series, "every deviation < 15 % above nDOF 200", modes).below(
                0.15, above=200, note=PLAIN
            ),
            _Statement(series, "X3 is missing at the smallest nDOF", ["X3"]).coarsest_lacks(),
            _Statement(
                segments, "segments deviate less in X2 and X3 from nDOF 40 to 100", ["X2", "X3"]
            ).smaller_than(series, above=40, below=100),
            _Statement(series, "differ by < 10 % above nDOF 100", modes).like(
                segments, 0.10, above=100
            ),
        ]
    return found


def _evaluate_fixed_beam(
    beam: ReferenceBeam, points: Sequence[RefinementPoint]
) -> list[EvaluatedStatement | None]:
    shifts, bending = [AT_CENTRE, ABOVE], ["X1", "X2"]
    segments = pick_series(beam, points, "static", "segmented")
    found = [
        _Statement(segments, "dx within 10 % from nDOF 90", shifts).below(0.10, above=90),
        _Statement(segments, "dx and dz within 3 % above nDOF 300", [*shifts, TILT]).below(
            0.03, above=300
        ),
        _Statement(segments, "deviations of dx shrink as nDOF grows", shifts).shrinks(),
        _Statement(segments, "deviations of dx almost constant above nDOF 200", shifts).constant(
            ALMOST, above=200
        ),
    ]
    linear = [pick_series(beam, points, "static", kind) for kind in LINEAR]
    found += [
        _Statement(
            series, "> 70 % without midside nodes, on the coarsest mesh", shifts
        ).coarsest_exceeds(0.70)
        for series in linear
    ]
    for series in (pick_series(beam, points, "static", kind) for kind in QUADRATIC):
        found += [
            _Statement(series, "12 to 40 % with midside nodes", shifts).between(0.12, 0.40),
            _Statement(series, "still > 10 % at h_F = 100 mm near nDOF 10 000", [ABOVE]).exceeds(
                0.10, above=7e3, below=2e4
            ),
            _Statement(series, "segments need 1/30 of the nDOF, or fewer", shifts).costlier_than(
                segments, 0.10, least=30.0
            ),
        ]
    segments = pick_series(beam, points, "modal", "segmented")
    found += [
        _Statement(segments, "every deviation < 20 % from nDOF 60", ["X1", "T1", "X2"]).below(
            0.20, above=60
        ),
        _Statement(segments, "every deviation < 3 % above nDOF 400", ["X1", "T1", "X2"]).below(
            0.03, above=400
        ),
    ]
    for series in (pick_series(beam, points, "modal", kind) for kind in LINEAR):
        found += [
            _Statement(series, "T1 still > 20 % above nDOF 1000", ["T1"]).exceeds(
                0.20, above=1e3, below=MANY
            ),
            _Statement(series, "X1 and X2 < 20 % from nDOF 210", bending).below(
                0.20, above=210, note=PLAIN
            ),
            _Statement(series, "X1 and X2 < 3 % above nDOF 800", bending).below(
                0.03, above=800, note=PLAIN
            ),
            _Statement(series, "segments need half the nDOF, or fewer", bending).costlier_than(
                segments, 0.03, least=2.0
            ),
        ]
    return found
