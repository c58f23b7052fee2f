"""What stands between a machine and the tip of its tool: lumped modes of spindle and tool in a row,
or a measured assembly, coupled by receptances.

``H = R_tt - R_tb (R_bb + G)^-1 R_bt`` with the receptances ``R`` of the free assembly between its tip
``t`` and its base ``b``, and ``G`` of the machine (Schmitz and Donaldson 2000). A lumped mode is a mass
on a spring on what stands before it: its frequency is that on a rigid base.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

TRANSLATIONS = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class ToolMode:
    """A mass on a spring between what stands before it and the tip.

    Attributes:
        hz: Natural frequency on a rigid base [Hz].
        stiffness: [N/m].
        directions: ``(3, d)`` orthonormal columns in which it moves, machine axes.
    """

    name: str
    hz: float
    damping: float
    stiffness: float
    directions: FloatArray

    @property
    def mass(self) -> float:
        """[kg]."""
        return float(self.stiffness / (2.0 * np.pi * self.hz) ** 2)

    @property
    def damper(self) -> float:
        """[N s/m]."""
        return 2.0 * self.damping * self.stiffness / (2.0 * np.pi * self.hz)

    @property
    def projector(self) -> FloatArray:
        """``(3, 3)`` onto its directions."""
        return self.directions @ self.directions.T


@dataclass(frozen=True, eq=False)
class MeasuredAssembly:
    """Receptances of a free assembly of spindle nose, holder and tool, equal in all directions across
    its axis; along its axis it is rigid and without mass.

    Attributes:
        frequencies_hz: ``(n,)`` rising [Hz].
        tip: ``(n,)`` of the tip under a force there [m/N].
        cross: ``(n,)`` of the base under a force at the tip, and the reverse [m/N].
        base: ``(n,)`` of the base under a force there [m/N].
        across: ``(3, 2)`` orthonormal columns across its axis, machine axes.
    """

    frequencies_hz: FloatArray
    tip: ComplexArray
    cross: ComplexArray
    base: ComplexArray
    across: FloatArray

    def at(self, omega: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Receptances of tip, cross and base, linear between the measured lines."""
        lines = 2.0 * np.pi * self.frequencies_hz
        tip, cross, base = (
            np.interp(omega, lines, part.real) + 1j * np.interp(omega, lines, part.imag)
            for part in (self.tip, self.cross, self.base)
        )
        return tip, cross, base


def across_axis(axis: FloatArray) -> FloatArray:
    """``(3, 2)`` orthonormal columns across an axis ``(3,)``."""
    return np.linalg.svd(axis[None, :])[2][1:].T


Assembly = Sequence[ToolMode] | MeasuredAssembly


def couple_assembly(machine: ComplexArray, omega: FloatArray, assembly: Assembly) -> ComplexArray:
    """Receptance of the tip ``(f, 3, 3)``, machine axes.

    Args:
        machine: ``(f, 3, 3)`` of the machine where the assembly stands [m/N].
        omega: ``(f,)`` [rad/s].
        assembly: Modes in their order from machine to tip, none for a rigid tool; or measured.
    """
    if isinstance(assembly, MeasuredAssembly):
        return _couple_measured(machine, omega, assembly)
    # frequencies last, so that every product runs along them
    coupled = np.ascontiguousarray(np.moveaxis(machine, 0, -1))
    for mode in assembly:
        # x = A (f + omega^2 m D D^T x) with A of the machine and the spring in series
        square = omega**2 * mode.mass
        coupled = coupled + mode.projector[:, :, None] / _springs(mode, omega)
        # column by column of D (Sherman and Morrison 1950)
        for axis in mode.directions.T:
            pushed, moved = axis @ coupled, np.tensordot(axis, coupled, axes=1)
            share = square / (1.0 - square * (axis @ pushed))
            coupled += (share * pushed)[:, None] * moved
    return np.moveaxis(coupled, -1, 0)


def _springs(mode: ToolMode, omega: FloatArray) -> ComplexArray:
    return mode.stiffness + 1j * omega * mode.damper


def _couple_measured(
    machine: ComplexArray, omega: FloatArray, assembly: MeasuredAssembly
) -> ComplexArray:
    tip, cross, base = assembly.at(omega)
    across = assembly.across
    plane = across @ across.T
    axis = np.eye(3) - plane
    passed = _passed_force(machine, cross, base, assembly)
    own = tip[:, None, None] * plane - cross[:, None, None] * (plane @ passed)
    return own + axis @ machine @ passed


def _passed_force(
    machine: ComplexArray, cross: ComplexArray, base: ComplexArray, assembly: MeasuredAssembly
) -> ComplexArray:
    """``(f, 3, 3)`` force on the machine per force on the tip: across the axis that of the coupling,
    along it the same.
    """
    across = assembly.across
    plane = across @ across.T
    axis = np.eye(3) - plane
    stiff = np.linalg.inv(across.T @ machine @ across + base[:, None, None] * np.eye(2))
    meeting = cross[:, None, None] * plane - plane @ machine @ axis
    return across @ stiff @ across.T @ meeting + axis


class _TippedMachine(NamedTuple):
    """A machine with lumped modes at its tool, in its own ``c`` coordinates and then the deflections
    of each mode.

    Attributes:
        mass: ``(..., c + d, c + d)``.
        damping: ``(..., c + d, c + d)``.
        stiffness: ``(..., c + d, c + d)``.
        tip: ``(..., 3, c + d)`` motion of the tip.
        weighed: ``(..., c + d, 3)`` load by an acceleration of the tool's place, its sign reversed.
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    tip: FloatArray
    weighed: FloatArray


def mount_modes(
    mass: FloatArray,
    damping: FloatArray,
    stiffness: FloatArray,
    tool: FloatArray,
    modes: Sequence[ToolMode],
) -> _TippedMachine:
    """A machine with lumped modes at its tool, each on what stands before it.

    Args:
        mass: ``(..., c, c)`` of the machine.
        damping: ``(..., c, c)``.
        stiffness: ``(..., c, c)``.
        tool: ``(..., 3, c)`` motion of the tool's place.
        modes: In their order from machine to tip; their directions in the axes of ``tool``.
    """
    weighed = np.zeros_like(np.swapaxes(tool, -1, -2))
    for mode in modes:
        count = mode.directions.shape[1]
        tool = np.concatenate(
            [tool, np.broadcast_to(mode.directions, (*tool.shape[:-1], count))], axis=-1
        )
        # the mass moves with the tip in the directions of the mode
        moved = mode.mass * np.swapaxes(tool, -1, -2) @ mode.projector
        mass = _widen(mass, np.zeros((count, count))) + moved @ tool
        damping = _widen(damping, mode.damper * np.eye(count))
        stiffness = _widen(stiffness, mode.stiffness * np.eye(count))
        still = np.zeros((*weighed.shape[:-2], count, 3))
        weighed = np.concatenate([weighed, still], axis=-2) + moved
    return _TippedMachine(mass, damping, stiffness, tool, weighed)


def _widen(matrix: FloatArray, corner: FloatArray) -> FloatArray:
    size, count = matrix.shape[-1], len(corner)
    wider = np.zeros((*matrix.shape[:-2], size + count, size + count))
    wider[..., :size, :size], wider[..., size:, size:] = matrix, corner
    return wider


@dataclass(frozen=True, eq=False)
class _TipMotion:
    """Where the motion of a tip comes from.

    Attributes:
        parts: ``(p, f, 3)`` deflection of each mode of the assembly, or of all of it.
        base_force: ``(f, 3)`` on the machine [N].
    """

    parts: ComplexArray
    base_force: ComplexArray


def split_tip_motion(
    machine: ComplexArray, omega: FloatArray, assembly: Assembly, force: ComplexArray
) -> _TipMotion:
    """Motion of the tip under a force, by what deflects; what is left is the machine's under the
    force on it.

    Args:
        machine: ``(f, 3, 3)`` of the machine where the assembly stands [m/N].
        omega: ``(f,)`` [rad/s].
        assembly: As in :func:`couple_assembly`.
        force: ``(f, 3)`` on the tip [N].
    """
    motion = (couple_assembly(machine, omega, assembly) @ force[:, :, None])[:, :, 0]
    if isinstance(assembly, MeasuredAssembly):
        _, cross, base = assembly.at(omega)
        passed = (_passed_force(machine, cross, base, assembly) @ force[:, :, None])[:, :, 0]
        carried = (machine @ passed[:, :, None])[:, :, 0]
        return _TipMotion((motion - carried)[None], passed)
    parts = []
    for mode in reversed(assembly):
        force = force + (omega**2 * mode.mass)[:, None] * (motion @ mode.projector)
        deflection = (force @ mode.projector) / _springs(mode, omega)[:, None]
        motion = motion - deflection
        parts.append(deflection)
    return _TipMotion(np.array(parts[::-1]).reshape(len(parts), len(omega), 3), np.asarray(force))


def attach_tool_modes(
    system: SecondOrderSystem, point: str, modes: Sequence[ToolMode]
) -> SecondOrderSystem:
    """The machine with the modes as dofs of its own, one system; its channels are the translations
    of the tip alone.

    Args:
        point: Where the first mode stands.
    """
    none = np.zeros_like(system.mass)
    mounted = mount_modes(
        system.mass,
        none if system.damping is None else system.damping,
        system.stiffness,
        np.array([system.outputs[point, axis] for axis in TRANSLATIONS]),
        modes,
    )
    extra = np.concatenate([mode.directions for mode in modes], axis=1)
    loads = np.array([system.inputs[point, axis] for axis in TRANSLATIONS])
    loads = np.concatenate([loads, extra], axis=1)
    hysteretic = system.hysteretic
    if hysteretic is not None:
        hysteretic = _widen(hysteretic, np.zeros((extra.shape[1], extra.shape[1])))
    labels = [
        f"{mode.name}.{number}" for mode in modes for number in range(mode.directions.shape[1])
    ]
    return dataclasses.replace(
        system,
        mass=mounted.mass,
        stiffness=mounted.stiffness,
        damping=mounted.damping if mounted.damping.any() else None,
        hysteretic=hysteretic,
        inputs={(point, axis): loads[row] for row, axis in enumerate(TRANSLATIONS)},
        outputs={(point, axis): mounted.tip[row] for row, axis in enumerate(TRANSLATIONS)},
        labels=(*system.labels, *labels),
    )
