"""A machine in a pose where it cuts: its receptance at the tip, and the tip in few coordinates."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.stages.frf import peaks_have_tops
from headstock.pipeline.stages.machine import damp_system
from headstock.pipeline.stages.run_state import PoseModel
from headstock.scene.analyses.lobes import LobesRequest
from headstock.scene.test_data.tool_receptances import read_tool
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import equivalent_viscous
from headstock.solvers.linear.frequency_response import (
    FrfModel,
    find_peaks,
    prepare_frf,
    refine_grid,
)
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.linear.modal_coordinates import reduce_to_modes
from headstock.solvers.linear.response_forms import narrow_band
from headstock.solvers.milling.collocation import stiffest_gain
from headstock.solvers.milling.forces import Side, part_sign
from headstock.solvers.milling.lobes import (
    LobeDiagram,
    find_lobes,
    mean_cutting_stiffness,
)
from headstock.solvers.milling.tip_poles import (
    TipPoles,
    require_poles,
    settle_fastest,
    tip_dynamics,
)
from headstock.solvers.milling.tool_dynamics import (
    Assembly,
    MeasuredAssembly,
    attach_tool_modes,
    couple_assembly,
)
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem, output_rows

LINES = 1200  # of the even grid
BEYOND = 1.05  # of the highest line: up to there frequencies of chatter are refined
REACHED = 0.01  # beyond it: peaks that still matter to the grid
MOST_MODES = 160  # of a machine that are more than a static flexibility
MATTERS = 0.02  # of what makes a mode chatter alone: a thinner share of it is static flexibility
WEAK = 1e-3  # of the slowest turn of the spindle: springs under motions that nothing holds


@dataclass(frozen=True, eq=False)
class CuttingPoint:
    """A machine in a pose with what stands between it and the tip.

    Attributes:
        assembly: Modes of spindle and tool, or measured.
        omega: ``(f,)`` grid of angular frequencies.
        machine: ``(f, 3, 3)`` its receptance there, machine axes.
        coupled: ``(f, 3, 3)`` that of the tip.
        poles: The tip in coordinates of its own, machine axes; None where it is measured.
    """

    request: LobesRequest
    system: SecondOrderSystem
    model: FrfModel
    assembly: Assembly
    omega: FloatArray
    machine: ComplexArray
    coupled: ComplexArray
    poles: TipPoles | None

    def tip(self, omega: FloatArray) -> ComplexArray:
        """Receptance of the tip ``(f, 3, 3)``, machine axes."""
        if omega is self.omega:
            return self.coupled
        return couple_assembly(self.model.form.evaluate(omega), omega, self.assembly)

    @property
    def stiffness(self) -> FloatArray:
        """``(3, 2)`` mean cutting stiffness per depth, axes of the travel [N/m^2]."""
        request = self.request
        return mean_cutting_stiffness(request.cut_at(float(request.speeds[0])))

    def find_diagram(self, frame: FloatArray) -> LobeDiagram:
        """Limits by zeroth order along a travel.

        Args:
            frame: ``(3, 3)`` rows from :func:`travel_frame`.
        """
        request = self.request
        return find_lobes(
            lambda lines: turn_response(self.tip(lines), frame),
            self.omega,
            self.stiffness,
            teeth=request.mill.teeth,
            speeds=request.speeds,
            deepest=request.deepest,
        )


def lobes_request(machine: PoseModel) -> LobesRequest:
    """The lobes its scene asks for."""
    request = machine.parts.scene.analyses.get(LobesRequest)
    if request is None:
        raise ValueError("lobes need an analysis in the scene")
    return request


def prepare_point(machine: PoseModel) -> CuttingPoint:
    """The machine at the point where it cuts.

    Raises:
        ModelError: A mode in the range has no damping.
    """
    request, modes = lobes_request(machine), machine.all_modes
    system = damp_system(machine.parts.scene, machine.system, modes)
    channels = [(request.at, direction) for direction in DIRECTIONS]
    model = prepare_frf(system, inputs=channels, outputs=channels, modes=modes)
    assembly: Assembly = request.tool_modes
    if request.tool_receptance is not None:
        assembly = read_tool(request.tool_receptance, request.up)
    poles = find_peaks(model, highest_hz(request, assembly))
    if not peaks_have_tops(poles, request.up_to_hz):
        raise ModelError(
            "a mode in the range has no damping, so every cut chatters; give joints or materials damping, or write"
            " [effects] damping = { modal = 0.02 }"
        )
    omega = _spread_lines(request, assembly, poles)
    tip = None if isinstance(assembly, MeasuredAssembly) else find_tip(request, system, modes)
    fastest = 0.0 if tip is None else float(np.abs(tip.values).max(initial=0.0))
    reach = BEYOND * max(float(omega.max()), fastest)
    model = dataclasses.replace(model, form=narrow_band(model.form, reach))
    own = model.form.evaluate(omega)
    coupled = couple_assembly(own, omega, assembly)
    return CuttingPoint(request, system, model, assembly, omega, own, coupled, tip)


def highest_hz(request: LobesRequest, assembly: Assembly) -> float:
    """Highest frequency at which the tip is looked at [Hz]."""
    if isinstance(assembly, MeasuredAssembly):
        return float(assembly.frequencies_hz[-1])
    return request.reach_hz


def _spread_lines(request: LobesRequest, assembly: Assembly, poles: ComplexArray) -> FloatArray:
    """Angular frequencies ``(f,)``: even, and denser at the poles of machine and tool."""
    reach = highest_hz(request, assembly)
    poles = poles[poles.imag <= (1.0 + REACHED) * 2.0 * np.pi * reach]
    of_tool = [2.0 * np.pi * mode.hz * (1j - mode.damping) for mode in request.tool_modes]
    base: FloatArray = np.linspace(0.0, reach, LINES + 1, dtype=np.float64)[1:]
    if isinstance(assembly, MeasuredAssembly):
        base = np.asarray(np.union1d(base, assembly.frequencies_hz), dtype=np.float64)
        base = base[(base > 0.0) & (base >= assembly.frequencies_hz[0])]
    return 2.0 * np.pi * refine_grid(base, np.concatenate([poles, of_tool]))


def turn_response(response: ComplexArray, frame: FloatArray) -> ComplexArray:
    """A receptance ``(f, 3, 3)`` in other axes, the rows of a frame ``(3, 3)``."""
    turned = response.reshape(-1, 9) @ np.kron(frame, frame).T
    return turned.reshape(response.shape)


def travel_frame(
    direction: tuple[float, float, float], up: tuple[float, float, float], part: Side
) -> FloatArray:
    """``(3, 3)`` rows along the travel, away from the part on one side of it, and up along the tool."""
    axis = np.array(up) / np.linalg.norm(up)
    along = np.array(direction) - (np.array(direction) @ axis) * axis
    along /= np.linalg.norm(along)
    return np.array([along, part_sign(part) * np.cross(axis, along), axis])


def find_tip(request: LobesRequest, system: SecondOrderSystem, modes: ModalResult) -> TipPoles:
    """The tip in coordinates of its own, machine axes: modes of the machine, spindle and tool on them,
    and the static flexibility of all other modes; structural damping as viscous.

    All modes take part that can matter in a cut as deep as limits are looked for, also those above
    ``up_to``; the others move at once with the force, so that they cannot chatter.

    Raises:
        ModelError: It has no coordinates of its own.
    """
    channels = [(request.at, direction) for direction in DIRECTIONS]
    system = equivalent_viscous(system, modes)
    reach = max(request.reach_hz, _reach_of_modes(request, system, modes))
    small = reduce_to_modes(system, channels, reach, modes)
    at_once = len(small.mass) - int((modes.frequencies_hz <= reach).sum())
    if modes.rigid_count:
        small = _support_weakly(small, modes.rigid_count, float(request.speeds[0]))
    if request.tool_modes:
        small = attach_tool_modes(small, request.at, request.tool_modes)
    rows = np.array([small.outputs[channel] for channel in channels])
    damping = np.zeros_like(small.mass) if small.damping is None else small.damping
    tip = tip_dynamics(small.mass, damping, small.stiffness, forced=rows)
    return settle_fastest(require_poles(tip), at_once)


def _reach_of_modes(request: LobesRequest, system: SecondOrderSystem, modes: ModalResult) -> float:
    """Frequency of the highest mode that can matter up to the deepest cut [Hz]."""
    count = min(MOST_MODES, len(modes.frequencies_hz))
    first = slice(modes.rigid_count, count)
    shapes = modes.shapes[:, first]
    rows = output_rows(system, [(request.at, direction) for direction in DIRECTIONS]) @ shapes
    omega = 2.0 * np.pi * modes.frequencies_hz[first]
    if system.damping is None or not len(omega):
        return 0.0
    damped = np.einsum("ij,ij->j", shapes, system.damping @ shapes)
    gain = request.deepest * stiffest_gain(
        request.mill, request.coefficients.chip, request.radial_depth, request.sense
    )
    matters = 2.0 * gain * (rows**2).sum(axis=0) > MATTERS * np.abs(damped) * omega
    return float(modes.frequencies_hz[first][matters].max(initial=0.0))


def _support_weakly(system: SecondOrderSystem, count: int, slowest: float) -> SecondOrderSystem:
    """Modal coordinates whose rigid-body motions stand on springs far below the slowest turn of the
    spindle, so that they have poles of their own.
    """
    omega = WEAK * slowest
    stiffness, damping = system.stiffness.copy(), np.zeros_like(system.mass)
    index = np.arange(count)
    stiffness[index, index] += omega**2
    damping[index, index] = 0.6 * omega
    if system.damping is not None:
        damping += system.damping
    return dataclasses.replace(system, stiffness=stiffness, damping=damping)
