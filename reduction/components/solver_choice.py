"""How many entries the factors of a component's stiffness will have, and whether it is factorised or
iterated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from headstock.geometry.parts.components import ReductionSettings, SolverMethod

# CHOLMOD numbers entries by 32-bit integers
MOST_FACTOR_ENTRIES = 2**31
SAFETY = 1.15  # what a prediction may fall short of
LEAF_NODES = 30.0
# METIS on meshes of order 2 leaves less than the lattice has: measured on bars, blocks and plates of
# 15k to 970k dofs (`benchmarks/large_parts.py --entries`), within 10 % for bars and blocks
SHARE_AT_MILLION, SHARE_EXPONENT = 0.81, 0.09


@dataclass(frozen=True)
class SolverChoice:
    """Method by which a component's stiffness is solved.

    Attributes:
        reason: Why, in plain words.
    """

    method: SolverMethod
    reason: str
    factor_entries: float


def predict_factor_entries(dofs: int, extents: Sequence[float] | None) -> float:
    """Return the entries of the Cholesky factors of a meshed component, ordered by nested
    dissection.

    The box around it is cut across its longest side until little is left. Each cut couples with itself
    and with the cuts around its piece; a slender part has small cuts, a compact one large ones.

    Args:
        extents: Sides of the box around it [m]; None takes a cube, which has the most.

    Source: George (1973), nested dissection; the count of his lattice, for boxes of any shape.
    """
    sides = [float(side) for side in (extents if extents is not None else (1.0, 1.0, 1.0))]
    nodes = max(dofs, 1) / 3.0
    spacing = (sides[0] * sides[1] * sides[2] / nodes) ** (1.0 / 3.0)
    counts: list[float] = [max(side / spacing, 1.0) for side in sides]
    # how many of a piece's two faces across each axis are cuts, in the mean over all pieces
    faces = [0.0, 0.0, 0.0]
    pieces, entries = 1.0, 0.0
    while counts[0] * counts[1] * counts[2] > LEAF_NODES:
        axis = counts.index(max(counts))
        across = counts[0] * counts[1] * counts[2] / counts[axis]
        cut = 3.0 * across
        entries += pieces * cut * (0.5 * cut + _cuts_around(counts, faces))
        counts[axis] *= 0.5
        faces[axis] = 0.5 * faces[axis] + 1.0
        pieces *= 2.0
    leaf = 3.0 * counts[0] * counts[1] * counts[2]
    entries += pieces * leaf * (0.5 * leaf + _cuts_around(counts, faces))
    return entries * SHARE_AT_MILLION * float((dofs / 1e6) ** SHARE_EXPONENT)


def _cuts_around(counts: Sequence[float], faces: Sequence[float]) -> float:
    """Return the dofs of the cuts around a piece, that couple with what is eliminated within it."""
    volume = counts[0] * counts[1] * counts[2]
    return sum(3.0 * faces[axis] * volume / counts[axis] for axis in range(3))


def choose_method(
    settings: ReductionSettings,
    factor_entries: float,
    *,
    direct_mb: float = 0.0,
    memory_mb: float = float("inf"),
) -> SolverChoice:
    """Return how a component is to be solved with: as its settings say, else by factors as long as
    they can be numbered and fit.

    Args:
        settings: Of its reduction; ``verify`` counts modes by factors.
        direct_mb: Memory that the factorisation would take [MB].
        memory_mb: Memory that there is [MB].
    """
    count = f"{factor_entries:.2g} factor entries"
    if settings.solver != "auto":
        return SolverChoice(
            settings.solver, f"{settings.solver}, as the scene says", factor_entries
        )
    if settings.verify:
        return SolverChoice("direct", f"direct, as verify needs factors: {count}", factor_entries)
    if SAFETY * factor_entries >= MOST_FACTOR_ENTRIES:
        why = f"iterative: {count}, more than CHOLMOD is sure to number ({MOST_FACTOR_ENTRIES:.2g})"
        return SolverChoice("iterative", why, factor_entries)
    if direct_mb > memory_mb:
        why = f"iterative: {count} would take about {direct_mb:.3g} MB of the {memory_mb:.3g} MB there are"
        return SolverChoice("iterative", why, factor_entries)
    return SolverChoice("direct", f"direct: {count}", factor_entries)
