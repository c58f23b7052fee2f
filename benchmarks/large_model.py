"""What a part of millions of dofs that is split over many ranks will take: computed, from steps that
were measured on smaller ones.

    ./headstock exec python3 benchmarks/large_model.py [--dofs 10e6] [--ranks 64] [--on-a-node 16]

``MEASURED`` is what ``benchmarks/split_part.py --sizes 100k,300k --ranks 2`` printed with one thread
per rank on 2 cores of a virtual AMD EPYC (Zen 4), nothing else running, the shortest times and
largest memory of two runs: the column of ``column_job.py``, second-order tetrahedra, 12 boundary
dofs, 20 fixed-interface modes. Growth between these sizes is continued to the wanted one; beside it
stands the growth of a compact part, where that is larger. What all ranks share is divided by their
number, once as if nothing were lost and once as if half of it were: more than two ranks were not
measured. What rank 0 does alone is not divided.

Source of the growth of compact parts: George (1973), Nested dissection of a regular finite element
mesh, in space: factors of n^(4/3) entries from n^2 operations.
"""

import argparse
import math
from dataclasses import dataclass

from headstock.geometry.parts.components import MeshSettings
from headstock.pipeline.planning.budgets import mesh_memory_mb, mesh_seconds

DOFS, RANKS = (103_593, 298_668), 2
LIBRARIES_MB = 132.0  # of a rank before it begins
UNEVEN = 1.11  # largest rank over the mean
LOST = 0.5


@dataclass(frozen=True)
class Step:
    """A step of the reduction at the two sizes of ``DOFS``.

    Attributes:
        seconds: By the clock.
        held_mb: Peak of all ranks together, above what the libraries take; None where it is that
            of the step before.
        on_top: Whether that peak comes on top of that of the step before.
        compact: Exponents of seconds and memory for a compact part.
        alone: Rank 0 does it.
    """

    seconds: tuple[float, float]
    held_mb: tuple[float, float] | None = None
    compact: tuple[float, float] = (1.0, 1.0)
    on_top: bool = False
    alone: bool = False


FACTORS, SOLVES = (2.0, 4.0 / 3.0), (4.0 / 3.0, 4.0 / 3.0)
MEASURED = {
    "assembly": Step((1.0, 2.3), (187.0, 529.0)),
    "factors": Step((1.9, 12.4), (938.0, 3717.0), FACTORS),
    "constraint modes": Step((0.2, 0.7), None, SOLVES),
    "modes": Step((1.9, 8.9), (175.0, 497.0), (SOLVES[0], 1.0), on_top=True),
    "truncation": Step((0.2, 0.7)),
    "mesh errors": Step((0.4, 1.2)),
    "skin": Step((0.0, 0.7), alone=True),
}


@dataclass(frozen=True)
class Expected:
    """A step at the wanted size.

    Attributes:
        exponent: Of the seconds.
        seconds: By the clock, nothing lost.
        lossy_seconds: With half of what ranks share lost.
        rank_gb: Peak of the largest rank; None where it is that of the step before.
    """

    exponent: float
    seconds: float
    lossy_seconds: float
    rank_gb: float | None


def growth(values: tuple[float, float], *, least: float = 1.0) -> float:
    """Exponent of the dofs between the two sizes, at least this."""
    if values[0] <= 0.0:  # too short to be seen
        return least
    return max(least, math.log(values[1] / values[0]) / math.log(DOFS[1] / DOFS[0]))


def expect_all(dofs: float, ranks: int, *, compact: bool) -> list[Expected]:
    """Continue the growth of every step.

    Args:
        dofs: Wanted size.
        ranks: That share it.
        compact: Whether the growth of a compact part counts where it is larger.
    """
    found: list[Expected] = []
    peak_gb = 0.0
    for step in MEASURED.values():
        found.append(_expect(step, dofs, ranks, compact=compact, below_gb=peak_gb))
        peak_gb = found[-1].rank_gb or peak_gb
    return found


def _expect(step: Step, dofs: float, ranks: int, *, compact: bool, below_gb: float) -> Expected:
    least = step.compact if compact else (1.0, 1.0)
    larger, exponent = dofs / DOFS[1], growth(step.seconds, least=least[0])
    seconds = step.seconds[1] * larger**exponent
    if step.alone:
        return Expected(exponent, seconds, seconds, None)
    seconds *= RANKS / ranks
    rank_gb = None
    if step.held_mb is not None:
        held_mb = step.held_mb[1] * larger ** growth(step.held_mb, least=least[1])
        rank_gb = UNEVEN * held_mb / ranks / 1e3
        rank_gb += below_gb if step.on_top else LIBRARIES_MB / 1e3
    return Expected(exponent, seconds, seconds / LOST, rank_gb)


def show(dofs: float, ranks: int, on_a_node: int) -> str:
    """The table."""
    mesh_s = mesh_seconds(round(dofs), MeshSettings(size=1.0, cells="tet", order=2))
    mesh_gb = mesh_memory_mb(round(dofs)) / 1e3
    meshing = Expected(1.0, mesh_s, mesh_s, mesh_gb)
    columns = [[meshing, *expect_all(dofs, ranks, compact=compact)] for compact in (False, True)]
    names = [f"{name}, rank 0" if step.alone else name for name, step in MEASURED.items()]
    lines = [
        f"computed, not measured: {dofs:.3g} dofs on {ranks} ranks; seconds if nothing and if half is lost",
        f"{'':20}{'growth as measured':^32}{'of a compact part':^32}",
        f"{'':20}" + f"{'n^p':>6}{'s':>8}{'s, half':>9}{'GB/rank':>9}" * 2,
    ]
    for number, name in enumerate(["meshing, rank 0", *names]):
        lines.append(f"{name:20}" + "".join(_show_step(column[number]) for column in columns))
    totals = [
        Expected(
            0.0,
            sum(step.seconds for step in column),
            sum(step.lossy_seconds for step in column),
            max(step.rank_gb or 0.0 for step in column[1:]),
        )
        for column in columns
    ]
    lines.append(f"{'all':20}" + "".join(_show_step(total) for total in totals))
    nodes = " and ".join(f"{(total.rank_gb or 0.0) * on_a_node:.0f}" for total in totals)
    lines.append(
        f"a node with {on_a_node} ranks holds {nodes} GB; while rank 0 meshes, {mesh_gb:.0f} GB"
    )
    return "\n".join(line.rstrip() for line in lines)


def _show_step(step: Expected) -> str:
    exponent = f"{step.exponent:.2f}" if step.exponent else ""
    memory = "" if step.rank_gb is None else f"{step.rank_gb:.1f}"
    return f"{exponent:>6}{step.seconds:8.0f}{step.lossy_seconds:9.0f}{memory:>9}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--dofs", type=float, default=10e6)
    parser.add_argument("--ranks", type=int, default=64)
    parser.add_argument("--on-a-node", type=int, default=16)
    options = parser.parse_args()
    print(show(options.dofs, options.ranks, options.on_a_node))


if __name__ == "__main__":
    main()
