"""Whether a round of a search is accurate enough, and which components are refined where
it is not.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.parts.components import Component, MeshSettings, ReductionSettings
from headstock.geometry.parts.size_field import SizeField
from headstock.geometry.parts.solids import MeshFile
from headstock.pipeline.accuracy.mesh_sizes import mean_size, refine_sizes
from headstock.pipeline.accuracy.quantities import (
    Factors,
    Quantity,
    choose_greedily,
    count_safely,
    gather_quantities,
    weigh_estimates,
    worst_quantity,
)
from headstock.pipeline.accuracy.settings import (
    DEFAULT_RATE,
    LEAST_STEP,
    Trial,
    follows_errors,
    give_sizes,
    is_chosen,
    keep_details,
    list_equals,
    refine_mesh,
    refine_modes,
    start_component,
)
from headstock.pipeline.answers.accuracy import AccuracyRound
from headstock.pipeline.numbers.changes import Owner
from headstock.pipeline.numbers.estimates import DISCRETISATION, LEFT_OUT
from headstock.pipeline.stages.components import load_or_make_mesh
from headstock.pipeline.stages.run_state import RunState
from headstock.scene.scene import AccuracyGoal, Scene
from headstock.solvers.recovery.discretisation_error import find_resolved_step

# Share of the accuracy that the next round aims at, as a narrow miss costs another round. Errors of
# coarse meshes fall less than expected: rounds missed their aim by about this power of the ratio of
# error and accuracy, by which the aim is reduced down to the least one
AIM, FAR_POWER, LEAST_AIM = 0.75, 0.4, 0.55
ERROR_STEP = 0.9  # factor by which the error of an owner is assumed to fall in one step
# errors fall with about the second power of the mesh size; processor time grows with its third
COST_POWER = 1.5
LEAST_SECONDS = 0.05  # of a component
LEAST_RATIO = 1e-3  # of an error, over all rounds to come


@dataclass(frozen=True)
class _MeshScale:
    """Describe the fineness of a mesh.

    Attributes:
        size: Element size, or the mean where sizes vary with the error [m].
        mean: Side of the cube per dof [m].
        graded: Sizes vary with the error.
    """

    size: float
    mean: float
    graded: bool

    def step_from(self, before: "_MeshScale") -> float:
        """Return the size over that of an earlier mesh; the ratio of means where only one of them
        varies with the error, as sizes are then not comparable.
        """
        if self.graded == before.graded:
            return self.size / before.size
        return self.mean / before.mean


@dataclass(frozen=True, eq=False)
class History:
    """Store the results of earlier rounds.

    Attributes:
        trials: Component to its meshes so far, with the largest error each contributed.
        quantities: Numbers of the last round, with errors as estimated.
        scales: Fineness of the meshes of the last round.
    """

    trials: Mapping[str, tuple[Trial, ...]] = field(default_factory=dict)
    quantities: Sequence[Quantity] = ()
    scales: Mapping[str, _MeshScale] = field(default_factory=dict)
    factors: Factors = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Verdict:
    """Store the evaluation of a round by rank 0: whether the search ends, else the next scene; and
    the report.

    Attributes:
        aim: Relative error that the next round is to reach; None where no number has a bound.
    """

    ends: bool
    scene: Scene
    round: AccuracyRound
    failure: str = ""
    aim: float | None = None


def evaluate_round(
    scene: Scene, state: RunState, goal: AccuracyGoal, history: History
) -> tuple[Verdict, History]:
    """Decide whether a round is accurate enough, and else refine components; and add the round to
    the history.

    Args:
        scene: Scene of the round, with the settings of its components.
        state: Results of the round; rank 0's.
        history: Results of earlier rounds.
    """
    parts = scene.machine.components
    estimated = gather_quantities(state)
    scales = _find_scales(parts, state)
    factors = _learn_factors(parts, state, estimated, scales, history)
    quantities = count_safely(estimated, factors)
    worst = worst_quantity(quantities)
    if worst is None:
        nothing = AccuracyRound("every number", 0.0, "no component is meshed")
        return Verdict(True, scene, nothing), history
    reported = worst.report()
    trials = _remember(history.trials, parts, scales, estimated, quantities)
    learnt = History(trials, estimated, scales, factors)
    if state.failures:
        return Verdict(True, scene, reported), learnt
    if worst.error <= goal.to:
        # where an estimate contains only part of the error, a second mesh shows the rest
        owners = {each.owner for each in quantities if each.parts}
        once = [
            name
            for name in parts
            if len(trials.get(name, ())) < 2 and (name, DISCRETISATION) in owners
        ]
        return _confirm(scene, _find_resolved_steps(state, parts, once), reported), learnt
    spent = dict.fromkeys(parts, 0.0)
    for stage in state.plan.stages:
        if stage.component is not None:
            spent[stage.component] += stage.estimated_seconds or 0.0
    seconds = {name: LEAST_SECONDS + spent[name] for name in parts}
    wanted = _wanted_ratios(quantities, goal.to, parts, seconds)
    short = [quantity for quantity in quantities if quantity.error > goal.to]
    verdict = _refine(scene, state, goal.to, wanted, short, trials, reported)
    return dataclasses.replace(verdict, aim=_choose_aim(short, goal.to)), learnt


def _learn_factors(
    parts: Mapping[str, Component],
    state: RunState,
    estimated: Sequence[Quantity],
    scales: Mapping[str, _MeshScale],
    history: History,
) -> dict[str, float]:
    """Return safety factors on estimates, from the refinement of meshes since the last round."""
    steps = {
        name: step
        for name, scale in scales.items()
        if name in history.scales and (step := scale.step_from(history.scales[name])) < 1.0
    }
    # a mesh that hardly changed says nothing about the estimate
    changed = [name for name, step in steps.items() if step <= LEAST_STEP]
    unseen = _find_resolved_steps(state, parts, changed)
    return weigh_estimates(history.quantities, estimated, steps, history.factors, unseen)


def _find_resolved_steps(
    state: RunState, parts: Mapping[str, Component], names: Iterable[str]
) -> dict[str, float]:
    """Return the size ratio at which recovery finds the whole error of the mesh, for components
    where it finds only part of it; on rank 0.
    """
    steps = {
        name: find_resolved_step(load_or_make_mesh(state, state.plan.components[name])[0])
        for name in names
        if is_chosen(parts[name]) and follows_errors(parts[name])
    }
    return {name: step for name, step in steps.items() if step < 1.0}


def _confirm(scene: Scene, steps: Mapping[str, float], reported: AccuracyRound) -> Verdict:
    """End a search that is accurate enough by its estimates; or return the next scene, with finer
    meshes of components whose estimates contain only part of the error, by the given steps.
    """
    parts = scene.machine.components
    finer = {
        other: refine_mesh(parts[other], ratio=step**DEFAULT_RATE, trials=())
        for name, step in steps.items()
        for other in list_equals(parts, name)
    }
    if not finer:
        return Verdict(True, scene, reported)
    reason = f"single tetrahedra fill walls of {', '.join(steps)}: a finer mesh has to confirm it"
    whole = dataclasses.replace(reported, reason=f"{reported.reason}; {reason}")
    return _go_on(scene, {**parts, **finer}, whole, reason)


def _go_on(
    scene: Scene, finer: Mapping[str, Component], reported: AccuracyRound, reason: str
) -> Verdict:
    """Return the next scene, with the changes of its components and the reason."""
    before = {name: describe_settings(part) for name, part in scene.machine.components.items()}
    after = {name: describe_settings(part) for name, part in finer.items()}
    changes = {
        name: f"{before[name]} → {words}: {reason}"
        for name, words in after.items()
        if words != before[name]
    }
    return Verdict(
        False, replace_components(scene, finer), dataclasses.replace(reported, changes=changes)
    )


def _find_scales(parts: Mapping[str, Component], state: RunState) -> dict[str, _MeshScale]:
    """Return the fineness of each mesh, by component; none of a part without a mesh."""
    scales = {}
    for name, part in parts.items():
        graded = follows_errors(part)
        if is_chosen(part) and (graded or part.mesh.size is not None):
            mean = mean_size(state.reduced[name])
            scales[name] = _MeshScale(
                mean if graded else part.mesh.size or 0.0, mean, graded=graded
            )
    return scales


def _refine(
    scene: Scene,
    state: RunState,
    accuracy: float,
    wanted: Mapping[Owner, float],
    short: Sequence[Quantity],
    trials: Mapping[str, tuple[Trial, ...]],
    reported: AccuracyRound,
) -> Verdict:
    """Return the next scene, in which the errors of some owners should fall by given ratios."""
    parts = scene.machine.components
    finer = dict(parts)
    sized: dict[str, SizeField] = {}
    for (name, kind), ratio in wanted.items():
        part = finer[name]
        meshed = kind == DISCRETISATION
        if meshed and isinstance(part.solid, MeshFile):
            return Verdict(True, scene, reported, f"the {kind} of {name} cannot be refined")
        if parts[name].fidelity == "polynomial" and (meshed or ratio == 0.0):
            # a higher degree would cost more than finite elements
            elastic, kept = dataclasses.replace(part, fidelity="elastic"), part.reduction
            finer[name] = start_component(elastic, accuracy, kept.modes_to_hz, modes=kept.modes)
        elif kind == LEFT_OUT:
            finer[name] = keep_details(part, ratio=ratio)
        elif meshed and follows_errors(parts[name]):
            if name not in sized:
                group = list_equals(parts, name)
                sized |= dict.fromkeys(group, refine_sizes(state, group, short, ratio))
            finer[name] = give_sizes(part, sized[name])
        elif meshed:
            finer[name] = refine_mesh(part, ratio=ratio, trials=trials.get(name, ()))
        else:
            cutoff, highest = state.reduced[name].superelement.cutoff_hz, _highest_found(state)
            finer[name] = refine_modes(part, ratio=ratio, cutoff_hz=cutoff, highest_hz=highest)
    verdict = _go_on(scene, finer, reported, reported.reason)
    if not verdict.round.changes and reported.owner is not None:
        component, source = reported.owner
        return Verdict(True, scene, reported, f"the {source} of {component} cannot be refined")
    return verdict


def _wanted_ratios(
    quantities: Sequence[Quantity],
    accuracy: float,
    parts: Mapping[str, Component],
    seconds: Mapping[str, float],
) -> dict[Owner, float]:
    """Return the ratios by which the errors of owners must fall so that every number is likely to
    be within the accuracy, at the least cost: at each step the one that reduces the worst number
    most per processor time.

    What a mesh cannot reach in one step is left to the next round: other owners are not refined
    instead. Equal components are refined alike, so that they share one superelement. Where a part
    has no bound, the necessary ratio is unknown: it is 0.

    Args:
        accuracy: Relative error allowed.
        seconds: Processor time of a component's stages at its present settings.
    """
    groups = _group_owners(quantities, parts)
    short = [quantity for quantity in quantities if quantity.error > accuracy]
    unbounded = [
        owner for quantity in short for owner, part in quantity.parts.items() if np.isinf(part)
    ]
    ratios = {other: 0.0 for owner in unbounded for other in groups[owner]}
    bounded = [quantity for quantity in short if np.isfinite(quantity.error)]
    aim = _choose_aim(short, accuracy)
    if aim is None:
        return ratios

    def worst_parts() -> tuple[float, dict[Owner, float]]:
        left = [
            {owner: ratios.get(owner, 1.0) * part for owner, part in quantity.parts.items()}
            for quantity in bounded
        ]
        worst = max(left, key=lambda parts: sum(parts.values()))
        return sum(worst.values()), worst

    def gain(owner: Owner, worst: Mapping[Owner, float]) -> float:
        taken = sum(worst.get(other, 0.0) for other in groups[owner])
        return taken / _added_seconds(seconds[owner[0]], ratios.get(owner, 1.0))

    def step(owner: Owner, worst: Mapping[Owner, float]) -> None:
        for other in groups[owner]:
            ratios[other] = ERROR_STEP * ratios.get(other, 1.0)

    choose_greedily(
        worst_parts,
        aim,
        options=lambda worst: [
            owner for owner in worst if groups[owner] and ratios.get(owner, 1.0) > LEAST_RATIO
        ],
        gain=gain,
        take=step,
    )
    return ratios


def _choose_aim(short: Sequence[Quantity], accuracy: float) -> float | None:
    """Return the error that the next round is to reach; None where no number has a bound.

    Args:
        short: Numbers that are not within the accuracy.
    """
    bounded = [quantity.error for quantity in short if np.isfinite(quantity.error)]
    if not bounded:
        return None
    return accuracy * float(np.clip((accuracy / max(bounded)) ** FAR_POWER, LEAST_AIM, AIM))


def _group_owners(
    quantities: Sequence[Quantity], parts: Mapping[str, Component]
) -> dict[Owner, tuple[Owner, ...]]:
    """Return the owners of errors that are refined together, by each of them."""
    names = {name for quantity in quantities for name, _ in quantity.parts}
    equals = {
        name: [other for other in list_equals(parts, name) if is_chosen(parts[other])]
        for name in names
    }
    return {
        (name, kind): tuple((other, kind) for other in equals[name])
        for quantity in quantities
        for name, kind in quantity.parts
    }


def _added_seconds(seconds: float, ratio: float) -> float:
    """Return the cost of the next step: all of the component where it is the first, as nothing of
    the old superelement can be reused.
    """
    after = float(seconds * (ERROR_STEP * ratio) ** -COST_POWER)
    return after if ratio == 1.0 else after - float(seconds * ratio**-COST_POWER)


def _remember(
    trials: Mapping[str, tuple[Trial, ...]],
    parts: Mapping[str, Component],
    scales: Mapping[str, _MeshScale],
    estimated: Sequence[Quantity],
    counted: Sequence[Quantity],
) -> dict[str, tuple[Trial, ...]]:
    """Return the trials with those of this round."""
    longer = dict(trials)
    for name in parts:
        equals = list_equals(parts, name)
        largest, largest_counted = (
            max(
                (
                    quantity.parts.get((other, DISCRETISATION), 0.0)
                    for quantity in quantities
                    for other in equals
                ),
                default=0.0,
            )
            for quantities in (estimated, counted)
        )
        before, scale = trials.get(name, ()), scales.get(name)
        if scale is not None and largest > 0.0 and (not before or before[-1].size != scale.size):
            longer[name] = (*before, Trial(scale.size, largest, largest_counted))
    return longer


def _highest_found(state: RunState) -> float:
    return max(
        (float(modes.frequencies_hz[-1]) for modes in state.modal if len(modes.frequencies_hz)),
        default=0.0,
    )


def replace_components(scene: Scene, components: Mapping[str, Component]) -> Scene:
    """Return the scene with other components."""
    return dataclasses.replace(
        scene, machine=dataclasses.replace(scene.machine, components=dict(components))
    )


def describe_settings(component: Component) -> str:
    """Describe mesh and modes of a component in the words of a scene."""
    if component.fidelity == "rigid":
        return "rigid"
    if component.fidelity == "segmented":
        return f"{component.segments.count} segments"
    modes = _describe_modes(component.reduction)
    if component.fidelity == "polynomial":
        return f"polynomials{modes}"
    mesh = component.mesh
    if isinstance(component.solid, MeshFile):
        size = "mesh of the file"
    else:
        patches = (
            ""
            if mesh.across_patches == MeshSettings().across_patches
            else f", {mesh.across_patches} across patches"
        )
        rims = "" if mesh.rim_size is None else f", {1e3 * mesh.rim_size:.3g} mm at rims"
        rims += (
            "" if mesh.details is None else f", details up to {1e3 * mesh.details:.3g} mm left out"
        )
        growth = "" if mesh.growth is None else f", growth {mesh.growth:g}"
        finest = "" if mesh.sizes is None else f"{1e3 * mesh.sizes.sizes.min():.3g} to "
        size = f"{mesh.cells} {finest}{1e3 * (mesh.size or 0.0):.3g} mm{patches}{rims}{growth}"
    return f"{size}{modes}"


def _describe_modes(settings: ReductionSettings) -> str:
    """Describe the modes that are kept, after a comma; nothing where the planner chooses them."""
    if settings.modes_to_hz is not None:
        return f", modes to {settings.modes_to_hz:.3g} Hz"
    return "" if settings.modes is None else f", {settings.modes} modes"
