"""Whether a round of a search is good enough, and what is refined where it is not."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.parts.components import Component, MeshSettings
from headstock.geometry.parts.size_field import SizeField
from headstock.geometry.parts.solids import MeshFile
from headstock.pipeline.accuracy.mesh_sizes import mean_size, refine_sizes
from headstock.pipeline.accuracy.quantities import (
    Factors,
    Quantity,
    count_safely,
    list_quantities,
    weigh_estimates,
    worst_quantity,
)
from headstock.pipeline.accuracy.settings import (
    DEFAULT_RATE,
    LEAST_STEP,
    Trial,
    are_equal,
    follows_errors,
    give_sizes,
    is_chosen,
    keep_details,
    refine_mesh,
    refine_modes,
    start_component,
)
from headstock.pipeline.answers.accuracy import AccuracyRound
from headstock.pipeline.numbers.changes import Owner
from headstock.pipeline.numbers.estimates import DISCRETISATION, LEFT_OUT, show_share
from headstock.pipeline.stages.components import load_or_make_mesh
from headstock.pipeline.stages.run_state import RunState
from headstock.scene.scene import AccuracyGoal, Scene
from headstock.solvers.recovery.discretisation_error import find_resolved_step

# Share of the accuracy that the next round aims at: one that misses by little costs another one.
# Errors of coarse meshes fall less than their sizes ask for: a round ended beyond its aim by about
# this power of what the error was above the accuracy, which counts down to the least aim
AIM, FAR_POWER, LEAST_AIM = 0.75, 0.4, 0.55
ERROR_STEP = 0.9  # by which the error of an owner is thought to fall at a time
# errors fall with about the second power of the mesh size; processor time grows with its third
COST_POWER = 1.5
LEAST_SECONDS = 0.05  # of a component
LEAST_RATIO = 1e-3  # of an error, over all rounds to come


@dataclass(frozen=True)
class MeshScale:
    """How fine a mesh is.

    Attributes:
        size: Its size, or the mean where sizes follow the error [m].
        mean: Side of the cube per dof [m].
        graded: Its sizes follow the error.
    """

    size: float
    mean: float
    graded: bool

    def step_from(self, before: "MeshScale") -> float:
        """Its size over that of a mesh before; their means where only one of them follows the error, as
        sizes then tell nothing of each other.
        """
        if self.graded == before.graded:
            return self.size / before.size
        return self.mean / before.mean


@dataclass(frozen=True, eq=False)
class History:
    """What the rounds so far have taught.

    Attributes:
        trials: Of each component, its meshes so far and the largest error they owned.
        quantities: Numbers of the last round, with errors as estimated.
        scales: How fine meshes of the last round were.
        factors: By how much estimates are to be multiplied.
    """

    trials: Mapping[str, tuple[Trial, ...]] = field(default_factory=dict)
    quantities: Sequence[Quantity] = ()
    scales: Mapping[str, MeshScale] = field(default_factory=dict)
    factors: Factors = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Verdict:
    """What rank 0 makes of a round: whether the search ends, else the next scene; and what is reported
    of it.
    """

    ends: bool
    scene: Scene
    round: AccuracyRound
    failure: str = ""


def judge_round(
    scene: Scene, state: RunState, goal: AccuracyGoal, history: History
) -> tuple[Verdict, History]:
    """Whether a round is good enough, and else what is refined; and what it adds to the history.

    Args:
        scene: Of the round, with the settings of its components.
        state: What the round computed; rank 0's.
        history: What the rounds before have taught.
    """
    parts = scene.machine.components
    estimated = list_quantities(state)
    scales = {
        name: scale
        for name, part in parts.items()
        if is_chosen(part) and (scale := _find_scale(part, state)) is not None
    }
    steps = {
        name: step
        for name, scale in scales.items()
        if name in history.scales and (step := scale.step_from(history.scales[name])) < 1.0
    }
    # a mesh that hardly changed tells nothing
    apart = [name for name, step in steps.items() if step <= LEAST_STEP]
    unseen = _find_seen_steps(state, parts, apart)
    factors = weigh_estimates(history.quantities, estimated, steps, history.factors, unseen)
    quantities = count_safely(estimated, factors)
    worst = worst_quantity(quantities)
    if worst is None:
        return Verdict(
            True, scene, AccuracyRound("every number", 0.0, "no component is meshed")
        ), history
    component, source = worst.owner
    reason = f"{worst.name} may be off by {show_share(worst.error)}; {show_share(worst.parts[worst.owner])} is the {source} of {component}"
    found = AccuracyRound(
        worst.name, worst.error if np.isfinite(worst.error) else None, reason, worst.owner
    )
    trials = _remember(history.trials, parts, scales, estimated, quantities)
    learnt = History(trials, estimated, scales, factors)
    if worst.error <= goal.to or state.failures:
        # what an estimate sees part of is told by a second mesh
        owners = [
            name
            for name in parts
            if len(trials.get(name, ())) < 2
            and any(each.parts and each.owner == (name, DISCRETISATION) for each in quantities)
        ]
        single = {} if state.failures else _find_seen_steps(state, parts, owners)
        return _confirm(scene, single, found), learnt
    seconds = {
        name: LEAST_SECONDS
        + sum(
            stage.estimated_seconds or 0.0 for stage in state.plan.stages if stage.component == name
        )
        for name in parts
    }
    wanted = _wanted_ratios(quantities, goal.to, parts, seconds)
    short = [quantity for quantity in quantities if quantity.error > goal.to]
    return _refine(scene, state, goal.to, wanted, short, trials, found), learnt


def _find_seen_steps(
    state: RunState, parts: Mapping[str, Component], names: Iterable[str]
) -> dict[str, float]:
    """Of the components whose mesh recovery sees part of the error of, the size over the present one with
    which it sees all; on rank 0.
    """
    found = {}
    for name in names:
        if is_chosen(parts[name]) and follows_errors(parts[name]):
            step = find_resolved_step(load_or_make_mesh(state, state.plan.components[name])[0])
            if step < 1.0:
                found[name] = step
    return found


def _confirm(scene: Scene, steps: Mapping[str, float], found: AccuracyRound) -> Verdict:
    """The end of a search that is good enough by its estimates; or the next scene where some of them see
    part of the error, with finer meshes of these components, by the steps given.
    """
    parts = scene.machine.components
    finer = {
        other: refine_mesh(parts[other], ratio=step**DEFAULT_RATE, trials=())
        for name, step in steps.items()
        for other in parts
        if are_equal(parts[name], parts[other])
    }
    if not finer:
        return Verdict(True, scene, found)
    reason = f"single tetrahedra fill walls of {', '.join(steps)}: a finer mesh has to confirm it"
    changes = {
        name: f"{describe_settings(parts[name])} → {describe_settings(part)}: {reason}"
        for name, part in finer.items()
    }
    told = dataclasses.replace(found, reason=f"{found.reason}; {reason}", changes=changes)
    return Verdict(False, replace_components(scene, {**parts, **finer}), told)


def _find_scale(part: Component, state: RunState) -> MeshScale | None:
    """What the steps of a mesh are told by; None of a part without one."""
    if follows_errors(part):
        mean = mean_size(state.reduced[part.name])
        return MeshScale(mean, mean, graded=True)
    if part.mesh.size is None:
        return None
    return MeshScale(part.mesh.size, mean_size(state.reduced[part.name]), graded=False)


def _refine(
    scene: Scene,
    state: RunState,
    accuracy: float,
    wanted: Mapping[Owner, float],
    short: Sequence[Quantity],
    trials: Mapping[str, tuple[Trial, ...]],
    found: AccuracyRound,
) -> Verdict:
    """The next scene, in which the errors of some owners should be so many times what they are."""
    parts = scene.machine.components
    finer = dict(parts)
    sized: dict[str, SizeField] = {}
    for (name, kind), ratio in wanted.items():
        if isinstance(parts[name].solid, MeshFile) and kind == DISCRETISATION:
            return Verdict(True, scene, found, failure=f"the {kind} of {name} cannot be refined")
        if parts[name].fidelity == "polynomial" and (kind == DISCRETISATION or ratio == 0.0):
            # more degrees would pay no longer
            finer[name] = start_component(
                dataclasses.replace(finer[name], fidelity="elastic"),
                accuracy,
                finer[name].reduction.modes_to_hz,
            )
        elif kind == LEFT_OUT:
            finer[name] = keep_details(finer[name], ratio=ratio)
        elif kind == DISCRETISATION and follows_errors(parts[name]):
            if name not in sized:
                group = [other for other in parts if are_equal(parts[name], parts[other])]
                sized |= dict.fromkeys(group, refine_sizes(state, group, short, ratio))
            finer[name] = give_sizes(finer[name], sized[name])
        elif kind == DISCRETISATION:
            finer[name] = refine_mesh(finer[name], ratio=ratio, trials=trials.get(name, ()))
        else:
            cutoff, highest = state.reduced[name].superelement.cutoff_hz, _highest_found(state)
            finer[name] = refine_modes(
                finer[name], ratio=ratio, cutoff_hz=cutoff, highest_hz=highest
            )
    changes = {
        name: f"{describe_settings(scene.machine.components[name])} → {describe_settings(part)}: {found.reason}"
        for name, part in finer.items()
        if describe_settings(part) != describe_settings(scene.machine.components[name])
    }
    if not changes and found.owner is not None:
        component, source = found.owner
        return Verdict(True, scene, found, f"the {source} of {component} cannot be refined")
    return Verdict(
        False, replace_components(scene, finer), dataclasses.replace(found, changes=changes)
    )


def _wanted_ratios(
    quantities: Sequence[Quantity],
    accuracy: float,
    parts: Mapping[str, Component],
    seconds: Mapping[str, float],
) -> dict[Owner, float]:
    """By what factor the errors of owners must fall so that every number is likely to be right, at
    the least cost: always the step that takes most of the worst number for its processor time.

    What a mesh cannot reach in one step it goes on to in the next round: the others are not refined
    in its place. Equal components are refined alike, so that one superelement serves them all. Where
    a part has no bound, nobody knows how far it must fall: its factor is 0.

    Args:
        accuracy: Relative error allowed.
        seconds: What the stages of a component cost at its present settings.
    """
    groups = {
        (name, kind): tuple(
            (other, kind)
            for other in parts
            if is_chosen(parts[other]) and are_equal(parts[name], parts[other])
        )
        for quantity in quantities
        for name, kind in quantity.parts
    }
    short = [quantity for quantity in quantities if quantity.error > accuracy]
    ratios = {
        other: 0.0
        for quantity in short
        for owner, part in quantity.parts.items()
        if np.isinf(part)
        for other in groups[owner]
    }
    bounded = [quantity for quantity in short if np.isfinite(quantity.error)]
    furthest = max((quantity.error for quantity in bounded), default=accuracy)
    aim = accuracy * float(np.clip((accuracy / furthest) ** FAR_POWER, LEAST_AIM, AIM))
    while bounded:
        left = {
            quantity.key: {
                owner: ratios.get(owner, 1.0) * part for owner, part in quantity.parts.items()
            }
            for quantity in bounded
        }
        worst = max(left.values(), key=lambda parts: sum(parts.values()))
        if sum(worst.values()) <= aim:
            break

        def gain(owner: Owner, worst: Mapping[Owner, float] = worst) -> float:
            taken = sum(worst.get(other, 0.0) for other in groups[owner])
            return taken / _added_seconds(seconds[owner[0]], ratios.get(owner, 1.0))

        finer = [owner for owner in worst if groups[owner] and ratios.get(owner, 1.0) > LEAST_RATIO]
        if not finer:
            break
        best = max(finer, key=gain)
        for other in groups[best]:
            ratios[other] = ERROR_STEP * ratios.get(other, 1.0)
    return ratios


def _added_seconds(seconds: float, ratio: float) -> float:
    """What the next step costs: all of the component where it is the first, as nothing of the old
    one serves the finer one.
    """
    after = float(seconds * (ERROR_STEP * ratio) ** -COST_POWER)
    return after if ratio == 1.0 else after - float(seconds * ratio**-COST_POWER)


def _remember(
    trials: Mapping[str, tuple[Trial, ...]],
    parts: Mapping[str, Component],
    scales: Mapping[str, MeshScale],
    estimated: Sequence[Quantity],
    counted: Sequence[Quantity],
) -> dict[str, tuple[Trial, ...]]:
    """The trials with those of this round."""
    longer = dict(trials)
    for name, part in parts.items():
        equals = [other for other in parts if are_equal(part, parts[other])]
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
        known = trials.get(name, ())
        scale = scales.get(name)
        if scale is not None and largest > 0.0 and (not known or known[-1].size != scale.size):
            longer[name] = (*known, Trial(scale.size, largest, largest_counted))
    return longer


def _highest_found(state: RunState) -> float:
    return max(
        (float(modes.frequencies_hz[-1]) for modes in state.modal if len(modes.frequencies_hz)),
        default=0.0,
    )


def replace_components(scene: Scene, components: Mapping[str, Component]) -> Scene:
    """The scene with other components."""
    return dataclasses.replace(
        scene, machine=dataclasses.replace(scene.machine, components=dict(components))
    )


def describe_settings(component: Component) -> str:
    """Mesh and modes of a component in the words of a scene."""
    if component.fidelity == "rigid":
        return "rigid"
    if component.fidelity == "segmented":
        return f"{component.segments.count} segments"
    if component.fidelity == "polynomial":
        modes = component.reduction.modes_to_hz
        return "polynomials" if modes is None else f"polynomials, modes to {modes:.3g} Hz"
    mesh, settings = component.mesh, component.reduction
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
    return (
        size if settings.modes_to_hz is None else f"{size}, modes to {settings.modes_to_hz:.3g} Hz"
    )
