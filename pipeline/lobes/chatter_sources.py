"""What chatters: lobes by the waves and the mode behind them, and the part to blame."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.lobes import Lobe
from headstock.pipeline.lobes.cutting_point import CuttingPoint, turn_response
from headstock.pipeline.lobes.limits import Limits
from headstock.pipeline.stages.run_state import PoseModel
from headstock.solvers.linear.modal_coordinates import modal_motion
from headstock.solvers.milling.lobes import chatter_shapes
from headstock.solvers.milling.tool_dynamics import (
    MeasuredAssembly,
    couple_assembly,
    split_tip_motion,
)
from headstock.solvers.second_order import ComplexArray


def group_lobes(
    point: CuttingPoint,
    limits: Limits,
    frame: FloatArray,
    machine: PoseModel,
    *,
    whole: bool,
) -> tuple[tuple[Lobe, ...], NDArray[np.intp]]:
    """Neighbouring speeds with the same waves of the same mode, and the lobe of each speed."""
    depths = limits.depths
    owner = np.full(len(depths), -1, dtype=np.intp)
    limited = np.flatnonzero(limits.limited)
    if not len(limited):
        return (), owner
    if not whole:
        limited = limited[[int(np.argmin(depths[limited]))]]
    sources, shares = _find_sources(point, limits, limited, frame)
    waves = limits.waves[limited]
    ranks = np.cumsum(np.isfinite(depths))[limited]  # among the speeds that were looked at
    new = (np.diff(ranks) > 1) | (np.diff(waves) != 0) | (np.diff(sources) != 0)
    owner[limited] = np.concatenate([[0], np.cumsum(new)])
    names = _name_sources(machine, point, sorted({int(source) for source in sources}))
    lobes = []
    for number in range(int(owner.max()) + 1):
        own = np.flatnonzero(owner == number)
        place = int(own[np.argmin(depths[own])])
        at = int(np.flatnonzero(limited == place)[0])
        name, hz, part = names[int(sources[at])]
        lobes.append(
            Lobe(
                place=place,
                first=int(own[0]),
                last=int(own[-1]),
                waves=int(limits.waves[place]),
                mode=name,
                mode_hz=hz,
                mode_share=float(shares[at]),
                part=part,
            )
        )
    return tuple(lobes), owner


def _find_sources(
    point: CuttingPoint,
    limits: Limits,
    places: NDArray[np.intp],
    frame: FloatArray,
) -> tuple[NDArray[np.intp], FloatArray]:
    """What contributes most to the motion that chatters at some speeds, ``(k,)`` numbers of modes of
    the machine and, after them, of parts of the assembly; and its share ``(k,)``.
    """
    omega = limits.chatter[places]
    machine = point.model.form.evaluate(omega)
    tip = turn_response(couple_assembly(machine, omega, point.assembly), frame)
    shapes = chatter_shapes(tip, point.stiffness, limits.eigenvalues[places])
    split = split_tip_motion(machine, omega, point.assembly, shapes.forces @ frame)
    weights = shapes.weights @ frame[:2]
    of_assembly = np.einsum("pnd,nd->np", split.parts, weights)
    coordinates = point.model.coordinates
    of_machine: ComplexArray = np.zeros((len(omega), 0), dtype=complex)
    if coordinates is not None:
        modal = modal_motion(coordinates, omega, split.base_force @ coordinates.inputs.T)
        of_machine = modal * (weights @ coordinates.outputs)
    every = np.concatenate([of_machine, of_assembly], axis=1).real
    if not every.shape[1]:
        return np.full(len(omega), -1, dtype=np.intp), np.zeros(len(omega))
    best = np.argmax(every, axis=1)
    return best, np.take_along_axis(every, best[:, None], axis=1)[:, 0]


def _name_sources(
    machine: PoseModel, point: CuttingPoint, sources: list[int]
) -> dict[int, tuple[str, float | None, str]]:
    """Name, natural frequency and part of modes of the machine and of parts of the assembly."""
    coordinates = point.model.coordinates
    count = 0 if coordinates is None else len(coordinates.eigenvalues)
    found: dict[int, tuple[str, float | None, str]] = {-1: ("", None, "")}
    own = np.array([source for source in sources if 0 <= source < count], dtype=np.intp)
    if len(own):
        modes = machine.all_modes
        some = dataclasses.replace(
            modes,
            frequencies_hz=modes.frequencies_hz[own],
            shapes=modes.shapes[:, own],
            rigid_count=int((own < modes.rigid_count).sum()),
            residuals=modes.residuals[own],
        )
        named = machine.name_modes(some)
        for place, shown in enumerate(own):
            strain = named.strain_shares[place] or named.kinetic_shares[place]
            part = max(strain, key=lambda name: strain[name], default="")
            found[int(shown)] = (named.names[place], float(some.frequencies_hz[place]), part)
    for source in sources:
        if source >= count:
            if isinstance(point.assembly, MeasuredAssembly):
                found[source] = ("measured assembly of spindle and tool", None, "tool")
            else:
                mode = point.assembly[source - count]
                found[source] = (f"{mode.name} on its base", mode.hz, mode.name)
    return found
