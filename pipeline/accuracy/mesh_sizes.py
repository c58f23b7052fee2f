"""Element sizes of a mesh of tetrahedra that vary in space: small where its cells contribute to the
error of numbers that are not accurate enough.
"""

import importlib
from collections.abc import Iterator, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.size_field import SizeField
from headstock.meshing.elements.error_sizes import spread_error
from headstock.pipeline.accuracy.followed import list_followed
from headstock.pipeline.accuracy.quantities import Quantity
from headstock.pipeline.answers.modal import FREQUENCY
from headstock.pipeline.numbers.numbers import Key
from headstock.pipeline.stages.components import ELASTIC_MODULE, load_or_make_mesh
from headstock.pipeline.stages.machine import CoupledPose, couple_pose
from headstock.pipeline.stages.run_state import ReducedComponent, RunState
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.motions.body_motions import solve_machine_static
from headstock.scene.scene import LOAD
from headstock.solvers.pairing.response_peaks import ResponsePeak
from headstock.solvers.second_order import Channel

MIXING = 0.02  # of omega^2: closer modes mix as if they were this far apart
NODE = 1e-3  # of the largest motion at a channel: below it the mode has a node there


def mean_size(reduced: ReducedComponent) -> float:
    """Return the mean size of a graded mesh: side of the cube per displacement dof [m]."""
    if reduced.quality is None:
        raise ValueError("only what was meshed here has a mean size")
    return float(np.cbrt(reduced.quality.volume / reduced.superelement.full_dofs))


def refine_sizes(
    state: RunState, names: Sequence[str], short: Sequence[Quantity], ratio: float
) -> SizeField:
    """Return sizes with which the error of a part's mesh should fall by a ratio; on rank 0.

    Args:
        state: State of a round, after its analyses.
        names: The part, and those that share its superelement.
        short: Numbers that are not accurate enough.
        ratio: Wanted error of these numbers by the part's mesh, over the present one.
    """
    part = state.plan.components[names[0]]
    mesh, _ = load_or_make_mesh(state, part)
    keys = {quantity.key for quantity in short}
    motions = [
        motion
        for model, key, shape in _list_motions(state)
        if key in keys
        for motion in _parts_of(model, names, shape)
    ]
    element = state.reduced[names[0]].superelement
    elastic = importlib.import_module(ELASTIC_MODULE)
    missed = elastic.find_cell_errors(part, mesh, element, np.column_stack(motions)).sum(axis=1)
    return spread_error(mesh, missed, ratio, part.mesh.sizes)


def _list_motions(state: RunState) -> Iterator[tuple[CoupledPose, Key, FloatArray]]:
    """Yield the motion ``(n,)`` of the machine for every number, scaled so that its strain energy
    error is the number's relative error.
    """
    for modes in state.modal:
        model = couple_pose(state.parts, modes.pose)
        for index in range(modes.rigid_count, len(modes.frequencies_hz)):
            square = (2.0 * np.pi * modes.frequencies_hz[index]) ** 2
            shape = model.all_modes.shapes[:, modes.below + index]
            yield model, modes.key(FREQUENCY, index), shape * np.sqrt(0.5 / square)
    for answer in state.static:
        model = couple_pose(state.parts, state.plan.poses[answer.pose])
        for number in list_followed(answer):
            point, direction = str(number.key["point"]), str(number.key["direction"])
            yield model, number.key, model.push((point, direction)) / np.sqrt(number.value)
    for response in state.responses:
        model = couple_pose(state.parts, state.plan.poses[response.curves.pose])
        for height in response.heights:
            ends = response.curves.outputs[height.output], response.curves.inputs[height.given]
            motions = (
                _move_peak(model, height.mode, ends)
                if isinstance(height, ResponsePeak)
                else _push(model, height.height, ends)
            )
            for motion in motions:
                yield model, response.key(height), motion


def _move_peak(
    model: CoupledPose, mode: int, ends: tuple[Channel, Channel]
) -> Iterator[FloatArray]:
    """Return the motions of a peak ``phi_i phi_o / (2 zeta omega^2)``: that of its mode for the
    frequency, and per channel those of its mode and of all others, through which its shape changes
    there.

    The change of a shape by a mesh at a channel is a product of two motions ``u^T E v``, which is
    bounded by half of ``a u^T E u + v^T E v / a``, least where both terms are equal.
    """
    modes = model.all_modes
    squares = (2.0 * np.pi * modes.frequencies_hz) ** 2
    own, square = modes.shapes[:, mode], squares[mode]
    yield own / np.sqrt(square)
    apart = squares - square
    # modes at the same frequency mix with the mode by as much as their damping allows
    shares = apart / (apart**2 + (MIXING * square) ** 2)
    shares[mode] = 0.0
    for channel in dict.fromkeys(ends):
        moved = modes.shapes.T @ _load(model, channel)
        if abs(moved[mode]) < NODE * np.abs(moved).max():
            continue
        weights = shares * moved / moved[mode]
        energy = float(weights**2 @ squares)
        if energy > 0.0:
            balance = np.sqrt(energy / square)
            count = 2.0 if ends[0] == ends[1] else 1.0
            yield own * np.sqrt(0.5 * count * balance)
            yield modes.shapes @ weights * np.sqrt(0.5 * count / balance)


def _push(model: CoupledPose, height: float, ends: tuple[Channel, Channel]) -> Iterator[FloatArray]:
    """Return the motions of a static level: those under loads at both channels, likewise."""
    loads = [_load(model, channel) for channel in ends]
    moved = [solve_machine_static(model.coupled, load).displacements for load in loads]
    soft = [float(load @ own) for load, own in zip(loads, moved, strict=True)]
    if min(soft) > 0.0:
        for own, energy in zip(moved, soft, strict=True):
            yield own * np.sqrt(0.5 * np.sqrt(soft[0] * soft[1]) / (energy * height))


def _load(model: CoupledPose, channel: Channel) -> FloatArray:
    if channel[1] == LOAD:
        return model.loads[channel[0]]
    return {**model.system.outputs, **model.system.inputs}[channel]


def _parts_of(model: CoupledPose, names: Sequence[str], motion: FloatArray) -> Iterator[FloatArray]:
    """Return a motion of the machine in the dofs of some components."""
    own = model.expand(motion[:, None])[:, 0]
    for name in names:
        element = model.coupled.layout.superelements[name]
        yield turn_dofs(element, model.placements[name]) @ own[model.offsets[name]]
