"""What Kono, Lorenzer, Weikert and Wegener say of their two beams in section 3, and what Headstock's ladder must show besides."""

from collections.abc import Sequence

from headstock.validation.ladder.claims import (
    Claim,
    claim_above,
    claim_alike,
    claim_below,
    claim_between,
    claim_coarsest,
    claim_constant,
    claim_missing,
    claim_ratio,
    claim_reached,
    claim_shrinking,
    claim_smaller,
    claim_softer,
)
from headstock.validation.ladder.ladder_deviations import pick_rungs
from headstock.validation.ladder.points import LINEAR, QUADRATIC, LadderPoint
from headstock.validation.ladder.references import Group, LadderBeam
from headstock.validation.parts.beam_components import PATCH

FORCES = ("dx(Fx)", "dy(Fy)", "dz(Fz)", "dy(Ma)", "dx(Mb)")
TORSION = ("dx(Mc)",)
AT_CENTRE, ABOVE, TILT = "dx(Fx), h_F = 0", "dx(Fx), h_F = 100 mm", "dz(Fx), h_F = 100 mm"
SOLID_LIMIT, BEAM_LIMIT = 3e-3, 2e-3
ALMOST = 0.01  # what counts as "almost constant" of a deviation: one point
MANY = 1e9
ACROSS = "these elements get smaller across the section too, which lets it warp"
PLAIN = "plain linear elements lock in bending; the paper's must have had bending shapes: see wilson8"


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
