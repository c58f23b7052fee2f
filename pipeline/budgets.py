"""Degrees of freedom, memory and time before anything is computed."""

import os
from collections.abc import Sequence

from headstock.geometry.components import Component, MeshSettings
from headstock.geometry.errors import HeadstockError
from headstock.meshing.sizing import CELL_BUDGET
from headstock.pipeline.stages import Stage

# Nodes per cell of an endless mesh, and how much its surface adds: 1 + share / cells^(1/3); measured on blocks, within a quarter.
NODES_PER_CELL = {("tet", 1): (0.18, 7.0), ("tet", 2): (1.38, 4.7), ("hex", 1): (1.0, 2.4), ("hex", 2): (8.0, 2.4)}
# Measured on steel blocks of 20k to 1M dofs with one MUMPS factorisation and 32 reduced dofs: 0.26, 1.2, 4.0, 17.7 GB.
REFERENCE_DOFS = 100_000
REFERENCE_MB = 1100.0
MEMORY_EXPONENT = 1.2
BASE_MB = 130.0
COPIES_OF_BASIS = 2
# Measured on steel columns of 100k and 300k dofs (docs/performance.md): 5.8 and 28 s with 32 reduced dofs, 1.6 times that with 72.
REFERENCE_SECONDS = 5.8
SECONDS_EXPONENT = 1.5
REFERENCE_VECTORS = 32
SECONDS_PER_VECTOR = 0.016
MESHING_SECONDS_PER_DOF = 3e-5
# estimates are refused only where they exceed the limit by more than their own error; the run itself stops at the limit
TIME_MARGIN = 2.0


class BudgetError(HeadstockError):
    """A scene asks for more than the machine or its own limits allow; nothing has been computed."""


def displacement_dofs(cells: int, settings: MeshSettings) -> int:
    """Displacement dofs of a mesh with so many cells."""
    nodes, surface_share = NODES_PER_CELL[settings.cells, settings.order]
    return round(3 * nodes * cells * (1.0 + surface_share / float(max(cells, 1) ** (1.0 / 3.0))))


def mesh_memory_mb(dofs: int) -> float:
    """Peak memory of meshing [MB]: about 1 kB per dof in the mesher."""
    return BASE_MB + dofs / 1000.0


def reduction_memory_mb(dofs: int, component: Component) -> float:
    """Peak memory of assembly, factorisation and reduction [MB]; grows like ``n^1.2`` with a sparse direct solver in 3D."""
    vectors = _vector_count(component)
    factor = REFERENCE_MB * float((dofs / REFERENCE_DOFS) ** MEMORY_EXPONENT)
    return BASE_MB + factor + COPIES_OF_BASIS * 8e-6 * dofs * vectors


def mesh_seconds(dofs: int) -> float:
    """Processor time of meshing [s]."""
    return 0.3 + MESHING_SECONDS_PER_DOF * dofs


def reduction_seconds(dofs: int, component: Component) -> float:
    """Processor time of assembly, factorisation and reduction [s]."""
    vectors = _vector_count(component)
    share = max(0.5, 1.0 + SECONDS_PER_VECTOR * (vectors - REFERENCE_VECTORS))
    return REFERENCE_SECONDS * share * float((dofs / REFERENCE_DOFS) ** SECONDS_EXPONENT)


def check_cells(component: Component, cells: int, limit: int | None) -> None:
    """Refuse a mesh with more cells than the scene allows, or than the mesher does.

    Raises:
        BudgetError: Names the component, the estimate and the limit.
    """
    allowed = CELL_BUDGET if limit is None else min(limit, CELL_BUDGET)
    if cells > allowed:
        whose = "limits.elements allows" if limit == allowed else "the mesher takes at most"
        raise BudgetError(
            f"component {component.name!r} would be meshed with about {cells:.3g} cells, {whose} {allowed};"
            " write a larger mesh size"
        )


def check_time(stages: Sequence[Stage], limit_s: float | None) -> None:
    """Refuse stages that together would take far longer than the scene allows, if it says so.

    Raises:
        BudgetError: Names the longest stage, the estimates and the limit.
    """
    total = sum(stage.estimated_seconds or 0.0 for stage in stages)
    if limit_s is not None and total > TIME_MARGIN * limit_s:
        longest = max(stages, key=lambda stage: stage.estimated_seconds or 0.0)
        raise BudgetError(
            f"this run would take about {total:.3g} s, {longest.kind} of component {longest.component!r} with about"
            f" {longest.estimated_dofs:.3g} dofs alone {longest.estimated_seconds:.3g} s, limits.time allows {limit_s:g} s;"
            " write a larger mesh size or keep fewer modes"
        )


def check_elapsed(seconds: float, limit_s: float | None, stage: Stage) -> None:
    """Stop a run that has used up the time the scene allows.

    Raises:
        BudgetError: Names the stage that was due, the time and the limit.
    """
    if limit_s is not None and seconds > limit_s:
        due = stage.component or stage.pose
        raise BudgetError(
            f"{seconds:.3g} s have passed, limits.time allows {limit_s:g} s; stopped before {stage.kind}"
            + (f" of {due!r}" if due else "")
            + ": earlier results are as they were, and what was meshed and reduced is kept for the next run"
        )


def check_memory(stages: Sequence[Stage], limit_bytes: float | None) -> None:
    """Refuse stages that would need more memory than the scene allows, or than this machine has.

    Raises:
        BudgetError: Names the stage, its estimate and the limit.
    """
    limit_mb = (physical_memory_bytes() if limit_bytes is None else limit_bytes) / 1e6
    for stage in stages:
        if stage.estimated_memory_mb is not None and stage.estimated_memory_mb > limit_mb:
            whose = "this machine has" if limit_bytes is None else "limits.memory allows"
            raise BudgetError(
                f"{stage.kind} of component {stage.component!r} with about {stage.estimated_dofs:.3g} dofs would need about"
                f" {stage.estimated_memory_mb:.3g} MB, {whose} {limit_mb:.3g} MB; write a larger mesh size or keep fewer modes"
            )


def physical_memory_bytes() -> float:
    """Memory of this machine [byte]."""
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _vector_count(component: Component) -> int:
    """Boundary dofs and modes that are certain; how many modes lie below a frequency nobody knows beforehand."""
    settings = component.reduction
    return 6 * len(component.interfaces) + (settings.modes or 0 if settings.modes_to_hz is None else 0)
