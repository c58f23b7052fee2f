"""The stage of stability lobes: limit depths of cut over the speed of the spindle, the mode and the
part behind each lobe, and checks of the limits by Floquet multipliers.

Only rank 0 has anything to do.
"""

import dataclasses
import functools
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.feed import NO_FEED, Feed, find_feed
from headstock.geometry.machine.machine import Machine, Pose
from headstock.pipeline.answers.estimates import CURVED_FACES, DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.answers.lobes import (
    HZ,
    DirectionLobes,
    LimitCheck,
    LimitErrors,
    Lobe,
    PoseLobes,
)
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.estimates import name_what_is_left_out
from headstock.pipeline.stages.frf import find_error_sources, peaks_have_tops
from headstock.pipeline.stages.machine import damp_system
from headstock.pipeline.stages.run_state import Outcome, PoseModel, RunState, Solved, pose_model
from headstock.reduction.estimates.limit_errors import (
    FinerModels,
    LimitChanges,
    LowestLimit,
    change_models,
    find_limit_changes,
)
from headstock.reduction.estimates.response_errors import (
    ErrorSources,
    SystemChange,
    project_response,
)
from headstock.reduction.superelement import Superelement
from headstock.scene.reading.receptances import read_receptances
from headstock.scene.requests import LobesRequest, Travel
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import equivalent_viscous
from headstock.solvers.linear.frequency_response import (
    FrfModel,
    find_peaks,
    prepare_frf,
    refine_grid,
)
from headstock.solvers.linear.modal_coordinates import ModalCoordinates, reduce_to_modes
from headstock.solvers.milling.forces import MillingCut
from headstock.solvers.milling.full_discretisation import (
    StepResponse,
    largest_multiplier,
    node_gains,
    scan_limit_depth,
    step_response,
    steps_per_period,
)
from headstock.solvers.milling.lobes import (
    LobeDiagram,
    chatter_shapes,
    find_lobes,
    mean_cutting_stiffness,
)
from headstock.solvers.milling.stability import (
    TipDynamics,
    TipPoles,
    find_poles,
    tip_dynamics,
    turn_tip,
)
from headstock.solvers.milling.tool_dynamics import (
    Assembly,
    MeasuredAssembly,
    attach_tool_modes,
    couple_assembly,
    split_tip_motion,
)
from headstock.solvers.second_order import (
    ComplexArray,
    SecondOrderSystem,
    input_columns,
    output_rows,
)

Tip = TipDynamics | TipPoles

LINES = 1200  # of the even grid
REACHED = 0.01  # beyond it: peaks that still matter to the grid
BELOW, ABOVE = 0.95, 1.05  # of the limit: where it is checked
ISLANDS = (0.45, 0.7)  # and, but in samples of a sweep: unstable islands may lie there
BEST_SPEEDS = 3
WORTHWHILE = 1.2  # times the lowest limit: a speed is worth choosing
SEED = 18
FINEST_CHATTER = 1.5  # of the frequency of chatter: what the steps of a check resolve
RIGID_TOOL = "rigid: lobes above the machine's modes mean little without modes of spindle and tool"


@dataclass(frozen=True, eq=False)
class CuttingPoint:
    """A machine in a pose with what stands between it and the tip.

    Attributes:
        request: What is asked for.
        system: The machine with its damping.
        model: Its response at the point.
        assembly: Modes of spindle and tool, or measured.
        omega: ``(f,)`` grid of angular frequencies.
        machine: ``(f, 3, 3)`` its receptance there, machine axes.
        coupled: ``(f, 3, 3)`` that of the tip.
    """

    request: LobesRequest
    system: SecondOrderSystem
    model: FrfModel
    assembly: Assembly
    omega: FloatArray
    machine: ComplexArray
    coupled: ComplexArray

    def tip(self, omega: FloatArray) -> ComplexArray:
        """Receptance of the tip ``(f, 3, 3)``, machine axes."""
        if omega is self.omega:
            return self.coupled
        return couple_assembly(self.model.form.evaluate(omega), omega, self.assembly)


def run_lobes_stage(state: RunState, stage: Stage) -> Outcome:
    """Stability lobes in a pose."""
    if not state.is_root:
        return Outcome()
    model = pose_model(state)
    try:
        solved = solve_lobes(model, _feed_of_path(model, lobes_request(model)))
    except ModelError as error:
        return Outcome(failures=(f"lobes in pose {model.pose.name}: {error}",))
    lowest = min(
        (float(own.depths.min()) for own in solved.answer.directions), default=float("nan")
    )
    checks = [check for own in solved.answer.directions for check in own.checks]
    confirmed = sum(check.confirmed for check in checks)
    detail = f"lowest limit depth {1e3 * lowest:.3g} mm, {confirmed} of {len(checks)} checked limits confirmed"
    return Outcome(detail=detail, answers=(solved.answer,), warnings=solved.warnings)


def trace_feed(
    machine: Machine, superelements: Mapping[str, Superelement], at: str, poses: Sequence[Pose]
) -> Feed:
    """Where the tool at a point is fed to, in poses one after the other."""
    point = machine.points[at]
    end = point.tool
    tip: FloatArray = np.zeros(3)
    if end.component is not None and end.interface is not None:
        tip = superelements[end.component].interface_maps[end.interface].frame.origin
    return find_feed(machine, point, tip, poses)


def _feed_of_path(model: PoseModel, request: LobesRequest) -> FloatArray:
    """``(3,)`` in a pose, machine frame, while the axes of the path analysis move as on its path;
    NaN where nobody asks.

    Raises:
        ModelError: The tool does not move across its axis.
    """
    path, pose = request.path, model.pose
    if path is None or not request.asks_for_feed:
        return NO_FEED
    ends = [
        Pose(
            pose.name,
            {**pose.positions, **{axis: end.positions.get(axis, 0.0) for axis in path.axes}},
        )
        for end in (path.start, path.end)
    ]
    parts = model.parts
    feed = trace_feed(parts.scene.machine, parts.superelements, request.at, ends).directions[0]
    if len(request.travels(feed)) < len(request.directions):
        raise ModelError(
            f"along [analyses.path] the tool at {request.at} does not move across its axis in this pose, so there is no feed"
        )
    return np.asarray(feed)


def lobes_request(machine: PoseModel) -> LobesRequest:
    """The lobes its scene asks for."""
    request = machine.parts.scene.analyses.lobes
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
        assembly = read_receptances(request.tool_receptance, request.up)
    poles = find_peaks(model, _reach(request, assembly))
    if not peaks_have_tops(poles, request.up_to_hz):
        raise ModelError(
            "a mode in the range has no damping, so every cut chatters; give joints or materials damping, or write"
            " [effects] damping = { modal = 0.02 }"
        )
    omega = _spread_lines(request, assembly, poles)
    own = model.form.evaluate(omega)
    coupled = couple_assembly(own, omega, assembly)
    return CuttingPoint(request, system, model, assembly, omega, own, coupled)


def _reach(request: LobesRequest, assembly: Assembly) -> float:
    """Highest frequency at which the tip is looked at [Hz]."""
    if isinstance(assembly, MeasuredAssembly):
        return float(assembly.frequencies_hz[-1])
    return request.reach_hz


def _spread_lines(request: LobesRequest, assembly: Assembly, poles: ComplexArray) -> FloatArray:
    """Angular frequencies ``(f,)``: even, and denser at the poles of machine and tool."""
    reach = _reach(request, assembly)
    poles = poles[poles.imag <= (1.0 + REACHED) * 2.0 * np.pi * reach]
    of_tool = [2.0 * np.pi * mode.hz * (1j - mode.damping) for mode in request.tool_modes]
    base: FloatArray = np.linspace(0.0, reach, LINES + 1, dtype=np.float64)[1:]
    if isinstance(assembly, MeasuredAssembly):
        base = np.asarray(np.union1d(base, assembly.frequencies_hz), dtype=np.float64)
        base = base[(base > 0.0) & (base >= assembly.frequencies_hz[0])]
    return np.asarray(2.0 * np.pi * refine_grid(base, np.concatenate([poles, of_tool])))


def travel_frame(
    direction: tuple[float, float, float], up: tuple[float, float, float]
) -> FloatArray:
    """``(3, 3)`` rows along the travel, away from the part on its right, and up along the tool."""
    axis = np.array(up) / np.linalg.norm(up)
    along = np.array(direction) - (np.array(direction) @ axis) * axis
    along /= np.linalg.norm(along)
    return np.array([along, np.cross(axis, along), axis])


def solve_lobes(
    machine: PoseModel, feed: FloatArray = NO_FEED, *, whole: bool = True
) -> Solved[PoseLobes]:
    """Lobes of a machine in a pose with the damping of its scene.

    Args:
        machine: In the pose.
        feed: ``(3,)`` direction of the feed, machine frame; NaN where there is none, and then no
            lobes along it.
        whole: Find the mode behind every lobe, check the best speeds, and look for unstable islands
            below every limit that is checked; else below and at the lowest one only.

    Raises:
        ModelError: A mode in the range has no damping.
    """
    point = prepare_point(machine)
    request = point.request
    tip = None if isinstance(point.assembly, MeasuredAssembly) else reduced_tip(machine, point)
    found = tuple(
        _solve_direction(machine, point, travel, tip, whole=whole)
        for travel in request.travels(feed)
    )
    if whole:
        found = _judge_limits(machine, point, found)
    low = request.immersion < request.low_immersion
    warnings = [] if tip is None else _warn_of_checks(machine, found)
    if tip is None and low:
        warnings.append(
            f"lobes: the immersion of {100.0 * request.immersion:.3g} % is low, and a measured receptance allows no Floquet"
            " multipliers: flip lobes are not in the limits"
        )
    method = "zeroth order (Altintas and Budak 1995)"
    if tip is None:
        method += "; not checked: the tool's receptance is measured"
    elif low:
        method = "Floquet multipliers at every speed (full discretisation), by bisection"
    else:
        method += "; Floquet multipliers at minima and at a sample of speeds, bisection where they disagree"
    answer = PoseLobes(
        pose=machine.pose.name,
        material=request.material,
        radial_depth=request.radial_depth,
        diameter=request.mill.diameter,
        teeth=request.mill.teeth,
        tool=_describe_tool(request),
        up_to_hz=request.up_to_hz,
        deepest=request.deepest,
        method=method,
        speeds=request.speeds,
        directions=found,
    )
    return Solved(answer, tuple(warnings))


def reduced_tip(machine: PoseModel, point: CuttingPoint) -> Tip:
    """The tip in few coordinates, machine axes: modes of the machine up to the reach and residual
    modes for the rest, spindle and tool on them; structural damping as viscous.
    """
    request, modes = point.request, machine.all_modes
    channels = [(request.at, direction) for direction in DIRECTIONS]
    system = equivalent_viscous(point.system, modes)
    small = reduce_to_modes(system, channels, request.reach_hz, modes)
    if request.tool_modes:
        small = attach_tool_modes(small, request.at, request.tool_modes)
    rows = np.array([small.outputs[channel] for channel in channels])
    damping = np.zeros_like(small.mass) if small.damping is None else small.damping
    tip = tip_dynamics(small.mass, damping, small.stiffness, forced=rows)
    return find_poles(tip) or tip


def _solve_direction(
    machine: PoseModel,
    point: CuttingPoint,
    travel: Travel,
    tip: Tip | None,
    *,
    whole: bool,
) -> DirectionLobes:
    request = point.request
    if travel.along is None:
        raise ValueError("a direction of travel is not known")
    frame = travel_frame(travel.along, request.up)
    stiffness = mean_cutting_stiffness(request.mill, request.coefficients, request.radial_depth)
    diagram = find_lobes(
        lambda omega: frame @ point.tip(omega) @ frame.T,
        point.omega,
        stiffness,
        teeth=request.mill.teeth,
        speeds=request.speeds,
        deepest=request.deepest,
    )
    depths, checks, bisected = diagram.depths.copy(), [], 0
    if tip is not None:
        found = np.full(len(depths), np.nan)
        trials = _Trials(request, turn_tip(tip, frame), diagram)
        if request.immersion < request.low_immersion:
            places: NDArray[np.intp] = np.arange(len(depths))
        else:
            chosen = {*_choose_speeds(machine, diagram), *(_best_speeds(depths) if whole else ())}
            lowest, thorough = int(np.argmin(depths)), whole or request.checked >= 1.0
            checks = [
                trials.check(place, ISLANDS if thorough or place == lowest else ())
                for place in sorted(chosen)
            ]
            places = np.array(
                [check.place for check in checks if not check.confirmed], dtype=np.intp
            )
        for place in places:
            found[place] = trials.limit(int(place))
        bisected = len(places)
        depths = np.where(np.isnan(found), depths, found)
    lobes, owner = _group(point, diagram, depths, stiffness, frame, machine, whole=whole)
    return DirectionLobes(
        name=travel.name,
        direction=travel.along,
        depths=depths,
        zeroth=diagram.depths,
        chatter=diagram.chatter,
        owner=owner,
        lowest_any_speed=diagram.lowest,
        lobes=lobes,
        best=_best_speeds(depths),
        checks=tuple(checks),
        bisected=bisected,
    )


def _judge_limits(
    machine: PoseModel, point: CuttingPoint, found: tuple[DirectionLobes, ...]
) -> tuple[DirectionLobes, ...]:
    """Directions of travel with the errors of their lowest limits; a limit found by bisection has
    the relative error of its zeroth order.
    """
    request, coupled, parts = point.request, machine.coupled, machine.parts
    if coupled is None:
        return found
    left_out = name_what_is_left_out(parts, coupled).left_out
    models = _find_finer_models(machine, request, find_error_sources(parts, coupled))
    if models is None:
        nothing = LimitErrors(Estimate({}, left_out), Estimate({}, left_out))
        return tuple(dataclasses.replace(own, errors=nothing) for own in found)
    stiffness = mean_cutting_stiffness(request.mill, request.coefficients, request.radial_depth)

    def find_lowest(frame: FloatArray, model: FrfModel) -> LowestLimit:
        def tip(omega: FloatArray) -> ComplexArray:
            machine_alone = model.form.evaluate(omega)
            return frame @ couple_assembly(machine_alone, omega, point.assembly) @ frame.T

        poles = find_peaks(model, _reach(request, point.assembly))
        diagram = find_lobes(
            tip,
            _spread_lines(request, point.assembly, poles),
            stiffness,
            teeth=request.mill.teeth,
            speeds=request.speeds,
            deepest=request.deepest,
        )
        place = int(np.argmin(diagram.depths))
        return LowestLimit(float(diagram.depths[place]), float(diagram.chatter[place]))

    judged = []
    for own in found:
        if own.lowest is not None:
            find = functools.partial(find_lowest, travel_frame(own.direction, request.up))
            changes = find_limit_changes(models, find)
            scale = float(own.depths[own.lowest.place]) / changes.plain.depth
            own = dataclasses.replace(own, errors=_list_errors(changes, scale, left_out))
        judged.append(own)
    return tuple(judged)


def _find_finer_models(
    machine: PoseModel, request: LobesRequest, sources: ErrorSources
) -> FinerModels | None:
    """The machine where it cuts as finer models may have it; None without any source of error."""
    if not (sources.truncated or sources.meshed):
        return None
    ports = [(request.at, direction) for direction in DIRECTIONS]
    channels = input_columns(machine.system, ports), output_rows(machine.system, ports)
    space = project_response(machine.system, sources, machine.all_modes, channels, request.reach_hz)

    def respond(change: SystemChange | None) -> FrfModel:
        # ratios of modes are those of the changed ones
        system = damp_system(machine.parts.scene, space.changed_system(ports, change))
        return prepare_frf(system, inputs=ports, outputs=ports)

    return change_models(space, respond)


def _list_errors(changes: LimitChanges, scale: float, left_out: tuple[str, ...]) -> LimitErrors:
    """Changes by source as estimates, those of depths times a scale."""
    depths: dict[str, float | None] = {}
    chatter: dict[str, float | None] = {}
    for source, size in (
        (DISCRETISATION, changes.mesh),
        (CURVED_FACES, changes.faces),
        (REDUCTION, changes.modes),
    ):
        if size is not None:
            depths[source] = scale * size.depth if np.isfinite(size.depth) else None
            chatter[source] = HZ * size.chatter if np.isfinite(size.chatter) else None
    return LimitErrors(Estimate(depths, left_out), Estimate(chatter, left_out))


@dataclass(frozen=True, eq=False)
class _Trials:
    """Cuts tried at speeds of a diagram."""

    request: LobesRequest
    tip: Tip
    diagram: LobeDiagram

    def multiplier(self, place: int) -> Callable[[float], float]:
        """Of a depth of cut [m] at a speed."""
        request, speed = self.request, float(self.diagram.speeds[place])
        cut = MillingCut(
            request.mill, request.coefficients, speed, request.deepest, request.radial_depth
        )
        chatter = float(self.diagram.chatter[place])
        hz = HZ * chatter if np.isfinite(chatter) else request.reach_hz
        steps = steps_per_period(FINEST_CHATTER * hz, cut.tooth_period)
        usual = ABOVE * float(self.diagram.depths[place])

        @functools.cache
        def gains(depth: float) -> FloatArray:
            return node_gains(dataclasses.replace(cut, axial_depth=depth), steps)

        stiffest = float(np.linalg.norm(gains(usual), axis=(1, 2)).max())

        @functools.cache
        def respond(share: float) -> StepResponse:
            """With the poles that matter up to a share of the usual depth."""
            return step_response(self.tip, cut.tooth_period, steps, stiffest=share * stiffest)

        def size(depth: float) -> float:
            share = max(1.0, 2.0 ** np.ceil(np.log2(depth / usual)))
            return largest_multiplier(respond(share), gains(depth))

        return size

    def check(self, place: int, islands: tuple[float, ...] = ()) -> LimitCheck:
        """Below and above a limit, and at shares of it where unstable islands may lie."""
        depth, multiplier = float(self.diagram.depths[place]), self.multiplier(place)
        below = max(multiplier(share * depth) for share in (*islands, BELOW))
        return LimitCheck(place, depth, below, multiplier(ABOVE * depth))

    def limit(self, place: int) -> float:
        """Limit depth at a speed by bisection [m]."""
        return scan_limit_depth(
            self.multiplier(place), float(self.diagram.depths[place]), self.request.deepest
        )


def _choose_speeds(machine: PoseModel, diagram: LobeDiagram) -> list[int]:
    """A seeded sample of the speeds that have a limit, at least one, and the lowest limit."""
    limited = np.flatnonzero(diagram.waves >= 0)
    if not len(limited):
        return []
    if lobes_request(machine).checked >= 1.0:
        return [int(place) for place in limited]
    place = repr(sorted(machine.pose.positions.items())).encode()
    draw = np.random.default_rng([SEED, zlib.crc32(place)])
    count = max(1, round(lobes_request(machine).checked * len(limited)))
    chosen = draw.choice(limited, size=count, replace=False)
    return sorted({int(np.argmin(diagram.depths)), *map(int, chosen)})


def _best_speeds(depths: FloatArray) -> tuple[int, ...]:
    """The deepest of the limits that no neighbour exceeds, the deepest first; of equal ones in a row
    the middle.
    """
    starts = np.flatnonzero(np.concatenate([[True], depths[1:] != depths[:-1]]))
    ends = np.concatenate([starts[1:], [len(depths)]]) - 1
    level = depths[starts]
    before, after = np.concatenate([[-np.inf], level[:-1]]), np.concatenate([level[1:], [-np.inf]])
    tops = np.flatnonzero((level > before) & (level > after) & (level > WORTHWHILE * depths.min()))
    order = sorted(tops, key=lambda top: -level[top])[:BEST_SPEEDS]
    return tuple(int((starts[top] + ends[top]) // 2) for top in order)


def _group(
    point: CuttingPoint,
    diagram: LobeDiagram,
    depths: FloatArray,
    stiffness: FloatArray,
    frame: FloatArray,
    machine: PoseModel,
    *,
    whole: bool,
) -> tuple[tuple[Lobe, ...], NDArray[np.intp]]:
    """Neighbouring speeds with the same waves of the same mode, and the lobe of each speed."""
    owner = np.full(len(depths), -1, dtype=np.intp)
    limited = np.flatnonzero(diagram.waves >= 0)
    if not len(limited):
        return (), owner
    if not whole:
        limited = limited[[int(np.argmin(depths[limited]))]]
    sources, shares = _find_sources(point, diagram, limited, stiffness, frame)
    waves = diagram.waves[limited]
    new = (np.diff(limited) > 1) | (np.diff(waves) != 0) | (np.diff(sources) != 0)
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
                waves=int(diagram.waves[place]),
                mode=name,
                mode_hz=hz,
                mode_share=float(shares[at]),
                part=part,
            )
        )
    return tuple(lobes), owner


def _find_sources(
    point: CuttingPoint,
    diagram: LobeDiagram,
    places: NDArray[np.intp],
    stiffness: FloatArray,
    frame: FloatArray,
) -> tuple[NDArray[np.intp], FloatArray]:
    """What contributes most to the motion that chatters at some speeds, ``(k,)`` numbers of modes of
    the machine and, after them, of parts of the assembly; and its share ``(k,)``.
    """
    omega = diagram.chatter[places]
    machine = point.model.form.evaluate(omega)
    tip = frame @ couple_assembly(machine, omega, point.assembly) @ frame.T
    shapes = chatter_shapes(tip, stiffness, diagram.eigenvalues[places])
    split = split_tip_motion(machine, omega, point.assembly, shapes.forces @ frame)
    weights = shapes.weights @ frame[:2]
    of_assembly = np.einsum("pnd,nd->np", split.parts, weights)
    coordinates = point.model.coordinates
    of_machine: ComplexArray = np.zeros((len(omega), 0), dtype=complex)
    if coordinates is not None:
        modal = _modal_motion(coordinates, omega, split.base_force)
        of_machine = modal * (weights @ coordinates.outputs)
    every = np.concatenate([of_machine, of_assembly], axis=1).real
    if not every.shape[1]:
        return np.full(len(omega), -1, dtype=np.intp), np.zeros(len(omega))
    best = np.argmax(every, axis=1)
    return best, np.take_along_axis(every, best[:, None], axis=1)[:, 0]


def _modal_motion(
    coordinates: ModalCoordinates, omega: FloatArray, force: ComplexArray
) -> ComplexArray:
    """``(k, m)`` modal coordinates under forces ``(k, 3)`` at angular frequencies ``(k,)``."""
    size = len(coordinates.eigenvalues)
    zero = np.zeros((size, size))
    viscous = zero if coordinates.viscous is None else coordinates.viscous
    hysteretic = zero if coordinates.hysteretic is None else coordinates.hysteretic
    loads = force @ coordinates.inputs.T
    moved = np.empty_like(loads)
    for row, value in enumerate(omega):
        matrix = np.diag(coordinates.eigenvalues - value**2) + 1j * (value * viscous + hysteretic)
        moved[row] = np.linalg.solve(matrix, loads[row])
    return moved


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


def _describe_tool(request: LobesRequest) -> str:
    if request.tool_receptance is not None:
        return f"measured receptances of {request.tool_receptance.name}"
    if not request.tool_modes:
        return RIGID_TOOL
    return "on the machine: " + ", ".join(
        f"{mode.name} {mode.hz:g} Hz" for mode in request.tool_modes
    )


def _warn_of_checks(machine: PoseModel, found: tuple[DirectionLobes, ...]) -> list[str]:
    """What checks did not confirm, in all directions of travel."""
    failed = [
        (float(own.depths[check.place] / check.depth - 1.0), own.name)
        for own in found
        for check in own.checks
        if not check.confirmed
    ]
    if not failed:
        return []
    worst, travel = max(failed, key=lambda each: abs(each[0]))
    return [
        f"lobes in pose {machine.pose.name}: {len(failed)} of {sum(len(own.checks) for own in found)} checked limits are off, by up to"
        f" {100.0 * worst:+.0f} % (travel {travel}); bisection has replaced these, others may be off as much: write checked = 1 in"
        " [analyses.lobes] to check every speed"
    ]
