"""A map over the poses of a lumped mechanism: frequencies, static stiffness at the tool and condition number over a plane."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from headstock.geometry.exechon_poses import survey_tool_poses
from headstock.geometry.frames import FloatArray
from headstock.geometry.machines import Pose
from headstock.geometry.tool_mechanisms import tool_pose
from headstock.pipeline.run_state import Outcome, RunState
from headstock.pipeline.scene import MapRequest, SceneMechanism
from headstock.pipeline.stages import Stage
from headstock.solvers.compliant_mechanism import CompliantMechanism
from headstock.solvers.mechanism_modes import LumpedModes, linearise_poses, solve_pose_modes, tool_compliance

N_PER_UM = 1e-6
LEAST_LIKENESS = 0.5  # squared cosine between the shapes of neighbours from which they are called the same mode


@dataclass(frozen=True, eq=False)
class WorkspaceMap:
    """Quantities over a grid of poses.

    Attributes:
        axes: Names of the two axes of the grid.
        positions: Their positions [m, rad].
        fixed: Positions of the other axes.
        quantities: Name to ``(n0, n1)`` values, NaN where the pose cannot be taken.
        likeness: Least squared cosine between the shapes of one mode in neighbouring poses; 1 is the same shape.
        trend: Correlation of the first frequency with the mean leg length.
    """

    axes: tuple[str, str]
    positions: tuple[FloatArray, FloatArray]
    fixed: dict[str, float]
    quantities: dict[str, FloatArray]
    likeness: float
    trend: float


def run_map_stage(state: RunState, stage: Stage) -> Outcome:
    """Survey the grid, all poses at once."""
    mechanism, request = state.scene.mechanism, state.scene.analyses.map
    if not state.is_root:
        return Outcome()
    if mechanism is None or request is None or state.placed is None:
        raise ValueError("a map stage needs a placed mechanism and a map in the scene")
    found = map_workspace(mechanism, state.placed.model, request)
    state.map = summarise_map(found)
    if found.likeness < LEAST_LIKENESS:
        state.warn("modes of the map change their shape between neighbouring poses; a finer grid tells which is which")
    taken = int(np.isfinite(found.quantities["f1_hz"]).sum())
    return Outcome(detail=f"{taken} of {found.quantities['f1_hz'].size} poses, f1 {_span(found.quantities['f1_hz'])} Hz")


def map_workspace(mechanism: SceneMechanism, model: CompliantMechanism, request: MapRequest) -> WorkspaceMap:
    """Everything over the grid; poses out of reach or beyond a limit are NaN."""
    (first, low), (second, high) = request.axes
    poses = [Pose("", {**request.fixed, first: float(a), second: float(b)}) for a in low for b in high]
    tools = [tool_pose(mechanism, pose.positions) for pose in poses]
    survey = survey_tool_poses(mechanism.mounted, np.array([tool[0] for tool in tools]), np.array([tool[1] for tool in tools]))
    good = survey.within & np.isfinite(survey.condition)
    shape = (len(low), len(high))
    quantities = {"condition_number": np.where(good, survey.condition, np.nan)}
    shapes = np.full((len(poses), len(model.mechanism.compliant), request.count), np.nan)
    frequencies, stiffness, lengths = (np.full((len(poses), n), np.nan) for n in (request.count, 3, 3))
    if good.any():
        motions = linearise_poses(model, survey.states[good])
        modes: LumpedModes = solve_pose_modes(motions)
        turn = mechanism.mounted.mounting.rotation
        compliance = turn @ tool_compliance(model, motions)[:, :3, :3] @ turn.T
        frequencies[good] = modes.frequencies_hz[:, : request.count]
        # stretches of the springs, weighed so that their squares are the shares of the strain energy
        shapes[good] = np.sqrt(modes.energy[:, :, : request.count]) * np.sign(modes.shapes[:, :, : request.count])
        stiffness[good] = N_PER_UM / np.diagonal(compliance, axis1=1, axis2=2)
        lengths[good] = survey.states[good, :3]
    quantities |= {f"f{number + 1}_hz": frequencies[:, number] for number in range(request.count)}
    quantities |= {f"stiffness_{axis}_n_per_um": stiffness[:, place] for place, axis in enumerate("xyz")}
    quantities["mean_leg_m"] = lengths.mean(axis=1)
    return WorkspaceMap(
        (first, second),
        (low, high),
        request.fixed,
        {name: values.reshape(shape) for name, values in quantities.items()},
        _likeness(shapes.reshape(*shape, *shapes.shape[1:])),
        _correlation(frequencies[good, 0], lengths[good].mean(axis=1)),
    )


def summarise_map(found: WorkspaceMap) -> dict[str, Any]:
    """As it stands in ``summary.json``; null where a pose cannot be taken."""
    return {
        "axes": list(found.axes),
        "positions": [values.tolist() for values in found.positions],
        "fixed": found.fixed,
        "least_likeness": found.likeness,
        "f1_and_mean_leg_correlation": found.trend,
        "quantities": {
            name: [[float(value) if np.isfinite(value) else None for value in row] for row in values]
            for name, values in found.quantities.items()
        },
    }


def _likeness(shapes: FloatArray) -> float:
    """Least squared cosine between neighbours, rows and columns, over all modes."""
    least = 1.0
    for ahead, behind in ((shapes[1:], shapes[:-1]), (shapes[:, 1:], shapes[:, :-1])):
        cosines = (ahead * behind).sum(axis=2) ** 2
        if np.isfinite(cosines).any():
            least = min(least, float(np.nanmin(cosines)))
    return least


def _correlation(first: FloatArray, second: FloatArray) -> float:
    if len(first) < 2 or np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return 0.0
    return float(np.corrcoef(first, second)[0, 1])


def _span(values: FloatArray) -> str:
    known = values[np.isfinite(values)]
    return f"{known.min():.4g} .. {known.max():.4g}" if len(known) else "nowhere"
