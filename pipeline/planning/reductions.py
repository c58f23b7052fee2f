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
from headstock.pipeline.planning.budgets import reduction_memory_mb
from headstock.pipeline.planning.node_memory import node_memory_bytes
from headstock.reduction.components.solver_choice import (
    SolverChoice,
    choose_method,
    predict_factor_entries,
)
from headstock.scene.requests import (
    Analyses,
    ContouringRequest,
    ControlRequest,
    FrfRequest,
    LobesRequest,
    ModalRequest,
    PathRequest,
    TransientRequest,
)
from headstock.scene.scene import Scene

# Craig-Bampton frequencies of a column with two rigid faces are right within 0.6 % when modes reach
# 3 times the wanted range (1.5 % at 2 times): Craig and Bampton (1968), checked by `validate
# reduction`.
MODE_MARGIN = 3.0
# Beside a resonance a response is far more sensitive: 12 times keep it within 1 % of the whole
# model up to 1.5 times the highest frequency, 3 times miss up to 6 % (`validate
# frequency_response`, a column with two rigid faces, loss factor 4 %).
FRF_MARGIN = 12.0
EXACT_MARGIN = 1.5
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
    reaches = _reaches(analyses)
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


def is_dynamic(analyses: Analyses) -> bool:
    """Whether an analysis needs mass and fixed-interface modes."""
    return any(
        request is not None
        for request in (
            analyses.get(ModalRequest),
            analyses.get(FrfRequest),
            analyses.get(PathRequest),
            analyses.get(ControlRequest),
            analyses.get(ContouringRequest),
            analyses.get(LobesRequest),
            analyses.get(TransientRequest),
        )
    )


def _reaches(analyses: Analyses) -> dict[str, tuple[float, float]]:
    """How high each analysis looks [Hz], and how many times that the modes must reach; a count of
    frequencies says nothing.
    """
    found = {}
    modal = analyses.get(ModalRequest)
    if modal is not None and modal.up_to_hz is not None:
        found["modal analysis"] = (modal.up_to_hz, MODE_MARGIN)
    if FrfRequest in analyses:
        found["frequency response"] = (analyses[FrfRequest].to_hz, FRF_MARGIN)
    if PathRequest in analyses:
        found["path analysis"] = (analyses[PathRequest].band_hz, MODE_MARGIN)
    if ContouringRequest in analyses:
        found["contour"] = (analyses[ContouringRequest].modes_to_hz, MODE_MARGIN)
    if ControlRequest in analyses:
        found["control"] = (analyses[ControlRequest].up_to_hz, MODE_MARGIN)
    if LobesRequest in analyses:
        found["lobes"] = (analyses[LobesRequest].up_to_hz, MODE_MARGIN)
    if TransientRequest in analyses:
        found["transient analysis"] = (analyses[TransientRequest].up_to_hz, MODE_MARGIN)
    return found


def choose_solver(
    component: Component, scene: Scene, dofs: int, extents: Sequence[float] | None
) -> SolverChoice:
    """By factors where they fit this machine, or what the scene allows of it.

    Args:
        component: Elastic.
        scene: It stands in, with its limits.
        dofs: Displacement dofs.
        extents: Sides of the box around it [m]; None where unknown.
    """
    limit = scene.limits.memory_bytes
    return choose_method(
        component.reduction,
        predict_factor_entries(dofs, extents),
        direct_mb=reduction_memory_mb(dofs, component),
        memory_mb=(node_memory_bytes() if limit is None else limit) / 1e6,
    )
