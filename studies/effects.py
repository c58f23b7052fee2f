"""What each effect of a scene moves and costs: answers and time of a run with it and of one without
it, compared by kind.
"""

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, NotRequired, TypedDict

import numpy as np
from mpi4py import MPI

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.pipeline.results.summary import RunSummary, summarise
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.provenance import ProvenanceSummary, SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, keep_analyses
from headstock.scene.schema.effects import EFFECT_NAMES

RIGID_HZ = 1e-2  # below it a frequency is a rigid-body mode's
# answer: unit of its numbers
UNITS = {
    "frequencies": "Hz",
    "static compliance": "µm/kN",
    "displacement under loads": "µm",
    "dynamic stiffness": "N/µm",
    "path deviation": "µm",
    "control poles": "Hz",
    "velocity lag": "µm",
    "deflection under gravity on the contour": "µm",
    "contour gap": "µm",
    "contour ripple": "µm",
    "leg forces": "N",
    "variation of leg forces": "N",
    "map of frequencies": "Hz",
}
# numbers that are each compared with themselves; of the others, components of a vector say, the
# largest of the group counts
EACH_ITS_OWN = {"frequencies", "dynamic stiffness", "control poles", "map of frequencies"}
# changes of an answer below which an effect may be left out, and from which it is to be named
LITTLE, MUCH = (
    1e-3,
    1e-2,
)
QUICK = 3.0  # a run that takes no longer is repeated, for the least of its times [s]
REPEATS = 3
# effects that act through another one
NEEDS = {
    "gravity_stiffening": "gravity",
    "regeneration": "cutting_force",
    "friction": "drive_control",
    "screw_inertia": "drive_control",
}


class ChangeSummary(TypedDict):
    """How far an answer moves, and where most: its number without the effect and with it."""

    answer: str
    share: float
    entry: str
    without: float | None
    present: float | None


@dataclass(frozen=True)
class Change:
    """How far an answer of two runs is apart.

    Attributes:
        answer: Which, of :data:`UNITS`.
        share: Largest difference of one number in either run, over that number, or over the largest
            of its group.
        entry: Where it is largest.
        without: Its number without the effect; None where that run has no such answer.
        present: Its number with it.
    """

    answer: str
    share: float
    entry: str
    without: float | None
    present: float | None

    def summarise(self) -> ChangeSummary:
        """As it stands in JSON."""
        return {
            "answer": self.answer,
            "share": self.share,
            "entry": self.entry,
            "without": self.without,
            "present": self.present,
        }


def list_answers(summary: RunSummary) -> dict[str, dict[str, FloatArray]]:
    """Answer to entry to its numbers, of what a summary holds."""
    found: dict[str, dict[str, FloatArray]] = {}
    for entry in _entries(summary):
        values = np.ravel(np.array(entry.numbers, dtype=np.float64))  # None becomes NaN
        if values.size:
            found.setdefault(entry.answer, {})[entry.where] = values
    return found


def compare_answers(without: RunSummary, present: RunSummary) -> list[Change]:
    """Every answer of two summaries, the largest difference of each."""
    before, after = list_answers(without), list_answers(present)
    changes = []
    for answer in UNITS:
        first, second = before.get(answer, {}), after.get(answer, {})
        found = [
            _compare(answer, entry, first.get(entry), second.get(entry))
            for entry in dict.fromkeys((*first, *second))
        ]
        if found:
            changes.append(max(found, key=lambda change: change.share))
    return changes


def _compare(
    answer: str, entry: str, first: FloatArray | None, second: FloatArray | None
) -> Change:
    if first is None or second is None or first.shape != second.shape:
        return Change(answer, 1.0, entry, _largest(first), _largest(second))
    sizes = np.maximum(np.abs(np.nan_to_num(first)), np.abs(np.nan_to_num(second)))
    scale = sizes if answer in EACH_ITS_OWN else np.full_like(sizes, sizes.max())
    off = np.abs(np.nan_to_num(second) - np.nan_to_num(first)) / np.where(scale > 0.0, scale, 1.0)
    place = int(np.argmax(off))
    return Change(answer, float(off[place]), entry, _number(first[place]), _number(second[place]))


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _largest(values: FloatArray | None) -> float | None:
    return (
        None
        if values is None or not np.isfinite(values).any()
        else float(values[np.nanargmax(np.abs(values))])
    )


class _Entry(NamedTuple):
    """Numbers of an answer, where they stand, None where there is none."""

    answer: str
    where: str
    numbers: Sequence[object] | FloatArray


def _entries(summary: RunSummary) -> Iterator[_Entry]:
    yield from _machine_entries(summary)
    for run in summary["path"]["feeds"] if "path" in summary else ():
        for output in run["outputs"]:
            for zone, figures in (
                ("accelerating", output["accelerating"]),
                ("decelerating", output["decelerating"]),
            ):
                if "peak_um" in figures:
                    where = f"{' '.join(output['dof'])}, {zone}, {run['name']}"
                    yield _Entry("path deviation", where, [figures["peak_um"], figures["span_um"]])
    for pose, found in summary.get("control", {}).items():
        yield _Entry(
            "control poles", f"pose {pose}", [pole["frequency_hz"] for pole in found["poles"]]
        )
        for name, drive in found["drives"].items():
            yield _Entry("velocity lag", f"drive {name} in pose {pose}", [drive["velocity_lag_um"]])
    contour = summary.get("contouring")
    if contour:
        yield _Entry(
            "deflection under gravity on the contour",
            "all faces",
            contour["gravity_deflection_um"]["maximum"],
        )
        for face in contour["faces"]:
            where = f"face {face['face']}"
            yield _Entry("contour gap", where, face["mean_um"])
            yield _Entry("contour ripple", where, face["peak_to_peak_um"])
            yield _Entry("leg forces", where, face["leg_force_mean_n"])
            yield _Entry("variation of leg forces", where, face["leg_force_peak_to_peak_n"])
    for name, values in summary["map"]["quantities"].items() if "map" in summary else ():
        if name.endswith("_hz"):
            yield _Entry("map of frequencies", name, values)


def _machine_entries(summary: RunSummary) -> Iterator[_Entry]:
    for modes in summary["modal"]:
        elastic = [hz for hz in modes["frequencies_hz"] if hz > RIGID_HZ]
        yield _Entry("frequencies", f"pose {modes['pose_name']}", elastic)
    points = summary.get("static_poses") or {"": summary["static"]}
    for pose, found in points.items():
        for name, point in found.items():
            where = f"{name} in pose {pose}" if pose else name
            yield _Entry("static compliance", where, point["compliance_um_per_kN"])
            # zeros without a load or gravity: a displacement that comes with an effect is a change
            # of all of it
            moved = np.array(point.get("displacement", [0.0] * 6)[:3], dtype=np.float64)
            yield _Entry("displacement under loads", where, 1e6 * moved)
    for pose, response in summary.get("frf", {}).items():
        for channel in response["drive_points"]:
            if channel.get("minimum_dynamic_stiffness_N_per_um") is not None:
                yield _Entry(
                    "dynamic stiffness",
                    f"{' '.join(channel['dof'])} in pose {pose}",
                    [channel["minimum_dynamic_stiffness_N_per_um"]],
                )


@dataclass(frozen=True)
class EffectTrial:
    """What an effect does.

    Attributes:
        effect: Its name.
        active: Whether the scene names it.
        changes: Of each answer, the largest first.
        seconds_with: Processor time of the run with it [s].
        seconds_without: And without it [s].
        noise: By which share runs of the same scene differ in time.
        obstacle: Why it could not be tried; empty where it was.
        together_with: Effect it acts through, on in both runs though the scene does not name it;
            empty elsewhere.
    """

    effect: str
    active: bool
    changes: tuple[Change, ...] = ()
    seconds_with: float = 0.0
    seconds_without: float = 0.0
    noise: float = 0.0
    obstacle: str = ""
    together_with: str = ""

    @property
    def largest(self) -> float:
        """Largest change of any answer."""
        return max((change.share for change in self.changes), default=0.0)

    @property
    def time_share(self) -> float:
        """Share of the run's processor time that the effect takes; zero where it is within the
        noise, or nothing moved.
        """
        share = 1.0 - self.seconds_without / self.seconds_with if self.seconds_with else 0.0
        return share if share > self.noise and self.largest > 0.0 else 0.0

    @property
    def advice(self) -> str:
        """What to do with it."""
        if self.obstacle:
            return "not tried"
        if self.largest == 0.0:
            return "moves nothing that was asked for"
        if self.largest < LITTLE:
            return "leave it out" if self.active else "rightly left out"
        if self.largest < MUCH:
            return "keep it for the third digit" if self.active else "name it for the third digit"
        return "keep it" if self.active else "name it"


def try_effects(
    choice: SceneChoice, store: Store, *, announce: Callable[[str], None] = lambda text: None
) -> Iterator[EffectTrial]:
    """Run a scene as written, then once per effect with that effect switched the other way.

    Args:
        choice: The scene.
        store: Where meshes and superelements are kept: no effect changes them, and no time of
            theirs is counted.
        announce: Called with what is run.

    Raises:
        SceneError: The scene as written has problems.
        HeadstockError: It cannot be run as written.
    """
    bench = _Bench(choice, store, announce)
    scene, written = bench.scene, bench.run((), least=2)
    for effect in EFFECT_NAMES:
        named, beside = effect in scene.effects, _missing_need(effect, scene)
        try:
            with_need = bench.run((f"effects.{beside}=true",)) if beside else written
            other = bench.run(
                (*((f"effects.{beside}=true",) if beside else ()), *_switch(effect, scene))
            )
        except SceneError as error:
            yield EffectTrial(effect, named, obstacle=error.problems[0].message)
        except HeadstockError as error:
            yield EffectTrial(effect, named, obstacle=str(error))
        else:
            without, present = (other, with_need) if named else (with_need, other)
            changes = sorted(
                compare_answers(without.summary, present.summary), key=lambda change: -change.share
            )
            noise = max(written.noise, with_need.noise, other.noise)
            yield EffectTrial(
                effect,
                named,
                tuple(changes),
                min(present.seconds),
                min(without.seconds),
                noise,
                together_with=beside,
            )


def rank_trials(trials: Sequence[EffectTrial]) -> list[EffectTrial]:
    """Those that move the answers most come first, those that were not tried last."""
    return sorted(trials, key=lambda trial: (bool(trial.obstacle), -trial.largest, trial.effect))


class TrialSummary(TypedDict):
    """What an effect moves and costs; of the time its share and by which share runs differ without
    any change.
    """

    effect: str
    active: bool
    together_with: str | None
    obstacle: str | None
    largest_change: float
    seconds_with: float
    seconds_without: float
    time_share: float
    time_noise: float
    advice: str
    changes: list[ChangeSummary]


class EffectsSummary(TypedDict):
    """Every effect of a scene, and the changes from which one matters a little or much."""

    scene: str
    small_change: float
    large_change: float
    effects: list[TrialSummary]
    provenance: NotRequired[ProvenanceSummary]


def summarise_trials(scene: str, trials: Sequence[EffectTrial]) -> EffectsSummary:
    """As JSON."""
    return {
        "scene": scene,
        "small_change": LITTLE,
        "large_change": MUCH,
        "effects": [
            {
                "effect": trial.effect,
                "active": trial.active,
                "together_with": trial.together_with or None,
                "obstacle": trial.obstacle or None,
                "largest_change": trial.largest,
                "seconds_with": trial.seconds_with,
                "seconds_without": trial.seconds_without,
                "time_share": trial.time_share,
                "time_noise": trial.noise,
                "advice": trial.advice,
                "changes": [change.summarise() for change in trial.changes],
            }
            for trial in trials
        ],
    }


def _switch(effect: str, scene: Scene) -> tuple[str, ...]:
    """Overrides that switch an effect the other way, and those that act through it off with it."""
    if effect not in scene.effects:
        return (f"effects.{effect}=true",)
    others = [name for name, needed in NEEDS.items() if needed == effect and name in scene.effects]
    return tuple(f"effects.{name}=false" for name in (effect, *others))


def _missing_need(effect: str, scene: Scene) -> str:
    """The effect that another one acts through, where the scene names neither; empty elsewhere."""
    need = NEEDS.get(effect, "")
    return "" if effect in scene.effects or need in scene.effects else need


@dataclass(frozen=True)
class _Run:
    """Answers of a scene and the processor times of its runs [s]."""

    summary: RunSummary
    seconds: list[float]

    @property
    def noise(self) -> float:
        """By which share the times differ."""
        return max(self.seconds) / min(self.seconds) - 1.0


class _Bench:
    """Runs a scene with effects switched, each choice of them once."""

    def __init__(self, choice: SceneChoice, store: Store, announce: Callable[[str], None]) -> None:
        self._choice, self._store, self._announce = choice, store, announce
        self._known: dict[tuple[str, ...], _Run] = {}
        self.scene = _load(choice, ())
        announce("as written")
        _run(self.scene, store)

    def run(self, switches: tuple[str, ...], *, least: int = 1) -> _Run:
        """A run with overrides; raises what loading and running raise."""
        if switches not in self._known:
            scene = _load(self._choice, switches)
            self._announce(" ".join(switches) or "as written")
            self._known[switches] = _run_timed(scene, self._store, least=least)
        return self._known[switches]


def _load(choice: SceneChoice, switches: tuple[str, ...]) -> Scene:
    scene = load_scene(
        choice.path, variant=choice.variant, overrides=[*choice.overrides, *switches]
    )
    return keep_analyses(scene, choice.analyses) if choice.analyses else scene


def _run_timed(scene: Scene, store: Store, *, least: int = 1) -> _Run:
    """A run, repeated where it is short."""
    summary, first = _run(scene, store)
    times = [first]
    while len(times) < (REPEATS if first < QUICK else least):
        times.append(_run(scene, store)[1])
    return _Run(summary, times)


def _run(scene: Scene, store: Store) -> tuple[RunSummary, float]:
    with tempfile.TemporaryDirectory(prefix="headstock-effects-") as folder:
        begun = time.process_time()
        results = run_scene(scene, Path(folder), comm=MPI.COMM_SELF, store=store)
        return summarise(results), time.process_time() - begun
