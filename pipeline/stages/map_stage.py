"""The stage that maps the workspace of a lumped mechanism, and what is told of the map."""

from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.tool_mechanism import TOOL_POINT
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.map import WorkspaceMap, map_workspace
from headstock.pipeline.stages.run_state import Outcome, RunState


def run_map_stage(state: RunState, stage: Stage) -> Outcome:
    """Survey the grid, shared out over the ranks."""
    mechanism, request = state.scene.mechanism, state.scene.analyses.map
    if mechanism is None or request is None:
        raise ValueError("a map stage needs a mechanism and a map in the scene")
    model = state.comm.bcast(None if state.placed is None else state.placed.model, root=0)
    if model is None:
        raise ValueError("a map stage needs a placed mechanism")
    found = map_workspace(mechanism, model, request, comm=state.comm)
    if found is None:
        return Outcome()
    state.map = summarise_map(found)
    if found.torn:
        state.warn(
            f"modes of the map cannot be followed by their shape between {found.torn} pairs of neighbours;"
            " a finer grid tells which is which"
        )
    first = found.quantities["f1_hz"]
    taken = int(np.isfinite(found.quantities["condition_number"]).sum())
    shared = f" on {state.comm.size} ranks" if state.comm.size > 1 else ""
    return Outcome(detail=f"{taken} of {first.size} poses{shared}, f1 {_span(first)} Hz")


def summarise_map(found: WorkspaceMap) -> dict[str, Any]:
    """As it stands in ``summary.json``; null where a pose cannot be taken."""
    return {
        "axes": list(found.axes),
        "units": {axis: "m" if axis in TOOL_POINT else "rad" for axis in (*found.axes, *found.fixed)},
        "positions": [values.tolist() for values in found.positions],
        "fixed": found.fixed,
        "least_likeness": found.likeness,
        "crossings": [list(pair) for pair in found.crossings],
        "torn": found.torn,
        "f1_and_mean_leg_correlation": found.trend,
        "quantities": {name: _listed(values) for name, values in found.quantities.items()},
    }


def _listed(values: FloatArray) -> list[Any]:
    return [_listed(row) if row.ndim else (float(row) if np.isfinite(row) else None) for row in values]


def _span(values: FloatArray) -> str:
    known = values[np.isfinite(values)]
    return f"{known.min():.4g} .. {known.max():.4g}" if len(known) else "nowhere"
