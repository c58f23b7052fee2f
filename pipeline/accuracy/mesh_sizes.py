"""Where a mesh of tetrahedra needs small elements and where large ones do: from what its cells
miss of the numbers that are not good enough yet.
"""

import importlib
from collections.abc import Iterator, Sequence

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.parts.size_field import SizeField
from headstock.meshing.elements.error_sizes import spread_error
from headstock.pipeline.accuracy.quantities import (
    Quantity,
    name_compliance,
    name_frequency,
    say_place,
)
from headstock.pipeline.stages.components import ELASTIC_MODULE, load_or_make_mesh
from headstock.pipeline.stages.machine import CoupledPose, couple_pose
from headstock.pipeline.stages.run_state import ReducedComponent, RunState
from headstock.reduction.coupling.dof_layout import turn_dofs


def mean_size(reduced: ReducedComponent) -> float:
    """Element size of a mesh that is fine in places: side of the cube per displacement dof [m]."""
    if reduced.quality is None:
        raise ValueError("only what was meshed here has a mean size")
    return float(np.cbrt(reduced.quality.volume / reduced.superelement.full_dofs))


def refine_sizes(
    state: RunState, names: Sequence[str], short: Sequence[Quantity], ratio: float
) -> SizeField:
    """Sizes with which the mesh of a part should miss so many times what it misses; on rank 0.

    Args:
        state: Of a round, after its analyses.
        names: The part, and those that share its superelement.
        short: Numbers that are not good enough.
        ratio: What it should miss of them over what it misses now.
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


def _list_motions(state: RunState) -> Iterator[tuple[CoupledPose, str, FloatArray]]:
    """Every number's motion ``(n,)`` of the machine, of such a height that the energy it strains is the
    number's relative error.
    """
    for modes in state.modal:
        model = couple_pose(state.parts, modes.pose)
        place = say_place(state.modal, modes.pose.name)
        for index in range(modes.rigid_count, len(modes.frequencies_hz)):
            number = modes.below + index
            square = (2.0 * np.pi * modes.frequencies_hz[index]) ** 2
            yield (
                model,
                name_frequency(number + 1, place),
                model.all_modes.shapes[:, number] * np.sqrt(0.5 / square),
            )
    for answer in state.static:
        model = couple_pose(state.parts, state.plan.poses[answer.pose])
        place = say_place(state.static, answer.pose)
        for name, point in answer.points.items():
            for axis, direction in enumerate(DIRECTIONS):
                if (compliance := float(point.compliance[axis, axis])) > 0.0:
                    yield (
                        model,
                        name_compliance(name, direction, place),
                        model.push((name, direction)) / np.sqrt(compliance),
                    )


def _parts_of(model: CoupledPose, names: Sequence[str], motion: FloatArray) -> Iterator[FloatArray]:
    """What a motion of the machine is in the dofs of some components."""
    own = model.expand(motion[:, None])[:, 0]
    for name in names:
        element = model.coupled.layout.superelements[name]
        yield turn_dofs(element, model.placements[name]) @ own[model.offsets[name]]
