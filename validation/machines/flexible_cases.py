"""Bodies that are cut into parts and joined again by flexible interfaces, against the body as one
mesh.
"""

from collections.abc import Iterator

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.validation.machines.split_bodies import (
    FORMS,
    Bar,
    Form,
    SplitBody,
    count_shapes,
    cut_box,
    divide,
    find_joined_frequencies,
    find_whole_frequencies,
    join_parts,
)
from headstock.validation.references.rows import ValidationRow, compare_bound, show

WATCHED = 10
GOAL = 2e-3
# what modes left out may disturb the order of two bases by, over a frequency
DISTURBED = 1e-4
SHAPES = (0, 3, 12, 24, 30)
MANY_SHAPES = 200
MODES, SMOKE_MODES = 160, 40  # of each part

BEAM, PLATE, BLOCK = (0.4, 0.04, 0.03), (0.3, 0.2, 0.01), (0.2, 0.15, 0.24)
SHAFT = (0.1, 0.1, 0.24)
# parts meet over a whole section: stresses there are those of a smooth body
CUTS = (
    cut_box("beam, 2 parts", BEAM, (20, 4, 4), axis=0, parts=2),
    cut_box("beam, 5 parts, other meshes", BEAM, (20, 4, 4), axis=0, parts=5, finer=(1, 3)),
    cut_box("plate across, 2 parts", PLATE, (16, 12, 2), axis=0, parts=2),
    cut_box("plate across, 4 parts, other meshes", PLATE, (16, 12, 2), axis=0, parts=4, finer=(1,)),
    cut_box("block, 2 parts", BLOCK, (6, 5, 8), axis=2, parts=2),
    cut_box("block, 2 parts, other meshes", BLOCK, (6, 5, 8), axis=2, parts=2, finer=(1,)),
    cut_box("block, 4 parts", BLOCK, (6, 5, 8), axis=2, parts=4),
    cut_box("shaft, 2 parts", SHAFT, (4, 4, 10), axis=2, parts=2, round_section=True),
    cut_box(
        "shaft, 3 parts, other meshes",
        SHAFT,
        (4, 4, 12),
        axis=2,
        parts=3,
        finer=(1,),
        round_section=True,
    ),
)
# one part ends on the face of the other: stresses grow without limit along the rim of the joint
STEPS = (
    SplitBody(
        "plates overlapping",
        (divide(0.36, 18), divide(0.12, 6), divide(0.04, 4)),
        (Bar((0.0, 0.0, 0.0), (0.24, 0.12, 0.02)), Bar((0.12, 0.0, 0.02), (0.36, 0.12, 0.04))),
        2,
    ),
    SplitBody(
        "post on a plate",
        (divide(0.3, 12), divide(0.2, 10), divide(0.18, 9)),
        (Bar((0.0, 0.0, 0.0), (0.3, 0.2, 0.04)), Bar((0.1, 0.06, 0.04), (0.2, 0.14, 0.18))),
        2,
    ),
)
SMOKE_BEAM = cut_box("beam, 2 parts", BEAM, (14, 3, 3), axis=0, parts=2)
LAYERS = cut_box("plate of 2 layers", (0.3, 0.2, 0.02), (16, 12, 4), axis=2, parts=2)


def check_flexible_interfaces() -> Iterator[ValidationRow]:
    """Ten frequencies of cut bodies in both forms with more and more shapes."""
    for body in CUTS:
        yield from _evaluate(body, "weak", SHAPES)
    for body in STEPS:
        yield from _evaluate(body, None, SHAPES)
    yield from _evaluate(LAYERS, None, (*SHAPES, MANY_SHAPES))


def check_flexible_smoke() -> list[ValidationRow]:
    """Check a beam in the same way."""
    return _evaluate(SMOKE_BEAM, "weak", (0, 12, 30), modes=SMOKE_MODES)


def _evaluate(
    body: SplitBody,
    required: Form | None,
    shapes: tuple[int, ...],
    *,
    modes: int = MODES,
) -> Iterator[ValidationRow]:
    """Compare a body cut and joined with the whole one; one form of it has to reach the goal."""
    whole = find_whole_frequencies(body, WATCHED)
    finest = {}
    for form in FORMS:
        found, counts = _series(body, form, shapes, modes)
        errors = found / whole - 1.0
        finest[form] = errors[-1]
        furthest = np.abs(errors).max(axis=1)
        note = "; ".join(
            f"{count} shapes: {100.0 * error:.2g} %"
            if np.isfinite(error)
            else f"{count} shapes: modes are missing"
            for count, error in zip(counts, furthest, strict=True)
        )
        quantity = f"{body.name}, {form}, {counts[-1]} shapes: furthest of ten frequencies"
        yield (
            compare_bound(quantity, furthest[-1], GOAL, note)
            if form == required
            else show(quantity, furthest[-1], "-", note)
        )
        yield compare_bound(
            f"{body.name}, {form}: largest step in the wrong direction",
            _find_wrong_step(errors, form),
            DISTURBED,
            "frequencies fall with more shapes" if form == "strong" else "frequencies rise",
        )
    if not body.finer:
        yield compare_bound(
            f"{body.name}: by how much one part lies above the strong form",
            max(0.0, -finest["strong"].min()),
            DISTURBED,
        )


def _series(
    body: SplitBody, form: Form, shapes: tuple[int, ...], modes: int
) -> tuple[FloatArray, list[int]]:
    """Frequencies ``(k, 10)`` [Hz] with so many shapes, and how many there are of them."""
    machines = [join_parts(body, form, most, modes) for most in shapes]
    found = [find_joined_frequencies(machine, WATCHED) for machine in machines]
    return np.array(found), [count_shapes(machine) for machine in machines]


def _find_wrong_step(errors: FloatArray, form: Form) -> float:
    """By how much a frequency rises in the strong form or falls in the weak one at most."""
    known = errors[np.isfinite(errors).all(axis=1)]
    steps = np.diff(known, axis=0)
    return float(max(0.0, (steps if form == "strong" else -steps).max(initial=0.0)))
