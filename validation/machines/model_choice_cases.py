"""Whether a stated accuracy is kept, and at what cost, over drawn machines and parts whose models
and meshes are all chosen: beside each stands the same of finite elements whose estimated error is a
fraction of what was asked, and the same with models and meshes that somebody would try by hand.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import headstock.pipeline
from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import (
    Component,
    Fidelity,
    MeshSettings,
    ReductionSettings,
)
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.components.meshing import automatic_size
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.accuracy.settings import start_component
from headstock.pipeline.answers.accuracy import AccuracyAnswer
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.results.results import Results
from headstock.pipeline.storage.content_keys import code_fingerprint
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import AccuracyGoal, Analyses, Scene
from headstock.validation.coverage.coverage_case import (
    CoverageSuite,
    keep_measured,
    measurement_key,
    run_afresh,
)
from headstock.validation.coverage.parts import draw_part
from headstock.validation.machines.drawn_machines import HIGHEST_HZ, draw_machine_scene
from headstock.validation.references.rows import ValidationRow, compare_bound

# no margin of a search was chosen on these machines
MACHINES, SMOKE_MACHINES = range(32, 52), (42,)
# one of each kind of `coverage` that differs by more than the mesh it is drawn with
PARTS = (97, *range(99, 107), 108)
ASKED = (0.05, 0.03)  # by turns
# of what was asked: how far off the true machine or part is to be by its own estimate, whose coverage
# `validate coverage` checks beside meshes that no search made, and may be where its memory [B] ends
TRUE_SHARE, DOUBTFUL_SHARE, TRUE_MEMORY = 1.0 / 3.0, 0.5, 5e9
MODES_TO = 6.0 * HIGHEST_HZ
PART_MODES = 40  # of a part, whose frequencies nobody knows before
# accuracies for which meshes by rule are tried, to their sizes over the automatic ones of STEP parts
HAND_MESHES = {0.05: 2.4, 0.01: 1.0, 0.003: 0.6}
HAND_SEGMENTS = 8
KEPT, TIMES, CHEAP = 0.95, 2.0, 0.75


@dataclass(frozen=True, eq=False)
class _ReferenceScenes:
    """What a machine or part with a stated accuracy is compared with.

    Attributes:
        truth: Numbers of finite elements that are good enough to judge by, by name.
        doubt: How far off those may be, by their own estimate.
        by_hand: What was tried by hand to its largest true error and processor time [s].
    """

    truth: dict[str, float]
    doubt: float
    by_hand: dict[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class _ChosenScene:
    """A machine or part with a stated accuracy.

    Attributes:
        asked: Relative error allowed.
        met: The search says that it is kept.
        doubt: How far off the truth may be that it was compared with.
        errors: ``(n,)`` true errors over the numbers: frequencies in their order, compliances.
        seconds: Processor time of all its stages.
        by_hand: What was tried by hand to its largest true error and processor time [s].
    """

    seed: int
    asked: float
    met: bool
    doubt: float
    errors: FloatArray
    seconds: float
    by_hand: dict[str, tuple[float, float]]


def _measure(seed: int, scene: Scene, folder: Path) -> _ChosenScene:
    """Choose the models of a machine or part, whose truth is kept on its own: how settings are searched
    changes nothing of it.
    """
    text = repr(scene.machine).replace(str(folder), "")
    models = {
        name: {
            body: (part.fidelity, part.segments.count, part.mesh, part.reduction)
            for body, part in parts.items()
        }
        for name, parts in _tried_by_hand(scene)
    }
    asked = ASKED[seed % len(ASKED)]
    key = measurement_key(text, repr(models), repr((TRUE_SHARE, TRUE_MEMORY, asked)), "names")
    reference = keep_measured(key, _ReferenceScenes, lambda: _measure_reference(scene, asked))
    return _measure_choice(seed, asked, scene, reference)


def _make_suite(load: Callable[[int, Path], Scene]) -> CoverageSuite[int, _ChosenScene]:
    def list_texts(seed: int) -> tuple[str, ...]:
        code = code_fingerprint(headstock.pipeline), Path(__file__).read_text()
        return (*code, load.__name__, str(seed))

    return CoverageSuite(
        lambda seed, scratch: _measure(seed, load(seed, scratch.folder), scratch.folder),
        _ChosenScene,
        list_texts,
        _evaluate,
    )


def _load_drawn(seed: int, folder: Path) -> Scene:
    """Return the machine of a seed, of which frequencies and compliances are asked for."""
    path = folder / "machine.toml"
    path.write_text(draw_machine_scene(seed))
    scene = load_scene(path)
    analyses = scene.analyses.drop(["frf"])
    return dataclasses.replace(scene, analyses=analyses, model_errors=False)


def _load_part(seed: int, folder: Path) -> Scene:
    """Return the part of a seed of `coverage`, held at its foot, of which six frequencies and the
    compliances of its tip are asked for.
    """
    machine = draw_part(seed, folder).machine
    return Scene(
        machine.name,
        folder / "part.toml",
        machine,
        {"reference": Pose("reference")},
        Analyses(StaticRequest(("tcp",)), ModalRequest(count=6)),
        frozenset(),
        (),
        {},
        model_errors=False,
    )


def _measure_reference(scene: Scene, asked: float) -> _ReferenceScenes:
    """Return what is true of a machine, and what somebody would try.

    Args:
        asked: Relative error that is to be judged.
    """
    parts = scene.machine.components
    fine = replace_components(
        scene, {name: dataclasses.replace(part, fidelity="elastic") for name, part in parts.items()}
    )
    goal = AccuracyGoal(TRUE_SHARE * asked, models="none")
    limits = dataclasses.replace(scene.limits, memory_bytes=TRUE_MEMORY)
    found = run_afresh(dataclasses.replace(fine, accuracy=goal, limits=limits))
    (search,) = find_answers(found.answers, AccuracyAnswer)
    truth, by_hand = _list_values(found), {}
    for name, parts in _tried_by_hand(scene):
        try:
            results = run_afresh(replace_components(scene, parts))
        except HeadstockError:  # a model that such a body cannot have
            continue
        off = float(_deviate(_list_values(results), truth).max())
        by_hand[name] = off, _cpu(results)
    return _ReferenceScenes(
        truth, np.inf if search.estimated is None else search.estimated, by_hand
    )


def _measure_choice(
    seed: int, asked: float, scene: Scene, reference: _ReferenceScenes
) -> _ChosenScene:
    """Errors and cost of a machine with a stated accuracy.

    Args:
        asked: Relative error allowed.
    """
    goal = dataclasses.replace(scene, accuracy=AccuracyGoal(asked, models="all"))
    chosen = run_afresh(goal)
    errors = _deviate(_list_values(chosen), reference.truth)
    met = not chosen.failures
    return _ChosenScene(seed, asked, met, reference.doubt, errors, _cpu(chosen), reference.by_hand)


def _tried_by_hand(scene: Scene) -> Iterator[tuple[str, dict[str, Component]]]:
    parts = scene.machine.components

    def all_as(fidelity: Fidelity) -> dict[str, Component]:
        return {
            name: dataclasses.replace(
                part,
                fidelity=fidelity,
                segments=dataclasses.replace(part.segments, count=HAND_SEGMENTS),
            )
            for name, part in parts.items()
        }

    yield "rigid", all_as("rigid")
    yield f"{HAND_SEGMENTS} segments", all_as("segmented")
    for accuracy in HAND_MESHES:
        what = f"finite elements for {100.0 * accuracy:g} %"
        yield what, _mesh_by_rule(scene, accuracy, correct=False)
        yield f"{what}, corrected", _mesh_by_rule(scene, accuracy, correct=True)


def _mesh_by_rule(scene: Scene, accuracy: float, *, correct: bool) -> dict[str, Component]:
    """Finite elements for an accuracy in place of all bodies, corrected by their estimates or not."""
    fine = {
        name: start_component(dataclasses.replace(part, fidelity="elastic"), accuracy, MODES_TO)
        for name, part in scene.machine.components.items()
    }
    fine |= {
        name: dataclasses.replace(
            part, mesh=MeshSettings(HAND_MESHES[accuracy] * automatic_size(part))
        )
        for name, part in fine.items()
        if isinstance(part.solid, StepFile)
    }
    kept = (
        ReductionSettings(modes_to_hz=MODES_TO)
        if len(fine) > 1
        else ReductionSettings(modes=PART_MODES)
    )
    own = dataclasses.replace(kept, correct_mesh=correct)
    return {name: dataclasses.replace(part, reduction=own) for name, part in fine.items()}


def _cpu(results: Results) -> float:
    return sum(record.cpu_seconds or 0.0 for record in results.stages)


def _list_values(results: Results) -> dict[str, float]:
    """Return name to value of elastic frequencies and of compliances in x, y, z."""
    rigid = {modes.pose.name: modes.below + modes.rigid_count for modes in results.modal}
    return {
        str(key): number.value
        for key, number in results.numbers.items()
        if (key.kind == "frequency" and int(key["mode"]) > rigid[str(key["pose"])])
        or (key.kind == "compliance" and key["direction"] in DIRECTIONS)
    }


def _deviate(found: Mapping[str, float], truth: Mapping[str, float]) -> FloatArray:
    """Return relative differences of all numbers; a machine of rigid bodies may have fewer."""
    return np.array([abs(found.get(name, np.inf) / exact - 1.0) for name, exact in truth.items()])


def _evaluate(what: str, scenes: Sequence[_ChosenScene]) -> list[ValidationRow]:
    certain = [scene for scene in scenes if scene.doubt <= DOUBTFUL_SHARE * scene.asked]
    met = [scene for scene in certain if scene.met]
    kept = np.concatenate([scene.errors <= scene.asked for scene in met])
    furthest = max(met, key=lambda scene: scene.errors.max() / scene.asked)
    ratios = []
    for scene in met:
        enough = [cpu for error, cpu in scene.by_hand.values() if error <= scene.asked]
        ratios.append(scene.seconds / min(enough) if enough else 0.0)
    worst = int(np.argmax(ratios))
    used = float(np.median([scene.errors.max() / scene.asked for scene in met]))
    return [
        compare_bound(
            "share of numbers that are further off than asked",
            1.0 - kept.mean(),
            1.0 - KEPT,
            f"{len(kept)} numbers of {len(met)} {what}s, {len(certain) - len(met)} more were refused,"
            f" {len(scenes) - len(certain)} have no truth that is certain enough; furthest: {what} {furthest.seed},"
            f" {100.0 * furthest.errors.max():.2g} % for {100.0 * furthest.asked:g} %; largest error over what was asked, median {used:.2f}",
        ),
        compare_bound(
            f"share of {what}s that take more than {TIMES:g} times the cheapest of what was tried",
            np.mean(np.array(ratios) > TIMES),
            1.0 - CHEAP,
            f"times the cheapest: median {np.median(ratios):.2f}, most {ratios[worst]:.2g} ({what} {met[worst].seed});"
            f" {ratios.count(0.0)} {what}s where nothing that was tried is good enough",
        ),
    ]


MACHINE_SUITE, PART_SUITE = _make_suite(_load_drawn), _make_suite(_load_part)
