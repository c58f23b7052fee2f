"""Fitting parameters of a scene to what was measured: from a checked target file to values with
intervals.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from headstock.geometry.parts.components import Component
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.short_forms import Displayed, ShortForm, list_few
from headstock.pipeline.stages.estimates import estimate_mode_errors
from headstock.pipeline.stages.shared_components import (
    load_elastic,
    make_superelements,
    prepare_components,
    start_run,
)
from headstock.pipeline.storage.store import Store
from headstock.reduction.superelement import Superelement
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.keys import write_number
from headstock.scene.scene import Analyses, Scene
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root, share_from_root
from headstock.studies.identification.cases import CaseState, make_case
from headstock.studies.identification.descent import StartRecord, fit
from headstock.studies.identification.key_laws import ParameterValueError
from headstock.studies.identification.observations import Observation
from headstock.studies.identification.pairings import compare_shape
from headstock.studies.identification.parametric_scene import ParametricScene, make_parametric
from headstock.studies.identification.problem import (
    FitPlace,
    FitPoint,
    FitProblem,
    data_jacobian,
    evaluate,
    exchange_modes,
    stack_slopes,
)
from headstock.studies.identification.statistics import DataGroup, FitStatistics, assess
from headstock.studies.identification.target_files import LoadedTask
from headstock.studies.identification.targets import MachineKey, Parameter, TargetCase

UNKNOWN = 50.0  # half-width of an interval, in coordinates, that says nothing: a factor of e^50
BOUND_SHARE = 1e-4  # nearer to a bound than this share of the way between them: at the bound
CORRELATION_SHOWN = 0.9
LEAST_MAC = 0.5  # a mode in words that is less like every mode near it is left out
NEAR = 2.0  # factor between the frequency of a target and those of modes that may be meant


def _check_bounds(problem: FitProblem, findings: Findings) -> None:
    """Refuse bounds at which a component cannot be built, the other parameters at their starts.

    Raises:
        SceneError: At least one bound, or the starts, cannot be built.
    """
    scenes = list({id(model.parametric): model.parametric for model in problem.cases}.values())
    starts = {parameter.name: parameter.start for parameter in problem.parameters}
    if reason := _find_reason(scenes, starts):
        findings.add(
            ("parameters",),
            f"the scene cannot be built with every parameter at its start: {reason}",
        )
        findings.raise_if_any()
    for parameter in problem.parameters:
        for index, (what, bound) in enumerate(
            (("lower", parameter.lower), ("upper", parameter.upper))
        ):
            touched = [scene for scene in scenes if scene.touched[parameter.name].any]
            if reason := _find_reason(touched, {**starts, parameter.name: bound}):
                shown = write_number(bound, parameter.unit, 6)
                text = f"at its {what} bound {shown} the scene cannot be built: {reason}; narrow the bounds, or let what is in the way follow"
                findings.add(("parameters", parameter.name, "bounds", index), text)
    findings.raise_if_any()


def _find_reason(scenes: list[ParametricScene], values: dict[str, float]) -> str:
    for scene in scenes:
        try:
            scene.build(values)
        except ParameterValueError as error:
            return str(error)
    return ""


@dataclass(frozen=True)
class FittedParameter:
    """A parameter after the fit, SI.

    Attributes:
        low: Lower end of the 95 % interval; nan where neither data nor prior give one, and at a bound.
        data_share: Share of the variance allowed beforehand that the data take away.
        at_bound: ``lower``, ``upper`` or empty.
    """

    parameter: Parameter
    value: float
    low: float
    high: float
    data_share: float
    at_bound: str


@dataclass(frozen=True)
class TargetOutcome:
    """A target beside what the fitted model gives, SI.

    Attributes:
        kind: Name in ``KINDS``.
        residual: Distance in standard deviations of the measurement; root mean square of several.
        hold_out: Predicted, not fitted.
        spread: Half of the 95 % interval of the model's value, from the intervals of the parameters;
            relative; nan where a parameter is open.
        scatter: The same of a measurement, from its tolerance or from the residuals of its kind.
        mesh: The same of the model by meshes and reductions, of frequencies; nan where unknown.
        label: What the file calls the mode; empty without a name.
        mac: With the described or measured shape, or None.
        mode: Number of the mode above the floor, from 1; 0 without.
    """

    case: str
    name: str
    kind: str
    wanted: float
    found: float
    residual: float
    hold_out: bool
    spread: float
    scatter: float
    mesh: float = np.nan
    label: str = ""
    mac: float | None = None
    mode: int = 0

    @property
    def deviation(self) -> float:
        """Relative deviation of the model."""
        return self.found / self.wanted - 1.0


@dataclass(frozen=True, eq=False)
class FitEnds:
    """How the starts of a fit ended.

    Attributes:
        problem: What was fitted in the end.
        left_out: Targets whose shape in words no mode is like; their frequencies are fitted.
    """

    problem: FitProblem
    starts: tuple[StartRecord, ...]
    left_out: tuple[str, ...] = ()

    @property
    def best(self) -> int:
        """Index of the start that is kept."""
        return int(np.argmin([record.cost for record in self.starts]))

    @property
    def end(self) -> FitPlace:
        """Return where the best start ended."""
        end = self.starts[self.best].end
        if end is None:
            raise AssertionError("a fit ended without a point and without saying why")
        return end

    def solve_best(self) -> FitPoint:
        """Compute the machine where the best start ended."""
        point = evaluate(self.problem, self.end.coordinates)
        return exchange_modes(self.problem, point, self.end.pairings)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Identification(FitEnds, Displayed):
    """What a fit found.

    Attributes:
        outcomes: Every target, held-out ones too.
        extra_hz: By case: modes above the floor and below the highest target or the limit that meet
            no target [Hz].
        statistics: Spread of the fitted coordinates.
        point: The machine where the best start ended.
    """

    name: str
    parameters: tuple[FittedParameter, ...]
    outcomes: tuple[TargetOutcome, ...]
    extra_hz: dict[str, tuple[float, ...]]
    statistics: FitStatistics
    point: FitPoint

    def _short_form(self) -> ShortForm:
        facts = [
            ("parameters", list_few(list(self.values))),
            ("targets", str(len(self.outcomes))),
            ("starts", f"{len(self.starts)}, {'converged' if self.converged else 'not converged'}"),
        ]
        rows = [[name, f"{value:.6g}"] for name, value in self.values.items()]
        return ShortForm(f"Fit {self.name}", facts, ["parameter", "value [SI]"], rows)

    @property
    def values(self) -> dict[str, float]:
        """Fitted values by parameter, SI."""
        return {item.parameter.name: item.value for item in self.parameters}

    @property
    def correlated(self) -> list[tuple[str, str, float]]:
        """Pairs of parameters that the data hardly separate, and their correlation."""
        names, table = list(self.values), self.statistics.correlations
        return [
            (names[i], names[j], float(table[i, j]))
            for i, j in np.argwhere(np.tril(np.abs(table) >= CORRELATION_SHOWN, -1))
        ]

    @property
    def exchanges(self) -> list[tuple[str, str]]:
        """Names of neighbouring measured frequencies of a case whose modes the model has in the other
        order; held-out ones are left out.
        """
        rows = [one for one in self.outcomes if one.kind == "frequency" and not one.hold_out]
        rows.sort(key=lambda one: (one.case, one.wanted))
        return [
            (low.name, high.name)
            for low, high in itertools.pairwise(rows)
            if low.case == high.case and low.mode > high.mode > 0
        ]

    @property
    def converged(self) -> bool:
        """The start that was kept met a tolerance."""
        return self.starts[self.best].converged


def prepare_problem(loaded: LoadedTask, store: Store, comm: MPI.Comm) -> FitProblem:
    """Reduce every component once and tie the scenes to the parameters; collective.

    Args:
        loaded: A checked target file with its scenes; the same on every rank.
        comm: Ranks that share the components.

    Raises:
        SceneError: The scene cannot be built with the starts or at a bound.
        HeadstockError: A component cannot be reduced; on several ranks the cause of a
            ``SharedFailure``, as the other one.
    """
    if comm.size > 1:
        scenes = [_with_modes(scene, loaded.task.cases) for scene in loaded.scenes.values()]
        plans = make_on_root(comm, lambda: [plan_scene(scene) for scene in scenes])
        # a fit may mesh components anew on any rank
        load_elastic(stage for plan in plans for stage in plan.stages)
        states = [
            start_run(scene, comm, store, plan=plan)
            for scene, plan in zip(scenes, plans, strict=True)
        ]
        prepare_components(states)
    return make_on_root(comm, lambda: _tie_scenes(loaded, store))


def _tie_scenes(loaded: LoadedTask, store: Store) -> FitProblem:
    """Tie the scenes to the parameters, in one process."""
    comm = MPI.COMM_SELF
    scenes: dict[MachineKey, ParametricScene] = {}
    cases = []
    for case in loaded.task.cases:
        if case.machine not in scenes:
            scene = _with_modes(loaded.scenes[case.machine], loaded.task.cases)
            state = start_run(scene, comm, store)
            parametric = make_parametric(
                scene,
                make_superelements(state),
                loaded.task.parameters,
                scenes.values(),
                reduce=functools.partial(_reduce, scene, comm, store),
            )
            scenes[case.machine] = dataclasses.replace(parametric, parts=state.parts)
        poses = loaded.scenes[case.machine].poses
        pose = poses[case.pose] if case.pose is not None else next(iter(poses.values()))
        cases.append(make_case(case, scenes[case.machine], pose, loaded.task.parameters))
    problem = FitProblem(tuple(cases), loaded.task.parameters, loaded.task.settings)
    _check_bounds(problem, loaded.findings)
    return problem


def fit_parameters(
    problem: FitProblem,
    name: str,
    observer: Callable[[StartRecord], None] = lambda record: None,
    *,
    comm: MPI.Comm | None = None,
) -> Identification:
    """Fit the parameters and say what is known of them; collective.

    Args:
        problem: Prepared cases and parameters; the same on every rank.
        observer: Called on rank 0 with each start as it ends.
        comm: Ranks that share the starts; None for this one alone.

    Returns:
        The same on every rank.

    Raises:
        ConvergenceError: No start could be computed; on several ranks the cause of a
            ``SharedFailure``.
    """
    ends = fit_targets(problem, observer, comm=comm or MPI.COMM_SELF)
    return assess_ends(ends, name)


def fit_targets(
    problem: FitProblem,
    observer: Callable[[StartRecord], None] = lambda record: None,
    *,
    comm: MPI.Comm,
) -> FitEnds:
    """Run every start; shapes in words that no mode is like in the end are left out, and the fit is
    repeated without them; where responses count by their noise, modes lead to where they are fitted;
    collective.

    Args:
        problem: Prepared cases and parameters; the same on every rank.
        observer: Called on rank 0 with each start as it ends.

    Returns:
        The same on every rank.

    Raises:
        ConvergenceError: No start could be computed; on several ranks the cause of a
            ``SharedFailure``.
    """
    if any(model.case.is_led for model in problem.cases):
        ends = fit_targets(problem.change_cases(_keep_modes), observer, comm=comm)
        problem = _start_at(problem.change_cases(_keep_responses), ends)
    left_out: tuple[str, ...] = ()
    while True:
        starts = share_from_root(comm, fit(problem, observer, comm=comm))
        ends = FitEnds(problem, starts, left_out)
        misfits = make_on_root(comm, functools.partial(_find_misfits, ends))
        if not misfits:
            return ends
        left_out += misfits
        strip = functools.partial(TargetCase.change_modes, names=misfits, shape=None)
        problem = problem.change_cases(strip)


def _start_at(problem: FitProblem, ends: FitEnds) -> FitProblem:
    """Return a problem with one start, where the best of another one ended."""
    values = ends.problem.values(ends.end.coordinates)
    return dataclasses.replace(
        problem,
        parameters=tuple(
            dataclasses.replace(parameter, start=values[parameter.name])
            for parameter in problem.parameters
        ),
        settings=problem.settings.model_copy(update={"starts": 1}),
    )


def _keep_modes(case: TargetCase) -> TargetCase:
    return dataclasses.replace(case, responses=()) if case.is_led else case


def _keep_responses(case: TargetCase) -> TargetCase:
    return case.change_modes(hold_out=True) if case.is_led else case


def _find_misfits(ends: FitEnds) -> tuple[str, ...]:
    """Return the targets with a shape in words that is unlike every mode near them."""
    in_words = [
        target
        for model in ends.problem.cases
        for target in model.case.modes
        if target.shape is not None and target.shape.described and not target.shape.insist
    ]
    if not in_words:
        return ()
    misfits = []
    for state in ends.solve_best().states:
        for target in state.model.case.modes:
            if target in in_words and target.shape is not None:
                reach = np.abs(np.log(state.frequencies_hz / target.frequency_hz))
                macs = compare_shape(state, target.shape)[reach <= np.log(NEAR)]
                if macs.max(initial=0.0) < LEAST_MAC:
                    misfits.append(target.name)
    return tuple(misfits)


def assess_ends(ends: FitEnds, name: str) -> Identification:
    """Assess the parameters at the best end of all starts."""
    problem, point = ends.problem, ends.solve_best()
    _, prior_sigmas = problem.priors
    rows, groups = 0, []
    for item in point.fitted:
        groups.append(DataGroup(item.kind, slice(rows, rows + len(item.residuals)), item.data))
        rows += len(item.residuals)
    shares = (point.coordinates - problem.lower) / (problem.upper - problem.lower)
    bounds = [
        "lower" if share < BOUND_SHARE else "upper" if share > 1.0 - BOUND_SHARE else ""
        for share in shares
    ]
    statistics = assess(
        [parameter.name for parameter in problem.parameters],
        data_jacobian(problem, point),
        point.residuals,
        prior_sigmas,
        problem.upper - problem.lower,
        from_residuals=problem.settings.noise == "residuals",
        groups=groups,
        at_bound=np.array([bool(bound) for bound in bounds]),
    )
    return Identification(
        name=name,
        parameters=_fitted(problem, point, statistics, bounds),
        outcomes=tuple(
            outcome
            for state, observations in zip(point.states, point.observations, strict=True)
            for outcome in _outcomes(problem, point, state, observations, statistics)
        ),
        extra_hz={
            state.model.case.name: _extra_modes(point, index)
            for index, state in enumerate(point.states)
        },
        left_out=ends.left_out,
        starts=ends.starts,
        statistics=statistics,
        problem=problem,
        point=point,
    )


def _reduce(scene: Scene, comm: MPI.Comm, store: Store, component: Component) -> Superelement:
    """Mesh and reduce a changed component of a scene; the store answers where it is known."""
    machine = dataclasses.replace(
        scene.machine, components=scene.machine.components | {component.name: component}
    )
    changed = dataclasses.replace(scene, machine=machine)
    state = start_run(changed, comm, store)
    return make_superelements(state, only=[component.name])[component.name]


def _with_modes(scene: Scene, cases: tuple[TargetCase, ...]) -> Scene:
    """The scene with a modal analysis that reaches past the targets, so that elastic components
    keep the modes this takes.
    """
    modes = [target.frequency_hz for case in cases for target in case.modes]
    lines = {hz for case in cases for target in case.responses for hz in target.frequencies_hz}
    highest = max([*modes, *lines], default=0.0)
    asked = scene.analyses.get(ModalRequest)
    if highest == 0.0 or (
        asked is not None and asked.up_to_hz is not None and asked.up_to_hz >= highest
    ):
        return scene
    return dataclasses.replace(
        scene,
        analyses=Analyses(ModalRequest(None, 1.5 * highest), *scene.analyses.requests),
    )


def _fitted(
    problem: FitProblem, point: FitPoint, statistics: FitStatistics, bounds: list[str]
) -> tuple[FittedParameter, ...]:
    reach = statistics.quantiles * statistics.sigmas
    low, high = point.coordinates - reach, point.coordinates + reach
    # an interval that holds all that was allowed says nothing
    bounded = ~((low <= problem.lower) & (high >= problem.upper)) & (reach < UNKNOWN)
    bounded &= np.array([not bound for bound in bounds])
    ends = (point.coordinates + side * np.where(bounded, reach, 0.0) for side in (0.0, -1.0, 1.0))
    value, lower, upper = (problem.values(end) for end in ends)
    return tuple(
        FittedParameter(
            parameter=parameter,
            value=value[parameter.name],
            low=lower[parameter.name] if bounded[index] else np.nan,
            high=upper[parameter.name] if bounded[index] else np.nan,
            data_share=float(statistics.data_share[index]),
            at_bound=bounds[index],
        )
        for index, parameter in enumerate(problem.parameters)
    )


def _outcomes(
    problem: FitProblem,
    point: FitPoint,
    state: CaseState,
    observations: tuple[Observation, ...],
    statistics: FitStatistics,
) -> list[TargetOutcome]:
    """Return what is shown of the targets of a case; a shape with its frequency, no limits."""
    outcomes = list[TargetOutcome]()
    labels = {target.name: target.label for target in state.model.case.modes}
    mesh = _mesh_errors(state)
    for item in observations:
        if item.kind == "shape":
            outcomes[-1] = dataclasses.replace(outcomes[-1], mac=item.value)
        elif item.kind != "limit":
            gaps = item.residuals
            residual = float(gaps[0]) if len(gaps) == 1 else float(np.sqrt(np.mean(gaps**2)))
            slopes = item.sigma * stack_slopes(problem, point, [item])
            outcomes.append(
                TargetOutcome(
                    case=state.model.case.name,
                    name=item.name,
                    kind=item.kind,
                    wanted=item.wanted,
                    found=item.value,
                    residual=residual,
                    hold_out=item.hold_out,
                    spread=statistics.spread(slopes),
                    scatter=float(norm.ppf(0.975)) * statistics.scatter(item.kind, item.sigma),
                    mesh=mesh[item.mode]
                    if item.kind == "frequency" and item.mode is not None
                    else np.nan,
                    label=labels.get(item.name, ""),
                    mode=0 if item.mode is None else item.mode + 1,
                )
            )
    return outcomes


def _mesh_errors(state: CaseState) -> list[float]:
    """Return what meshes and reductions leave out of each frequency above the floor, relative; nan where
    nobody knows.
    """
    parametric, count = state.model.parametric, len(state.eigenvalues)
    components = parametric.scene.machine.components.values()
    parts = None
    if any(part.fidelity == "elastic" for part in components):
        parts = parametric.reduce_to(state.values)
    if parts is None or not count:
        return [np.nan] * count
    modes = solve_modal(state.coupled.system, count=state.below + count)
    totals = [error.total for error in estimate_mode_errors(parts, state.coupled, modes)]
    return [
        np.nan if total is None else total / float(hz)
        for total, hz in zip(totals[state.below :], state.frequencies_hz, strict=False)
    ]


def _extra_modes(point: FitPoint, index: int) -> tuple[float, ...]:
    state, paired = point.states[index], set(point.pairings[index])
    case = state.model.case
    top = max(
        [target.frequency_hz for target in case.modes]
        + ([case.limit.below_hz] if case.limit else []),
        default=0.0,
    )
    return tuple(
        float(f) for i, f in enumerate(state.frequencies_hz) if i not in paired and f < top
    )
