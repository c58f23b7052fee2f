"""Whether a stated accuracy is kept, and at what cost, over drawn machines whose bodies' models and
meshes are all chosen: beside each stands the same machine of fine finite elements, and the same
with models and meshes that somebody would try by hand.
"""

import dataclasses
import hashlib
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

import headstock.geometry
import headstock.meshing
import headstock.pipeline
import headstock.reduction
import headstock.solvers
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Fidelity
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.accuracy.settings import start_component
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.content_keys import code_fingerprint
from headstock.pipeline.storage.store import Store, default_store_root, read_entry, write_entry
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import AccuracyGoal, Scene
from headstock.validation.machines.drawn_machines import HIGHEST_HZ, draw_machine
from headstock.validation.references.rows import ValidationRow, judge_bound

CASE, SMOKE = "model-choice", "model-choice-smoke"
# no margin of a search was chosen on these machines
MACHINES, SMOKE_MACHINES = range(32, 52), (42,)
ASKED = (0.05, 0.03)  # by turns
TRUE_ACCURACY = 0.005  # with which the meshes of the true machine begin
MODES_TO = 6.0 * HIGHEST_HZ
HAND_MESHES = (0.05, 0.01)
HAND_SEGMENTS = 8
KEPT, TIMES, CHEAP = 0.95, 2.0, 0.75


@dataclass(frozen=True, eq=False)
class ChosenMachine:
    """A machine with a stated accuracy.

    Attributes:
        seed: Of the machine.
        asked: Relative error allowed.
        met: The search says that it is kept.
        errors: ``(n,)`` true errors over the numbers: frequencies in their order, compliances.
        seconds: Processor time of all its stages.
        by_hand: What was tried by hand to its largest true error and processor time [s].
    """

    seed: int
    asked: float
    met: bool
    errors: FloatArray
    seconds: float
    by_hand: dict[str, tuple[float, float]]


def check_model_choice() -> list[ValidationRow]:
    """Whether the errors of the machines are within what was asked, and what that costs."""
    return _judge(CASE, [_recall(seed) for seed in MACHINES])


def check_model_choice_smoke() -> list[ValidationRow]:
    """The same on one machine of three bodies."""
    return _judge(SMOKE, [_recall(seed) for seed in SMOKE_MACHINES])


def _recall(seed: int) -> ChosenMachine:
    """A machine from the store where it is there: what was stopped goes on."""
    store = Store(default_store_root())
    layers = (
        headstock.geometry,
        headstock.meshing,
        headstock.solvers,
        headstock.reduction,
        headstock.pipeline,
    )
    words = [
        *(code_fingerprint(layer) for layer in layers),
        Path(__file__).read_text(),
        draw_machine(seed),
    ]
    key = hashlib.sha256("\0".join(words).encode()).hexdigest()
    known = read_entry(store, key, ChosenMachine).value
    if known is not None:
        return known
    with tempfile.TemporaryDirectory(prefix="headstock-choice-") as folder:
        found = measure_choice(seed, ASKED[seed % len(ASKED)], Path(folder))
    write_entry(store, key, found)
    return found


def measure_choice(seed: int, asked: float, folder: Path) -> ChosenMachine:
    """Errors and cost of a machine with a stated accuracy.

    Args:
        seed: Of the machine.
        asked: Relative error allowed.
        folder: For its files.
    """
    path = folder / "machine.toml"
    path.write_text(draw_machine(seed))
    drawn = load_scene(path)
    analyses = dataclasses.replace(drawn.analyses, frf=None)
    scene = dataclasses.replace(drawn, analyses=analyses, model_errors=False)
    truth = _run(_with_parts(scene, _fine(scene, TRUE_ACCURACY)), folder)
    goal = dataclasses.replace(scene, accuracy=AccuracyGoal(asked, models="all"))
    chosen = _run(goal, folder)
    by_hand = {}
    for name, parts in _tried_by_hand(scene):
        tried = _run(_with_parts(scene, parts), folder)
        by_hand[name] = float(_deviate(tried, truth).max()), _cpu(tried)
    return ChosenMachine(
        seed, asked, not chosen.failures, _deviate(chosen, truth), _cpu(chosen), by_hand
    )


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
        yield f"finite elements for {100.0 * accuracy:g} %", _fine(scene, accuracy)


def _fine(scene: Scene, accuracy: float) -> dict[str, Component]:
    """Finite elements for an accuracy in place of all bodies."""
    return {
        name: start_component(dataclasses.replace(part, fidelity="elastic"), accuracy, MODES_TO)
        for name, part in scene.machine.components.items()
    }


def _with_parts(scene: Scene, parts: Mapping[str, Component]) -> Scene:
    return replace_components(scene, parts)


def _run(scene: Scene, folder: Path) -> Results:
    """All stages with an empty store."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        return run_scene(
            scene, Path(place) / "out", comm=MPI.COMM_SELF, store=Store(Path(place) / "store")
        )


def _cpu(results: Results) -> float:
    return sum(record.cpu_seconds or 0.0 for record in results.stages)


def _deviate(results: Results, truth: Results) -> FloatArray:
    """Relative differences of frequencies, each beside that of the same place in order, and of
    compliances.
    """
    pairs = []
    for modes, exact in zip(results.modal, truth.modal, strict=True):
        elastic = slice(exact.rigid_count, None)
        # a rigid machine may have fewer modes
        lacking = len(exact.frequencies_hz) - len(modes.frequencies_hz)
        found = np.append(modes.frequencies_hz, np.full(lacking, np.inf))
        pairs.append((found[elastic], exact.frequencies_hz[elastic]))
    for pose, points in truth.static.items():
        for name, point in points.items():
            own = results.static[pose][name].compliance
            pairs.append((np.diag(own)[:3], np.diag(point.compliance)[:3]))
    return np.concatenate([np.abs(numbers / exact - 1.0) for numbers, exact in pairs])


def _judge(case: str, machines: list[ChosenMachine]) -> list[ValidationRow]:
    met = [machine for machine in machines if machine.met]
    kept = np.concatenate([machine.errors <= machine.asked for machine in met])
    furthest = max(met, key=lambda machine: machine.errors.max() / machine.asked)
    ratios = []
    for machine in met:
        enough = [cpu for error, cpu in machine.by_hand.values() if error <= machine.asked]
        ratios.append(machine.seconds / min(enough) if enough else 0.0)
    worst = int(np.argmax(ratios))
    used = float(np.median([machine.errors.max() / machine.asked for machine in met]))
    return [
        judge_bound(
            case,
            "share of numbers that are further off than asked",
            float(1.0 - kept.mean()),
            1.0 - KEPT,
            f"{len(kept)} numbers of {len(met)} machines, {len(machines) - len(met)} more were refused; furthest: machine {furthest.seed},"
            f" {100.0 * furthest.errors.max():.2g} % for {100.0 * furthest.asked:g} %; largest error over what was asked, median {used:.2f}",
        ),
        judge_bound(
            case,
            f"share of machines that take more than {TIMES:g} times the cheapest of what was tried",
            float(np.mean(np.array(ratios) > TIMES)),
            1.0 - CHEAP,
            f"times the cheapest: median {np.median(ratios):.2f}, most {ratios[worst]:.2g} (machine {met[worst].seed});"
            f" {ratios.count(0.0)} machines where nothing that was tried is good enough",
        ),
    ]
