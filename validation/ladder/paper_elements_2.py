"""The paper's own finite elements, as far as its figures tell them: linear hexes with bending shapes, one through the thickness.

The paper names neither its elements nor its meshes. These give every statement it makes on figures 7, 9 and 14, which plain linear
elements do not: dx(Mc) stays more than 10 % off since one element across the section cannot warp as the section does.
"""

import math

import numpy as np

from headstock.geometry.frames import rigid_map
from headstock.meshing.component_mesh import IntArray
from headstock.validation.ladder.mode_pairing import pair_modes, read_shape, section_motions
from headstock.validation.ladder.paper_elements import BrickModel, brick_model, held_modes, solve_held
from headstock.validation.ladder.points import LadderPoint, cantilever_displacements
from headstock.validation.ladder.references import LadderBeam

COLUMN_GRIDS = tuple((1, 1, count) for count in (2, 3, 4, 8, 16, 32, 80))
FIXED_GRIDS = tuple((1, 3 * count, count) for count in (1, 2, 3, 4, 5, 6, 8, 12))
MODES = 12
ON_FACE = 1e-9


def paper_points(beam: LadderBeam) -> list[LadderPoint]:
    """Models of a beam by the paper's elements; static ones of the cantilever only, as the fixed beam's mesh is not known."""
    column = beam.ends == "clamped-free"
    found: list[LadderPoint] = []
    for grid in COLUMN_GRIDS if column else FIXED_GRIDS:
        model = brick_model(beam.size, grid, beam.material)
        ndof = 3 * len(model.points)
        if column:
            found.append(LadderPoint("wilson8", ndof, "static", _static_values(beam, model), {}, math.nan, math.nan))
        values, macs = _modal_values(beam, model)
        found.append(LadderPoint("wilson8", ndof, "modal", values, macs, math.nan, math.nan))
    return found


def _held_nodes(beam: LadderBeam, model: BrickModel) -> IntArray:
    place = model.points[:, beam.axis] / beam.size[beam.axis] + 0.5
    ends = (0.0,) if beam.ends == "clamped-free" else (0.0, 1.0)
    return np.flatnonzero(np.min([np.abs(place - end) for end in ends], axis=0) < ON_FACE)


def _static_values(beam: LadderBeam, model: BrickModel) -> dict[str, float]:
    """Unit forces and moments on the top face, spread evenly over its nodes, and the mean motion of that face."""
    top = np.flatnonzero(model.points[:, 2] > 0.5 * beam.size[2] - ON_FACE)
    mean = np.linalg.pinv(rigid_map(model.points[top], model.points[top].mean(axis=0)))
    loads = np.zeros((3 * len(model.points), 6))
    dofs = (3 * top[:, None] + np.arange(3)).ravel()
    loads[dofs] = mean.T
    return cantilever_displacements(mean @ solve_held(model, _held_nodes(beam, model), loads)[dofs])


def _modal_values(beam: LadderBeam, model: BrickModel) -> tuple[dict[str, float], dict[str, float]]:
    frequencies, shapes = held_modes(model, _held_nodes(beam, model), MODES)
    half = 0.5 * beam.size[beam.axis]
    sections = section_motions(model.points, shapes, axis=beam.axis, span=(-half, half), sides=beam.size)
    names = [name for name, reference in beam.references.items() if reference.group == "modal"]
    paired = pair_modes(sections, tuple(read_shape(name, beam.axis) for name in names), beam.ends)
    return (
        {name: float(frequencies[mode.index]) for name, mode in paired.items()},
        {name: mode.mac for name, mode in paired.items()},
    )
