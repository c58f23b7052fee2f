"""Whether ± of peaks and static levels of frequency responses covers the truth, and whether an
accuracy that is asked for holds for them: the three-axis machine and two drawn ones beside fine
meshes.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.accuracy.settings import start_component
from headstock.pipeline.answers.accuracy import AccuracyAnswer
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.numbers.numbers import Key, Number
from headstock.pipeline.planning.analyses import FRF_MARGIN
from headstock.pipeline.results.results import Results
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import AccuracyGoal, Scene
from headstock.validation.coverage.coverage_case import CoverageCase, Scratch, open_scratch
from headstock.validation.machines.axis_kit_cases import SCENE
from headstock.validation.machines.drawn_machines import draw_machine_scene
from headstock.validation.references.rows import ValidationRow, compare_bound, show

Load = Callable[[Scratch], Scene]
SEEDS, SMOKE_SEED = (1, 2), 2
ASKED = 0.03
TRUE_ACCURACY = 0.002  # with which the meshes of the true machine begin
CLEAR, LARGEST_MEDIAN = 1e-3, 3.0


def check_peaks() -> list[ValidationRow]:
    """Check the three-axis machine and two drawn ones."""
    drawn = {f"machine {seed}": functools.partial(_load_drawn, seed) for seed in SEEDS}
    loads: dict[str, Load] = {"three-axis machine": _load_three_axis, **drawn}
    return [row for what, load in loads.items() for row in _compare(what, load, searched=True)]


def check_peaks_smoke() -> Iterator[ValidationRow]:
    """± alone, of one drawn machine."""
    load = functools.partial(_load_drawn, SMOKE_SEED)
    return _compare(f"machine {SMOKE_SEED}", load, searched=False)


def _load_three_axis(_scratch: Scratch) -> Scene:
    """Return the machine of the reference study with a response at its tool."""
    return load_scene(SCENE, variant="frf")


def _load_drawn(seed: int, scratch: Scratch) -> Scene:
    """Return the machine of a seed, all bodies of which are finite elements."""
    scene = scratch.load(draw_machine_scene(seed))
    bodies = {
        name: dataclasses.replace(part, fidelity="elastic")
        for name, part in scene.machine.components.items()
    }
    return replace_components(dataclasses.replace(scene, model_errors=False), bodies)


def _compare(what: str, load: Load, *, searched: bool) -> Iterator[ValidationRow]:
    with open_scratch() as scratch:
        scene = load(scratch)
        truth = _list_heights(scratch.run(_refine(scene)))
        true, estimated = _pair(_list_heights(scratch.run(scene)), truth)
        note = f"{len(true)} peaks and levels, up to {true.max():.2g} off"
        yield from CoverageCase(CLEAR, LARGEST_MEDIAN).evaluate(what, true, estimated, note)
        if searched:
            found = scratch.run(dataclasses.replace(scene, accuracy=AccuracyGoal(ASKED)))
            yield from _evaluate_search(what, found, truth)


def _refine(scene: Scene) -> Scene:
    frf = scene.analyses.get(FrfRequest)
    if frf is None:
        raise ValueError("peaks are those of a frequency response")
    fine = {
        name: start_component(part, TRUE_ACCURACY, FRF_MARGIN * frf.to_hz)
        if part.fidelity == "elastic"
        else part
        for name, part in scene.machine.components.items()
    }
    return replace_components(scene, fine)


def _list_heights(results: Results) -> dict[Key, Number]:
    return {
        number.key: number
        for response in find_answers(results.answers, PoseResponse)
        for number in response.list_heights()
    }


def _pair(
    found: Mapping[Key, Number], truth: Mapping[Key, Number]
) -> tuple[FloatArray, FloatArray]:
    """Return true and estimated relative errors ``(n,)`` of the numbers of both; infinite where nobody
    knows.
    """
    shared = [key for key in found if key in truth]
    true = [abs(found[key].value / truth[key].value - 1.0) for key in shared]
    errors = [found[key].error for key in shared]
    sizes = [np.inf if error is None or error.total is None else error.total for error in errors]
    return np.array(true), np.array(sizes) / np.array([found[key].value for key in shared])


def _evaluate_search(
    what: str, results: Results, truth: Mapping[Key, Number]
) -> list[ValidationRow]:
    (answer,) = find_answers(results.answers, AccuracyAnswer)
    true, _ = _pair(_list_heights(results), truth)
    said = answer.responses is not None and answer.responses.met
    seconds = sum(record.cpu_seconds for record in results.stages)
    return [
        compare_bound(
            f"{what}: largest true error of a peak or level, {100.0 * ASKED:g} % asked",
            true.max(),
            ASKED,
            "said to be met" if said else "said not to be met",
        ),
        show(f"{what}: processor time of the search", seconds, "s"),
    ]
