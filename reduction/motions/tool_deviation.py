"""The deviation of a tool in a pose without moving, by errors of guides, gravity and static forces, with
the part of each component; and the way it is fed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.machine.tool_travel import Feed, find_feed
from headstock.reduction.coupling.channels import GRAVITY, channel_rows
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.guide_errors import GUIDE_ERRORS
from headstock.reduction.motions.body_motions import solve_machine_static
from headstock.reduction.motions.compliance_budget import (
    WEIGHT,
    mutual_energies,
    point_loads,
    weight_energy,
)
from headstock.reduction.superelement import Superelement

GEOMETRY, FORCES = "geometry", "static forces"
SOURCES = (GEOMETRY, GRAVITY, FORCES)


@dataclass(frozen=True, eq=False)
class _SourceResponse:
    """Response of the machine to a source of deviation.

    Attributes:
        moved: ``(n,)`` free coordinates.
        offset: ``(n_all,)`` motion of the stacked dofs by fixed directions that it displaces, at zero
            free coordinates.
    """

    moved: FloatArray
    offset: FloatArray


@dataclass(frozen=True, eq=False)
class ToolDeviation:
    """Deviation of the tool against the work at a point; contributions add up to it.

    Attributes:
        sources: Source, ``geometry``, ``gravity`` or ``static forces``, to its part ``(6,)`` of the
            deviation, machine axes [m, rad].
        parts: The same to the contribution ``(6,)`` of each part: of ``geometry`` a joint or an
            axis with errors, of the others a component or joint that deforms.
        influence: ``(n, 6)`` responses to unit loads at the point; none of a lumped mechanism.
        responses: Response of the machine to each source; empty likewise.
    """

    sources: dict[str, FloatArray]
    parts: dict[str, dict[str, FloatArray]]
    influence: FloatArray = field(default_factory=lambda: np.zeros((0, 6)))
    responses: dict[str, _SourceResponse] = field(default_factory=dict)

    @property
    def total(self) -> FloatArray:
        """``(6,)``."""
        return np.sum([np.zeros(6), *self.sources.values()], axis=0)


def fixed_offsets(coupled: CoupledMachine, machine: Machine, name: str) -> dict[str, FloatArray]:
    """Return the motion ``(6,)`` of a point or an interface that each load makes by fixed
    directions that it displaces, at zero free coordinates; no entry of a load that displaces none.

    Args:
        name: A point, a sensor, or ``component.interface``.
    """
    offsets: dict[str, FloatArray] = {}
    if coupled.errors is not None and coupled.errors.offsets:
        offsets[GUIDE_ERRORS] = coupled.errors.offset(coupled.layout.size)
    if coupled.displaced is not None:
        offsets |= coupled.displaced.offsets
    if not offsets:
        return {}
    rows = channel_rows(coupled.layout, machine, name)
    return {load: np.asarray(rows @ moved) for load, moved in offsets.items()}


def solve_deviation(coupled: CoupledMachine, machine: Machine, point: str) -> ToolDeviation:
    """Return the deviation at a point by source and part.

    With ``lambda`` the response to a unit load at the point (Maxwell 1864), a load ``f`` moves it by
    ``lambda^T f = lambda^T K u``, a sum over components and joints; errors of a joint by
    ``lambda^T rows^T K e``.

    Args:
        coupled: The machine in a pose, with the loads of its sources.

    Raises:
        ModelError: A load does work on a free motion, or there is no such point.
    """
    errors, still = coupled.errors, np.zeros(coupled.layout.size)
    forces = [load for name, load in coupled.loads.items() if name not in (GRAVITY, GUIDE_ERRORS)]
    applied = {} if errors is None else {GEOMETRY: coupled.loads[GUIDE_ERRORS]}
    applied |= {GRAVITY: coupled.loads[GRAVITY]} if GRAVITY in coupled.loads else {}
    applied |= {FORCES: np.sum(forces, axis=0)} if forces else {}
    unit = point_loads(coupled, point)
    moved = solve_machine_static(coupled, np.column_stack([*applied.values(), unit])).displacements
    influence = moved[:, len(applied) :]
    rows = np.array([coupled.system.outputs[point, dof] for dof in DOF_NAMES])
    sources: dict[str, FloatArray] = {}
    parts: dict[str, dict[str, FloatArray]] = {}
    responses: dict[str, _SourceResponse] = {}
    for number, source in enumerate(applied):
        motion = moved[:, number]
        if source == GEOMETRY and errors is not None:
            responses[source] = _SourceResponse(motion, errors.offset(len(still)))
            carried = channel_rows(coupled.layout, machine, point)
            parts[source] = {
                name: influence.T @ load + carried @ errors.offsets.get(name, still)
                for name, load in errors.loads.items()
            }
            sources[source] = np.sum(list(parts[source].values()), axis=0)
            continue
        responses[source] = _SourceResponse(motion, still)
        sources[source] = rows @ motion
        same = np.tile(motion[:, None], 6)
        parts[source] = mutual_energies(coupled, influence, same)
        if coupled.geometric is not None:
            parts[source][WEIGHT] = weight_energy(coupled, influence, same)
    return ToolDeviation(sources, parts, influence, responses)


def trace_feed(
    machine: Machine, superelements: Mapping[str, Superelement], at: str, poses: Sequence[Pose]
) -> Feed:
    """Return where the tool at a point is fed to, in poses one after the other."""
    point = machine.points[at]
    end = point.tool
    tip: FloatArray = np.zeros(3)
    if end.component is not None and end.interface is not None:
        tip = superelements[end.component].interface_position(end.interface)
        tip = tip + np.asarray(point.offset)
    return find_feed(machine, point, tip, poses)
