"""The stage that contours a block with a lumped mechanism."""

import dataclasses

from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.contouring import run_contour
from headstock.pipeline.stages.contouring_summary import summarise_contour
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.scene.reading.forces import read_forces, resampling_loss

CORIOLIS = "coriolis"
MOST_LOST = 0.1  # of the rms of measured forces


def run_contour_stage(state: RunState, stage: Stage) -> Outcome:
    """Run the contour the scene asks for."""
    if not state.is_root:
        return Outcome()
    mechanism, request = state.scene.mechanism, state.scene.analyses.contouring
    if mechanism is None or request is None or state.placed is None:
        raise ValueError("a contour stage needs a placed mechanism and a contour in the scene")
    if not request.damping_ratios:
        state.warn('the contour runs without damping: write [effects] damping = { modal = "2 %" }')
    if not request.cutting:
        state.warn("the contour is run in air: write [effects] cutting_force = true to cut")
    record = None if request.forces is None or not request.cutting else read_forces(request.forces)
    # the linear model is one about the rigid path, the nonlinear one feels gravity turn by itself
    model = dataclasses.replace(state.placed.model, velocity_terms=CORIOLIS in state.scene.effects, gravity_stiffening=False)
    run = run_contour(mechanism, model, request, record=record)
    found = summarise_contour(mechanism, model, request, run)
    if record is not None:
        found["force_share_faster_than_steps"] = loss = resampling_loss(record, run.times)
        if loss > MOST_LOST:
            state.warn(
                f"{100.0 * loss:.0f} % of the measured forces' rms is faster than the time steps and is averaged over them;"
                " raise steps_per_turn in [analyses.contouring] to see it"
            )
    state.contouring = found
    told = ", ".join(f"face {item['face']} {item['mean_um'][0]:+.1f} µm" for item in found["faces"] if item["face"] in (1, 3))
    return Outcome(detail=f"{len(run.times)} steps, gap along x on {told}")
