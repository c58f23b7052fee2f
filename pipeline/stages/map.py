"""The map stage: natural modes tracked by shape, static stiffness and condition number of a lumped
mechanism over its workspace.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon import survey_tool_poses, tool_pose
from headstock.pipeline.answers.map import WorkspaceMap
from headstock.pipeline.answers.static import N_PER_UM
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.mechanism import placed_mechanism, scene_mechanism
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.scene.analyses.map import MapRequest
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.modes import linearise_poses, solve_lumped_modes, tool_compliance
from headstock.solvers.mpi import MPI
from headstock.solvers.pairing.mode_tracking import SweptModes, track_modes, tracked_frequencies

IndexArray = NDArray[np.intp]
CHUNK = 512  # poses evaluated together: more would leave the cache
# squared cosine with the neighbour's mode of the same number from which no other can be nearer
PLAINLY_ALIKE = 0.8


@dataclass(frozen=True, eq=False)
class _PoseRows:
    """What is found in poses, NaN where they cannot be taken.

    Attributes:
        condition: ``(n,)``.
        frequencies_hz: ``(n, c)`` of all modes.
        shapes: ``(n, c, c)`` stretches of the springs, one column per mode, weighed so that their
            squares are shares of strain energy.
        stiffness: ``(n, 3)`` static stiffness at the tool along x, y, z [N/m].
        lengths: ``(n, 3)`` of the legs [m].
    """

    condition: FloatArray
    frequencies_hz: FloatArray
    shapes: FloatArray
    stiffness: FloatArray
    lengths: FloatArray


def _map_workspace(
    mechanism: SceneMechanism,
    model: CompliantMechanism,
    request: MapRequest,
    *,
    comm: MPI.Comm | None = None,
) -> WorkspaceMap | None:
    """Everything over the grid, poses shared out over the ranks; only rank 0 has the map, others
    None.

    Args:
        request: Axes of the grid with their positions, and fixed positions of the others.
        comm: Ranks that share the poses; None for this one alone.
    """
    comm = comm or MPI.COMM_SELF
    shape = tuple(len(values) for _, values in request.axes)
    grid = np.stack(
        np.meshgrid(*(values for _, values in request.axes), indexing="ij"), axis=-1
    ).reshape(-1, len(shape))
    part = np.array_split(grid, comm.size)[comm.rank]
    rows = [
        _survey_rows(mechanism, model, request, part[start : start + CHUNK])
        for start in range(0, max(len(part), 1), CHUNK)
    ]
    gathered = comm.gather(rows, root=0)
    if gathered is None:
        return None
    parts = [vars(row) for rows in gathered for row in rows]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return _assemble(request, shape, _PoseRows(**joined))


def _survey_rows(
    mechanism: SceneMechanism, model: CompliantMechanism, request: MapRequest, positions: FloatArray
) -> _PoseRows:
    """Poses with the map's axes at positions ``(n, d)``."""
    names = [name for name, _ in request.axes]
    poses = [
        {**request.fixed, **dict(zip(names, map(float, row), strict=True))} for row in positions
    ]
    size, count = len(model.mechanism.compliant), len(poses)
    rows = _PoseRows(
        condition=np.full(count, np.nan),
        frequencies_hz=np.full((count, size), np.nan),
        shapes=np.full((count, size, size), np.nan),
        stiffness=np.full((count, 3), np.nan),
        lengths=np.full((count, 3), np.nan),
    )
    if not poses:
        return rows
    points, directions = (
        np.array(part) for part in zip(*(tool_pose(mechanism, pose) for pose in poses), strict=True)
    )
    survey = survey_tool_poses(mechanism.mounted, points, directions)
    good = survey.within & np.isfinite(survey.condition)
    if good.any():
        motions = linearise_poses(model, survey.states[good])
        modes = solve_lumped_modes(motions)
        turn = mechanism.mounted.mounting.rotation
        compliance = turn @ tool_compliance(model, motions)[:, :3, :3] @ turn.T
        rows.condition[good] = survey.condition[good]
        rows.frequencies_hz[good] = modes.frequencies_hz
        rows.shapes[good] = np.sqrt(modes.energy) * np.sign(modes.shapes)
        rows.stiffness[good] = 1.0 / np.diagonal(compliance, axis1=1, axis2=2)
        rows.lengths[good] = survey.states[good, :3]
    return rows


def _assemble(request: MapRequest, shape: tuple[int, ...], rows: _PoseRows) -> WorkspaceMap:
    edges = _edges(shape, np.isfinite(rows.condition))
    behind, ahead = (rows.shapes[ends, :, : request.count] for ends in edges.T)
    # least squared cosine between modes of the same number of neighbours
    mac = float(((behind * ahead).sum(axis=1) ** 2).min(initial=1.0))
    plain = _Followed(rows.frequencies_hz[:, : request.count], crossings=(), tracking_breaks=0)
    followed, crossings, tracking_breaks = (
        plain if mac >= PLAINLY_ALIKE else _follow(rows, edges, request.count)
    )
    quantities = {"condition_number": rows.condition}
    quantities |= {f"f{number + 1}_hz": followed[:, number] for number in range(request.count)}
    quantities |= {
        f"stiffness_{axis}_n_per_um": N_PER_UM * rows.stiffness[:, row]
        for row, axis in enumerate("xyz")
    }
    quantities["mean_leg_m"] = rows.lengths.mean(axis=1)
    good = np.isfinite(rows.condition) & np.isfinite(followed[:, 0])
    return WorkspaceMap(
        axes=tuple(name for name, _ in request.axes),
        positions=tuple(values for _, values in request.axes),
        fixed=request.fixed,
        quantities={name: values.reshape(shape) for name, values in quantities.items()},
        mac=mac,
        crossings=crossings,
        tracking_breaks=tracking_breaks,
        trend=_correlation(followed[good, 0], rows.lengths[good].mean(axis=1)),
    )


def _edges(shape: tuple[int, ...], taken: NDArray[np.bool_]) -> IndexArray:
    """``(e, 2)`` numbers of neighbouring poses that can both be taken."""
    numbers = np.arange(int(np.prod(shape))).reshape(shape)
    pairs = []
    for axis in range(len(shape)):
        behind, ahead = (
            np.take(numbers, range(start, shape[axis] - 1 + start), axis=axis) for start in (0, 1)
        )
        pairs.append(np.stack([behind.ravel(), ahead.ravel()], axis=1))
    edges = np.concatenate(pairs)
    return edges[taken[edges].all(axis=1)]


class _Followed(NamedTuple):
    """Frequencies ``(n, count)`` [Hz] of modes, numbers of those that cross, and how many pairs of
    neighbours tear one apart.
    """

    frequencies_hz: FloatArray
    crossings: tuple[tuple[int, int], ...]
    tracking_breaks: int


def _follow(rows: _PoseRows, edges: IndexArray, count: int) -> _Followed:
    """Modes by their shape."""
    number = len(rows.condition)
    modes = SweptModes(
        rows.frequencies_hz,
        np.nan_to_num(rows.shapes).astype(np.float32),
        np.full(number, count),
        np.zeros(number, dtype=np.int64),
    )
    tracked = track_modes(modes, [(int(i), int(j)) for i, j in edges])
    followed = tracked_frequencies(rows.frequencies_hz, tracked.index)[:, :count]
    if followed.shape[1] < count:
        followed = np.pad(
            followed, ((0, 0), (0, count - followed.shape[1])), constant_values=np.nan
        )
    crossings = tuple(
        (int(i) + 1, int(j) + 1) for i, j in sorted(tracked.crossings) if min(i, j) < count
    )
    return _Followed(followed, crossings, tracked.tracking_breaks)


def _correlation(first: FloatArray, second: FloatArray) -> float:
    if len(first) < 2 or np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return 0.0
    return float(np.corrcoef(first, second)[0, 1])


def run_map_stage(state: RunState, stage: Stage) -> Outcome:
    """Survey the grid, shared out over the ranks."""
    mechanism, placed = scene_mechanism(state.parts), placed_mechanism(state)
    request = state.scene.analyses[MapRequest]
    model = state.comm.bcast(None if placed is None else placed.model, root=0)
    if model is None:
        raise ValueError("a map stage needs a placed mechanism")
    surveyed = _map_workspace(mechanism, model, request, comm=state.comm)
    if surveyed is None:
        return Outcome()
    if surveyed.tracking_breaks:
        state.warn(
            f"modes of the map cannot be tracked by shape between {surveyed.tracking_breaks} pairs of neighbouring poses;"
            " write a finer grid"
        )
    first = surveyed.quantities["f1_hz"]
    taken = int(np.isfinite(surveyed.quantities["condition_number"]).sum())
    shared = f" on {state.comm.size} ranks" if state.comm.size > 1 else ""
    finite = first[np.isfinite(first)]
    span = f"{finite.min():.4g} .. {finite.max():.4g}" if len(finite) else "nowhere"
    detail = f"{taken} of {first.size} poses{shared}, f1 {span} Hz"
    return Outcome(detail=detail, answers=(surveyed,))
