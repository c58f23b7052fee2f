"""Fitting parameters of a scene to what was measured: from a checked target file to values with
intervals.
"""

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.short_forms import Displayed, ShortForm, list_few
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
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root, share_from_root
from headstock.studies.identification.cases import make_case
from headstock.studies.identification.descent import StartRecord, fit
from headstock.studies.identification.key_laws import ParameterValueError
from headstock.studies.identification.parametric_scene import ParametricScene, make_parametric
from headstock.studies.identification.problem import (
    FitPoint,
    FitProblem,
    compare_shape,
    compliance_gap,
    data_jacobian,
    evaluate,
    exchange_modes,
)
from headstock.studies.identification.statistics import FitStatistics, assess
from headstock.studies.identification.target_files import LoadedTask
from headstock.studies.identification.targets import Parameter, TargetCase

UNKNOWN = 50.0  # half-width of an interval, in coordinates, that says nothing: a factor of e^50
BOUND_SHARE = 1e-4  # nearer to a bound than this share of the way between them: at the bound


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
        low: Lower end of the 95 % interval; nan where neither data nor prior give one.
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
    """A target beside what the fitted model gives.

    Attributes:
        kind: ``frequency`` [Hz] or ``compliance`` [m/N].
        mac: With the described or measured shape, or None.
        mode: Number of the mode above the floor, from 1; 0 for compliances.
        hold_out: Predicted, not fitted.
    """

    case: str
    name: str
    kind: str
    wanted: float
    found: float
    residual: float
    hold_out: bool
    mac: float | None = None
    mode: int = 0

    @property
    def deviation(self) -> float:
        """Relative deviation of the model."""
        return self.found / self.wanted - 1.0


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Displayed):
    """What a fit found.

    Attributes:
        outcomes: Every target, held-out ones too.
        extra_hz: By case: modes above the floor and below the highest target or the limit that meet
            no target [Hz].
        best: Index of the start that was kept.
        statistics: Spread of the fitted coordinates.
        problem: What was fitted.
    """

    name: str
    parameters: tuple[FittedParameter, ...]
    outcomes: tuple[TargetOutcome, ...]
    extra_hz: dict[str, tuple[float, ...]]
    starts: tuple[StartRecord, ...]
    best: int
    statistics: FitStatistics
    problem: FitProblem
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
    scenes: dict[str | None, ParametricScene] = {}
    cases = []
    for case in loaded.task.cases:
        if case.variant not in scenes:
            scene = _with_modes(loaded.scenes[case.variant], loaded.task.cases)
            superelements = make_superelements(start_run(scene, comm, store))
            scenes[case.variant] = make_parametric(
                scene,
                superelements,
                loaded.task.parameters,
                scenes.values(),
                reduce=functools.partial(_reduce, scene, comm, store),
            )
        poses = loaded.scenes[case.variant].poses
        pose = poses[case.pose] if case.pose is not None else next(iter(poses.values()))
        cases.append(make_case(case, scenes[case.variant], pose, loaded.task.parameters))
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
    comm = comm or MPI.COMM_SELF
    starts = fit(problem, observer, comm=comm)
    return assess_starts(problem, name, share_from_root(comm, starts))


def assess_starts(
    problem: FitProblem, name: str, starts: tuple[StartRecord, ...]
) -> Identification:
    """Assess the parameters at the best end of all starts.

    Args:
        problem: Prepared cases and parameters.
        starts: How each start ended, at least one with an end.
    """
    best = int(np.argmin([record.cost for record in starts]))
    end = starts[best].end
    if end is None:
        raise AssertionError("a fit ended without a point and without saying why")
    point = exchange_modes(problem, evaluate(problem, end.coordinates), end.pairings)
    _, prior_sigmas = problem.priors
    statistics = assess(
        [parameter.name for parameter in problem.parameters],
        data_jacobian(problem, point),
        point.residuals,
        prior_sigmas,
        problem.upper - problem.lower,
        from_residuals=problem.settings.noise == "residuals",
    )
    return Identification(
        name=name,
        parameters=_fitted(problem, point, statistics),
        outcomes=tuple(
            outcome for index in range(len(point.states)) for outcome in _outcomes(point, index)
        ),
        extra_hz={
            state.model.case.name: _extra_modes(point, index)
            for index, state in enumerate(point.states)
        },
        starts=starts,
        best=best,
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
    highest = max((target.frequency_hz for case in cases for target in case.modes), default=0.0)
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
    problem: FitProblem, point: FitPoint, statistics: FitStatistics
) -> tuple[FittedParameter, ...]:
    reach = statistics.quantile * statistics.sigmas
    bounded = reach < UNKNOWN
    ends = (point.coordinates + side * np.where(bounded, reach, 0.0) for side in (0.0, -1.0, 1.0))
    value, low, high = (problem.values(end) for end in ends)
    return tuple(
        FittedParameter(
            parameter=parameter,
            value=value[parameter.name],
            low=low[parameter.name] if bounded[index] else np.nan,
            high=high[parameter.name] if bounded[index] else np.nan,
            data_share=float(statistics.data_share[index]),
            at_bound=_at_bound(problem, point.coordinates, index),
        )
        for index, parameter in enumerate(problem.parameters)
    )


def _at_bound(problem: FitProblem, coordinates: FloatArray, index: int) -> str:
    share = (coordinates - problem.lower)[index] / (problem.upper - problem.lower)[index]
    return "lower" if share < BOUND_SHARE else "upper" if share > 1.0 - BOUND_SHARE else ""


def _outcomes(point: FitPoint, index: int) -> list[TargetOutcome]:
    state, pairing = point.states[index], point.pairings[index]
    case, outcomes = state.model.case, list[TargetOutcome]()
    for target, mode in zip(case.modes, pairing.modes, strict=True):
        frequency = float(state.frequencies_hz[mode])
        residual = float(np.log(frequency / target.frequency_hz) / target.sigma)
        mac = None if target.shape is None else float(compare_shape(state, target.shape)[mode])
        outcomes.append(
            TargetOutcome(
                case=case.name,
                name=target.name,
                kind="frequency",
                wanted=target.frequency_hz,
                found=frequency,
                residual=residual,
                mac=mac,
                mode=mode + 1,
                hold_out=target.hold_out,
            )
        )
    for compliance, signed in zip(case.compliances, map(float, state.compliances), strict=True):
        value = abs(signed) if compliance.either_sign else signed
        outcomes.append(
            TargetOutcome(
                case=case.name,
                name=compliance.name,
                kind="compliance",
                wanted=compliance.value,
                found=value,
                residual=compliance_gap(compliance, value),
                hold_out=compliance.hold_out,
            )
        )
    return outcomes


def _extra_modes(point: FitPoint, index: int) -> tuple[float, ...]:
    state, paired = point.states[index], set(point.pairings[index].modes)
    case = state.model.case
    top = max(
        [target.frequency_hz for target in case.modes]
        + ([case.limit.below_hz] if case.limit else []),
        default=0.0,
    )
    return tuple(
        float(f) for i, f in enumerate(state.frequencies_hz) if i not in paired and f < top
    )
