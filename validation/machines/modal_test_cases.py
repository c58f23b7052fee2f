"""A modal test of the three-axis machine made by computing: 48 points in three directions, a hammer at
the tool post, noise, a sensor turned and two exchanged; what is found of it is compared with the
truth.

Source of the layout: Kono, Lorenzer, Weikert and Wegener (2010), section 4.2.
"""

import itertools
import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.io

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.solids import Box
from headstock.pipeline.stages.machine import couple_pose, damp_system
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.storage.provenance import PROJECT, SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene
from headstock.scene.test_data.records import ComplexArray
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.linear.symmetric_modes import solve_symmetric_modes
from headstock.solvers.mpi import MPI
from headstock.solvers.pairing.mode_pairing import ModePair, ModeSet, pair_modes
from headstock.solvers.second_order import SecondOrderSystem
from headstock.studies.correlation.correlation import Correlation
from headstock.studies.correlation.job import CorrelationJob, load_correlation, run_correlation
from headstock.studies.correlation.target_file import TARGETS_FILE
from headstock.studies.identification.identification import (
    FittedParameter,
    fit_parameters,
    prepare_problem,
)
from headstock.studies.identification.target_files import load_targets
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    show,
)

MACHINE = PROJECT / "machines" / "three_axis.toml"
VARIANT = "calibrated+segmented+YCE"
FORCES = [("k.z_slider_1", axis) for axis in "xyz"]  # where the hammer hits
UP_TO_HZ, LINES = 500.0, 900
FITTED_LINES = 100  # of the responses, in the last stage of the fit
FIRST_HZ = 40.0  # modes on air springs lie below
NOISE = 0.05
SPREAD = 0.15  # of the true stiffnesses about those of the scene, and of the dampings
WATCHED = 9  # modes
SEEDS = 20
# component: points on it, corners of its box
LAYOUT = {
    "base": 8, "x_slider": 8, "column_left": 6, "column_right": 6, "y_base": 8, "y_slider": 6, "z_slider": 6,
}  # fmt: skip
LEVER = 0.9  # of half the box, where a sensor stands
# springs of the machine: key of the stiffness, and damping ratio at 200 Hz of a mass on it
SPRINGS = {
    "x_pad_lateral": ("joints.x_pad", "lateral", 21.4),
    "x_pad_normal": ("joints.x_pad", "normal", 80.0),
    "x_drive": ("joints.x_drive", "axial", 77.9),
    "y_carriage_lateral": ("joints.y_carriage", "lateral", 95.4),
    "y_carriage_normal": ("joints.y_carriage", "normal", 200.0),
    "y_drive": ("joints.y_drive", "axial", 284.0),
    "z_carriage_lateral": ("joints.z_carriage", "lateral", 100.0),
    "z_drive": ("joints.z_drive", "axial", 24.2),
}
DAMPING_RATIO, DAMPING_HZ = 0.03, 200.0
KINDS = {"stiffness": 0.05, "damping": 0.15}  # the largest error of a fitted one
MAC_LIMIT = 0.99
TURNED, SWAPPED = "y_base_3", ("x_slider_2", "column_left_5")
TESTED = f"{VARIANT}+tested"
COVERAGE = Target(0.95, "-", 0.05 / 0.95, "statistics")


@dataclass(frozen=True, eq=False)
class _Trial:
    """What one test gave.

    Attributes:
        faults: What the correlation named in the faulty file.
        mac: Of the watched modes of the true machine with those of the fitted one, at the sensors.
        measured_mac: Of measured shapes, which have noise, with the fitted machine.
        truth: SI, by parameter.
    """

    faults: tuple[str, ...]
    mac: FloatArray
    measured_mac: FloatArray
    parameters: tuple[FittedParameter, ...]
    truth: dict[str, float]


def check_modal_test(seeds: int = SEEDS) -> list[ValidationRow]:
    """Eight stiffnesses and eight dampings from a modal test with 5 % noise, 20 times over."""
    with tempfile.TemporaryDirectory() as folder:
        trials = [_try_seed(Path(folder), seed) for seed in range(seeds)]
    return [*_compare_faults(trials), *_compare_fits(trials)]


def _compare_faults(trials: Sequence[_Trial]) -> list[ValidationRow]:
    """Rows on the sensor that was turned and the two that were exchanged."""
    turned = np.mean([any(TURNED in text for text in trial.faults) for trial in trials])
    swapped = np.mean([_names_both(trial.faults, SWAPPED) for trial in trials])
    others = sum(
        not any(point in text for point in (TURNED, *SWAPPED))
        for trial in trials
        for text in trial.faults
    )
    everything = Target(1.0, "-", 0.0, "identity")
    return [
        compare_value("a turned sensor is named", turned, everything),
        compare_value("two exchanged sensors are named", swapped, everything),
        compare_value(
            "sound sensors that are blamed", float(others), Target(0.0, "-", 0.0, "identity")
        ),
    ]


def _names_both(texts: Sequence[str], points: Sequence[str]) -> bool:
    return any(all(point in text for point in points) for text in texts)


def _compare_fits(trials: Sequence[_Trial]) -> list[ValidationRow]:
    """Rows on shapes, fitted numbers and their intervals."""
    errors = {kind: np.array([_read_errors(trial, kind) for trial in trials]) for kind in KINDS}
    inside = np.array([_read_coverage(trial) for trial in trials])
    count = f"{len(trials)} tests with {100.0 * NOISE:g} % noise"
    lowest, measured = (
        min(float(macs.min()) for macs in lists)
        for lists in ([t.mac for t in trials], [t.measured_mac for t in trials])
    )
    worst = f"1 - MAC of the worst of {WATCHED}"
    rows = [
        compare_bound(f"{count}: {worst} fitted modes", 1.0 - lowest, 1.0 - MAC_LIMIT),
        show(f"{count}: {worst} measured shapes, with their noise", 1.0 - measured, "-"),
    ]
    for kind, limit in KINDS.items():
        size = np.abs(errors[kind])
        rows += [
            compare_bound(f"{count}: largest error of a {kind}", size.max(), limit),
            show(
                f"{count}: root mean square of errors of a {kind}", np.sqrt((size**2).mean()), "-"
            ),
        ]
    return [
        *rows,
        compare_value(
            f"{count}: share of 95 % intervals that hold the truth", inside.mean(), COVERAGE
        ),
    ]


def _read_errors(trial: _Trial, kind: str) -> list[float]:
    return [
        item.value / trial.truth[item.parameter.name] - 1.0
        for item in trial.parameters
        if item.parameter.name.endswith(kind)
    ]


def _read_coverage(trial: _Trial) -> list[bool]:
    return [item.low <= trial.truth[item.parameter.name] <= item.high for item in trial.parameters]


def _try_seed(folder: Path, seed: int) -> _Trial:
    """Make a test, look for its faults, mend them and fit the machine."""
    scene_path = _write_scene(folder)
    random = np.random.default_rng(seed)
    truth = {
        name: spring.value * float(np.exp(SPREAD * random.standard_normal()))
        for name, spring in _list_springs().items()
    }
    store = Store(folder / "store")
    machine = load_scene(scene_path, variant=TESTED, overrides=_list_overrides(truth))
    hertz, responses = _respond(machine, store)
    responses, motions = _disturb(responses, random), _list_motions(machine)
    _write_test(folder / "faulty.mat", hertz, responses, _mix_up(motions))
    _write_test(folder / "test.mat", hertz, responses, motions)
    faulty = _correlate(scene_path, folder / "faulty.mat", store, {})
    sound = _correlate(scene_path, folder / "test.mat", store, {})
    targets = folder / "targets.toml"
    targets.write_text(_choose_parameters(sound.fit_files[TARGETS_FILE]))
    problem = prepare_problem(load_targets(targets, scene_path), store, MPI.COMM_SELF)
    fit = fit_parameters(problem, "modal test")
    measured = _correlate(scene_path, folder / "test.mat", store, fit.values)
    fitted = load_scene(scene_path, variant=TESTED, overrides=_list_overrides(fit.values))
    pairs = pair_modes(_find_modes(machine, store), _find_modes(fitted, store))
    return _Trial(faulty.faults, _list_mac(pairs), _list_mac(measured.pairs), fit.parameters, truth)


class _Spring(NamedTuple):
    """A stiffness or damping of the scene: its key, value as written, and unit."""

    key: str
    value: float
    unit: str


def _list_springs() -> dict[str, _Spring]:
    """Stiffness and damping of each spring by parameter."""
    damping = 2.0 * DAMPING_RATIO / (2.0 * np.pi * DAMPING_HZ)
    return {
        f"{name}_{kind}": _Spring(f"{joint}.{kind}.{dof}", factor * (1e6 * value), unit)
        for kind, factor, unit in (("stiffness", 1.0, "N/m"), ("damping", damping, "N s/m"))
        for name, (joint, dof, value) in SPRINGS.items()
    }


def _list_overrides(values: Mapping[str, float]) -> list[str]:
    springs = _list_springs()
    return [f'{springs[name].key}="{x!r} {springs[name].unit}"' for name, x in values.items()]


def _write_scene(folder: Path) -> Path:
    """Write the machine with its sensors and dampings."""
    scene = load_scene(MACHINE, variant=VARIANT)
    rows = ["name,component,x [mm],y [mm],z [mm]"]
    for component, count in LAYOUT.items():
        solid = scene.machine.components[component].solid
        if not isinstance(solid, Box):
            raise TypeError(f"{component} is no box")
        size = 1e3 * np.array(solid.size)
        corners = itertools.islice(
            itertools.product((-0.5, 0.5), (-0.45, 0.45), (0.05, 0.95)), count
        )
        rows += [
            ",".join(
                [f"{component}_{number}", component, *(f"{value:.9g}" for value in size * corner)]
            )
            for number, corner in enumerate(corners, 1)
        ]
    (folder / "points.csv").write_text("\n".join([*rows, ""]))
    path = folder / "machine.toml"
    damping = [
        f'"{spring.key}" = "{spring.value!r} {spring.unit}"'
        for name, spring in _list_springs().items()
        if name.endswith("damping")
    ]
    path.write_text(
        "\n".join(
            [
                MACHINE.read_text(),
                '[variants.tested]\n"effects.damping" = true\n"sensors.k" = { file = "points.csv" }',
                # one reduction for the test and for the fit
                f'"analyses.modal" = {{ up_to = "{2.0 * UP_TO_HZ:g} Hz" }}',
                *damping,
                "",
            ]
        )
    )
    return path


def _couple(scene: Scene, store: Store) -> SecondOrderSystem:
    """Return the machine with its damping."""
    state = start_run(scene, MPI.COMM_SELF, store)
    make_superelements(state)
    pose = state.plan.poses["reference"]
    return damp_system(scene, couple_pose(state.parts, pose).coupled.system)


def _list_motions(scene: Scene) -> list[tuple[str, str]]:
    return [(name, axis) for name in scene.machine.sensors for axis in "xyz"]


def _respond(scene: Scene, store: Store) -> tuple[FloatArray, ComplexArray]:
    """Return lines [Hz] and accelerances ``(l, m, f)`` [m/(s^2 N)]."""
    hertz = np.asarray(np.linspace(FIRST_HZ, UP_TO_HZ, LINES), dtype=np.float64)
    motions = _list_motions(scene)
    found = solve_frf(_couple(scene, store), hertz, inputs=FORCES, outputs=motions)
    squares = (2.0 * np.pi * hertz[:, None, None]) ** 2
    return hertz, np.asarray(-squares * found.receptance)


def _find_modes(scene: Scene, store: Store) -> ModeSet:
    """Return the watched modes without damping, at the sensors."""
    system = _couple(scene, store)
    pairs = solve_symmetric_modes(system.stiffness, system.mass, wanted=4 * WATCHED)
    hertz = np.sqrt(np.maximum(pairs.eigenvalues, 0.0)) / (2.0 * np.pi)
    kept = np.flatnonzero(hertz > FIRST_HZ)[:WATCHED]
    rows = np.array([system.outputs[channel] for channel in _list_motions(scene)])
    return ModeSet(hertz[kept], rows @ pairs.shapes[:, kept])


def _disturb(responses: ComplexArray, random: np.random.Generator) -> ComplexArray:
    """Return responses with noise of a share of the root mean square of each pair: of accelerances, as
    the sensors of the source are accelerometers.
    """
    noise = random.standard_normal((2, *responses.shape)) / np.sqrt(2.0)
    sizes = np.sqrt(np.mean(np.abs(responses) ** 2, axis=0))
    return np.asarray(responses + NOISE * sizes * (noise[0] + 1j * noise[1]))


def _mix_up(motions: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Exchange x and y of one sensor, and two sensors with each other."""
    other = {f"k.{one}": f"k.{two}" for one, two in (SWAPPED, SWAPPED[::-1])}
    turn = {"x": "y", "y": "x", "z": "z"}
    return [
        (other.get(name, name), turn[axis] if name == f"k.{TURNED}" else axis)
        for name, axis in motions
    ]


def _write_test(
    path: Path,
    hertz: FloatArray,
    responses: ComplexArray,
    motions: Sequence[tuple[str, str]],
) -> None:
    named = {
        key: np.array(
            [f"{name.removeprefix('k.')}:+{axis}" for name, axis in channels], dtype=object
        )
        for key, channels in (("outputs", motions), ("inputs", FORCES))
    }
    scipy.io.savemat(path, {"frequency": hertz, "H": responses, "unit": "m/s^2/N", **named})


def _correlate(scene: Path, test: Path, store: Store, values: Mapping[str, float]) -> Correlation:
    choice = SceneChoice(scene, TESTED, tuple(_list_overrides(values)))
    found = run_correlation(load_correlation(CorrelationJob(choice, test)), store, MPI.COMM_SELF)
    if found is None:
        raise ValueError("rank 0 correlates")
    return found


def _list_mac(pairs: Sequence[ModePair]) -> FloatArray:
    """Return MAC of the watched modes of the first set with those they are paired with."""
    best = {pair.first: float(pair.correlation) for pair in pairs}  # of clusters their spaces
    return np.array([best.get(mode, 0.0) for mode in range(WATCHED)])


def _choose_parameters(targets: str) -> str:
    """Return a target file with the eight springs as its parameters, and responses that are fitted last."""
    kept = re.sub(r"(?ms)^\[parameters\..*?(?=^\[(?!parameters)|\Z)", "", targets)
    responses = f'responses = [{{ file = "test.mat", sensors = "k", noise = true, count = {FITTED_LINES} }}]'
    lines = [kept.replace("[cases.test]\n", f"[cases.test]\n{responses}\n")]
    for name, (key, value, unit) in _list_springs().items():
        bounds = f'["{value / 5.0!r} {unit}", "{5.0 * value!r} {unit}"]'
        key = re.sub(r"(_pad|_carriage)\.", r"\1_*.", key)  # all that a fit calls by number
        lines.append(f'[parameters.{name}]\nkeys = ["{key}"]\nbounds = {bounds}\n')
    return "\n".join(lines)
