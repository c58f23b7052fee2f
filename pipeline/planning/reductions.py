"""How each component is reduced: which fixed-interface modes are kept, and whether its equations are
factored or iterated.

A static analysis needs constraint modes and no eigenpairs; fixed-interface modes are kept as far as
the scene says, else up to ``MODE_MARGIN`` times the highest wanted frequency (``FRF_MARGIN`` times
that of a frequency response), else ``default_mode_count`` of them.
"""

import dataclasses
import math
from collections.abc import Sequence

from headstock.geometry.parts.components import Component, ReductionSettings
from headstock.pipeline.planning.analyses import EXACT_MARGIN, is_dynamic, list_reaches
from headstock.pipeline.planning.budgets import reduction_memory_mb
from headstock.pipeline.planning.node_memory import node_memory_bytes
from headstock.reduction.components.solver_choice import (
    SolverChoice,
    choose_method,
    predict_factor_entries,
)
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.scene import Analyses, Scene

FEWEST_DEFAULT_MODES = 20
# limit of the default: what these modes leave out of a response is in its ±
MOST_DEFAULT_MODES = 200


def default_mode_count(wanted: int) -> int:
    """Fixed-interface modes kept per component when so many machine frequencies are wanted and no
    frequency is named.
    """
    return max(FEWEST_DEFAULT_MODES, 2 * wanted + 8)


def choose_reduction(component: Component, analyses: Analyses) -> tuple[ReductionSettings, str]:
    """Which fixed-interface modes of a component are kept, and why."""
    written, modal = component.reduction, analyses.get(ModalRequest)
    if not is_dynamic(analyses):
        return ReductionSettings(
            modes=0, solver=written.solver
        ), "static only: constraint modes, no eigenpairs"
    if written.modes is not None:
        return written, f"{written.modes} fixed-interface modes, as the scene says"
    if written.modes_to_hz is not None:
        return written, f"fixed-interface modes up to {written.modes_to_hz:g} Hz, as the scene says"
    reaches = list_reaches(analyses)
    if reaches:
        what = max(reaches, key=lambda name: math.prod(reaches[name]))
        reach, margin = reaches[what]
        # without interfaces modes are those of the component itself, and a margin only serves the
        # estimate of their errors
        limit = reach * (margin if component.interfaces else EXACT_MARGIN)
        settings = dataclasses.replace(written, modes_to_hz=limit, modes=MOST_DEFAULT_MODES)
        text = f"fixed-interface modes up to {limit:g} Hz, {MOST_DEFAULT_MODES} at most"
        return settings, f"{what} up to {reach:g} Hz: {text}"
    wanted = (modal.count if modal is not None else None) or 0
    count = default_mode_count(wanted)
    return dataclasses.replace(
        written, modes=count
    ), f"modal analysis of {wanted} frequencies: {count} fixed-interface modes"


def choose_solver(
    component: Component, scene: Scene, dofs: int, extents: Sequence[float] | None
) -> SolverChoice:
    """By factors where they fit this machine, or what the scene allows of it.

    Args:
        extents: Sides of the box around it [m]; None where unknown.
    """
    limit = scene.limits.memory_bytes
    return choose_method(
        component.reduction,
        predict_factor_entries(dofs, extents),
        direct_mb=reduction_memory_mb(dofs, component),
        memory_mb=(node_memory_bytes() if limit is None else limit) / 1e6,
    )
