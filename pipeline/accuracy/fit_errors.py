"""The stage that adds to ± what a fit to measurements leaves open of the numbers of a scene: its
parameters are moved along the independent directions of their covariance.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.pipeline.accuracy.followed import (
    FOLLOWED,
    ComparedMachine,
    Followed,
    MachineFamily,
    follow_numbers,
    list_followed,
    put_errors,
)
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.numbers.changes import compare_numbers
from headstock.pipeline.numbers.estimates import FIT, Estimate, show_share
from headstock.pipeline.numbers.numbers import Key
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.frf import prepare_response
from headstock.pipeline.stages.run_state import MachineParts, Outcome, RunState
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.files import TomlValue
from headstock.scene.scene import FitSpread, Scene
from headstock.solvers.linear.frequency_response import evaluate_frf
from headstock.solvers.ranks import SharedFailure, make_on_root

FOLLOWED_ANALYSES = ("modal", "static", "frf")


def run_fit_stage(state: RunState, stage: Stage) -> Outcome:
    """Add the changes of numbers by a fit's uncertainty to their ±; collective."""
    fit = state.scene.fit
    if fit is None:
        raise ValueError("a stage of a fit needs a scene with one")
    machines: list[MachineParts] = []
    failures: list[str] = []
    for move in fit.moves:
        try:
            machines.append(_move_machine(state, fit, move))
        except (HeadstockError, SharedFailure) as error:
            failures.append(str(error))
    return _add_errors(state, fit, machines, failures) if state.is_root else Outcome()


def _move_machine(state: RunState, fit: FitSpread, move: Mapping[str, TomlValue]) -> MachineParts:
    """Return the machine with its parameters moved; complete on rank 0."""

    def load() -> Scene:
        moved = load_scene(
            state.scene.path,
            variant=state.scene.variant,
            overrides=fit.overrides,
            values={**fit.values, **move},
        )
        # meshes and modes are those of the run, whatever chose them
        written = state.scene.machine.components
        components = {
            name: dataclasses.replace(
                part,
                mesh=written[name].mesh,
                reduction=written[name].reduction,
                fidelity=written[name].fidelity,
            )
            for name, part in moved.machine.components.items()
        }
        return dataclasses.replace(
            replace_components(moved, components),
            analyses=state.scene.analyses,
            accuracy=None,
            model_errors=False,
            interface_errors=False,
            fit=None,
        )

    other = start_run(make_on_root(state.comm, load), state.comm, state.store)
    make_superelements(other)
    return other.parts


def _add_errors(
    state: RunState, fit: FitSpread, machines: Sequence[MachineParts], failures: Sequence[str]
) -> Outcome:
    family = MachineFamily(state.parts)
    moved = [family.change(parts) for parts in machines]
    largest = 0.0
    for index, answer in enumerate(state.answers):
        if isinstance(answer, FOLLOWED):
            sizes = _find_sizes(family, moved, answer)
            values = {number.key: number.value for number in list_followed(answer)}
            known = [size / abs(values[key]) for key, size in sizes.items() if size is not None]
            largest = max([largest, *known])
            errors = {
                key: Estimate({FIT: None if failures else size}) for key, size in sizes.items()
            }
            if isinstance(answer, PoseResponse):
                answer = _spread_lines(moved, answer)
            state.answers[index] = put_errors(answer, errors, FIT, "add")
    scatter = ", ".join(f"{kind} {show_share(share)}" for kind, share in fit.scatter.items())
    requested = [request.analysis for request in state.scene.analyses.requests]
    others = ", ".join(name for name in requested if name not in FOLLOWED_ANALYSES)
    return Outcome(
        detail=f"what the fit leaves open changes numbers by up to {show_share(largest)}"
        + (f"; a measurement scatters apart from that by {scatter}" if scatter else "")
        + (f"; ± of {others} is without it" if others else ""),
        warnings=(
            *(f"what a fit leaves open of numbers is not known: {why}" for why in failures),
            *(
                f"± leaves out the fitted parameter {name}, which the measurements leave open"
                for name in fit.open
            ),
        ),
    )


def _find_sizes(
    family: MachineFamily, moved: Sequence[ComparedMachine], answer: Followed
) -> dict[Key, float | None]:
    """Return the root of the sum of squares of the changes of each number; None where one lost its
    partner.
    """
    base = list_followed(answer)
    changes = [
        compare_numbers(base, follow_numbers(answer, family.base, machine).numbers)
        for machine in moved
    ]
    return {
        number.key: None
        if any(number.key in change.lost for change in changes)
        else float(np.sqrt(sum(change.difference[number.key] ** 2 for change in changes)))
        for number in base
    }


def _spread_lines(moved: Sequence[ComparedMachine], answer: PoseResponse) -> PoseResponse:
    """Return a response with the changes of its lines in their ±."""
    curves = answer.curves
    squares = np.zeros(curves.receptance.shape)
    for machine in moved:
        prepared = prepare_response(machine.at(curves.pose))
        receptance = evaluate_frf(prepared, curves.frequencies_hz).receptance
        squares += np.abs(receptance - curves.receptance) ** 2
    error_share = {**curves.error_share, FIT: np.sqrt(squares)}
    return dataclasses.replace(answer, curves=dataclasses.replace(curves, error_share=error_share))
