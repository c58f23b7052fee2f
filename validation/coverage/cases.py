"""How often what stands behind ± covers the truth, over parts of many kinds: the ± of meshes, curved faces and modes left out."""

from collections.abc import Callable, Sequence

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.validation.coverage.parts import PRODUCT
from headstock.validation.coverage.runs import SURE, PartCoverage, cover_part
from headstock.validation.references.rows import ValidationRow, judge_bound, show

CASE, SMOKE = "coverage", "coverage-smoke"
# factors were fitted on the first parts; the others were drawn and kept apart before that, a product's part joined them
CALIBRATION, HOLD_OUT = range(24), (*range(24, 48), PRODUCT)
SMOKE_PARTS = (8, 15)
COVERED = 0.95
LARGEST_MEDIAN = 3.0
COVERED_RESPONSES = 0.9
CLEAR = 1e-4  # true errors above which a ratio means something


def check_coverage(comm: MPI.Comm) -> list[ValidationRow]:
    """Coverage of frequencies, compliances and frequency responses on the parts that factors were fitted on, and on the others."""
    return _on_root(comm, lambda: [*_judge(CASE, "fitted on", _cover(CALIBRATION)), *_judge(CASE, "held out", _cover(HOLD_OUT))])


def check_coverage_smoke(comm: MPI.Comm) -> list[ValidationRow]:
    """The same on a tube and a sheet, in seconds."""
    return _on_root(comm, lambda: _judge(SMOKE, "two parts", _cover(SMOKE_PARTS)))


def _on_root(comm: MPI.Comm, compute: Callable[[], list[ValidationRow]]) -> list[ValidationRow]:
    return list(comm.bcast(compute() if comm.rank == 0 else None, root=0))


def _cover(seeds: Sequence[int]) -> list[PartCoverage]:
    return [cover_part(seed) for seed in seeds]


def _judge(case: str, what: str, parts: Sequence[PartCoverage]) -> list[ValidationRow]:
    covered = [_covered(part) for part in parts]
    numbers = np.concatenate(covered)
    given = np.concatenate([part.estimates[_known(part)] for part in parts])
    true = np.concatenate([part.errors[_known(part)] for part in parts])
    frequencies = sum(int((part.compliances[_known(part)] == 0.0).sum()) for part in parts)
    silent = sum(int(np.isnan(part.estimates).sum()) for part in parts)
    unsure = sum(len(part.errors) for part in parts) - len(numbers) - silent
    note = (
        f"{frequencies} frequencies and {len(numbers) - frequencies} compliances of {len(parts)} parts; {silent} say ± ?, of {unsure}"
        f" the truth is not sure enough; {sum(bool(part.failure) for part in parts)} parts with a mesh that failed"
    )
    clear = true > CLEAR
    shares = np.array([own.mean() for own in covered if len(own)])
    responses = np.concatenate([part.lines for part in parts])
    lines = responses[~np.isnan(responses)]
    rows = [
        judge_bound(case, f"{what}: share of numbers that ± does not cover", 1.0 - float(numbers.mean()), 1.0 - COVERED, note),
        show(case, f"{what}: coverage by part, mean", float(shares.mean()), "-", f"least {shares.min():.2f}; {_by_kind(parts)}"),
        show(case, f"{what}: parts with 95 % of their numbers covered", float((shares >= COVERED).mean()), "-"),
        judge_bound(
            case,
            f"{what}: ± over true error, median",
            float(np.median(given[clear] / true[clear])),
            LARGEST_MEDIAN,
            f"{clear.sum()} numbers with errors above {CLEAR:g}",
        ),
        judge_bound(
            case,
            f"{what}: share of frequency responses without 95 % of their lines covered",
            1.0 - float((lines >= COVERED).mean()),
            1.0 - COVERED_RESPONSES,
            f"{len(lines)} responses, {len(responses) - len(lines)} more whose truth is not sure enough; lines within 40 dB of the highest"
            f" peak; {_responses_by_kind(parts)}",
        ),
    ]
    return rows


def _known(part: PartCoverage) -> FloatArray:
    """Which numbers have an estimate, and a truth that is sure enough to judge it."""
    return np.asarray(part.unsure <= SURE * part.estimates)


def _covered(part: PartCoverage) -> FloatArray:
    known = _known(part)
    return np.asarray(part.errors[known] <= part.estimates[known])


def _by_kind(parts: Sequence[PartCoverage]) -> str:
    found: dict[str, list[FloatArray]] = {}
    for part in parts:
        found.setdefault(part.kind, []).append(_covered(part))
    return ", ".join(f"{kind} {np.concatenate(own).mean():.2f}" for kind, own in found.items() if len(np.concatenate(own)))


def _responses_by_kind(parts: Sequence[PartCoverage]) -> str:
    found: dict[str, list[FloatArray]] = {}
    for part in parts:
        found.setdefault(part.kind, []).append(part.lines[~np.isnan(part.lines)] >= COVERED)
    return ", ".join(f"{kind} {np.concatenate(own).mean():.2f}" for kind, own in found.items() if len(np.concatenate(own)))
