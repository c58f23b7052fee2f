"""Known stiffnesses of a small machine found again from noisy frequencies and compliances: errors,
intervals, and what data cannot see.
"""

import dataclasses
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.storage.store import Store
from headstock.scene.reading.units import DIMENSIONS, parse_quantity
from headstock.solvers.mpi import MPI
from headstock.studies.identification.identification import (
    Identification,
    fit_parameters,
    prepare_problem,
)
from headstock.studies.identification.problem import FitPoint, FitProblem, evaluate
from headstock.studies.identification.target_files import load_targets
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    show,
)

SCENE = Path(__file__).with_name("known_stiffnesses.toml").read_text()
STIFFNESSES = {
    "guide_normal": ("joints.guide_*.stiffness.normal", 70.0, "N/um"),
    "guide_lateral": ("joints.guide_*.stiffness.lateral", 55.0, "N/um"),
    "drive": ("joints.drive.stiffness.axial", 90.0, "N/um"),
    "feet_x": ("joints.feet.stiffness.x", 120.0, "N/um"),
    "feet_y": ("joints.feet.stiffness.y", 75.0, "N/um"),
    "feet_z": ("joints.feet.stiffness.z", 170.0, "N/um"),
    "feet_rx": ("joints.feet.stiffness.rx", 14e6, "N m/rad"),
    "feet_ry": ("joints.feet.stiffness.ry", 31e6, "N m/rad"),
}
MEASURED = {
    "middle": ("stiff", "middle"), "out": ("stiff", "out"), "back": ("stiff", "back"),
    "column_middle": (None, "middle"), "column_back": (None, "back"),
}  # fmt: skip
FREQUENCIES = 12
SPRINGS_ALONG = (
    "two springs side by side: cosine of the unidentifiable direction with a constant sum"
)
PLACE_SHARE = "a place that hardly matters: its part in an unidentifiable direction"
SEEDS = 50
NOISE = 0.01
ERROR_LIMIT = 0.05
COVERAGE = Target(0.95, "-", 0.05 / 0.95, "statistics")
# two springs side by side and one that carries next to nothing
SUM = 170.0 + 60.0  # N/um, of the feet in truth and of the pad as written
UNIDENTIFIABLE = """
[parameters.feet_z]
keys = ["joints.feet.stiffness.z"]
bounds = ["20 N/um", "900 N/um"]
prior_sigma = 0.5
[parameters.pad_z]
keys = ["joints.pad.stiffness.z"]
bounds = ["10 N/um", "900 N/um"]
prior = "110 N/um"
prior_sigma = 0.5
[parameters.bolt_height]
keys = ["joints.guide_1.at[2]"]
bounds = ["700 mm", "720 mm"]
prior_sigma = 0.002
"""


def _write_parameters(names: Mapping[str, float] | None = None) -> str:
    """Write the eight stiffnesses as parameters of a target file, or those named."""
    chosen = STIFFNESSES if names is None else {name: STIFFNESSES[name] for name in names}
    return "".join(
        f'[parameters.{name}]\nkeys = ["{key}"]\nbounds = ["{true / 10:g} {unit}", "{true * 10:g} {unit}"]\n'
        for name, (key, true, unit) in chosen.items()
    )


def _write_frequencies(values_hz: FloatArray) -> str:
    """Frequencies as a target file writes them."""
    return "[" + ", ".join(f'"{value:.15g} Hz"' for value in values_hz) + "]"


def _prepare_text(folder: Path, targets: str, machine: str = SCENE) -> FitProblem:
    """Prepare a machine and the text of a target file, written into a folder and ready to be
    computed.
    """
    scene, path = folder / "machine.toml", folder / "targets.toml"
    scene.write_text(machine)
    path.write_text(targets)
    return prepare_problem(load_targets(path, scene), Store(folder / "store"), MPI.COMM_SELF)


def _solve_truth(problem: FitProblem, truth: Mapping[str, float]) -> FitPoint:
    """Solve the machine with true values, SI, by parameter."""
    return evaluate(
        problem, problem.coordinates([truth[parameter.name] for parameter in problem.parameters])
    )


def _true_values() -> dict[str, float]:
    """True stiffnesses, SI."""
    return {
        name: parse_quantity(f"{value!r} {unit}", *DIMENSIONS).value
        for name, (_, value, unit) in STIFFNESSES.items()
    }


def _solve_measured(folder: Path) -> FitPoint:
    """Solve the machine with its true stiffnesses in every case that is measured."""
    blank = _write_cases(
        [np.asarray(np.arange(10.0, 10.0 + FREQUENCIES))] * len(MEASURED),
        [np.full(3, 1e-9)] * len(MEASURED),
    )
    return _solve_truth(_prepare_text(folder, blank + _write_parameters()), _true_values())


def _write_measured(truth: FitPoint, seed: int, noise: float) -> str:
    """Cases of a target file with relative noise on every frequency and compliance.

    Args:
        truth: From ``_solve_measured``.
        noise: Standard deviation, relative.
    """
    rng = np.random.default_rng(seed)
    frequencies = [
        _disturb(state.frequencies_hz[:FREQUENCIES], noise, rng) for state in truth.states
    ]
    compliances = [_disturb(state.compliances, noise, rng) for state in truth.states]
    return _write_cases(frequencies, compliances)


def _disturb(values: FloatArray, noise: float, rng: np.random.Generator) -> FloatArray:
    return values * np.exp(noise * rng.standard_normal(len(values)))


def _write_cases(frequencies_hz: Sequence[FloatArray], compliances: Sequence[FloatArray]) -> str:
    """Cases with frequencies [Hz] and compliances at the tool in x, y, z [m/N]."""
    text = ""
    for (name, (variant, pose)), frequencies, values in zip(
        MEASURED.items(), frequencies_hz, compliances, strict=True
    ):
        entries = ", ".join(
            f'{{ point = "tcp", motion = "{axis}", force = "{axis}", value = "{1e9 * value!r} um/kN" }}'
            for axis, value in zip("xyz", map(float, values), strict=True)
        )
        head = f'[cases.{name}]\npose = "{pose}"\n' + (
            f'variant = "{variant}"\n' if variant else ""
        )
        text += (
            f"{head}frequencies = {_write_frequencies(frequencies)}\ncompliances = [{entries}]\n"
        )
    return text


def check_identification(comm: MPI.Comm) -> list[ValidationRow]:
    """Eight stiffnesses from 60 frequencies and 15 compliances with 1 % noise, 50 times over."""
    if comm.rank > 0:
        return []
    with tempfile.TemporaryDirectory() as name:
        return [*_evaluate_seeds(Path(name), range(SEEDS)), *_evaluate_blindness(Path(name))]


def _evaluate_seeds(folder: Path, seeds: Sequence[int]) -> list[ValidationRow]:
    """Errors and intervals over noise seeds."""
    errors, inside, evaluations, noise = [], [], 0, []
    for found in _fit_seeds(folder, seeds):
        truth = _true_values()
        errors.append([item.value / truth[item.parameter.name] - 1.0 for item in found.parameters])
        inside.append(
            [item.low <= truth[item.parameter.name] <= item.high for item in found.parameters]
        )
        evaluations += sum(record.evaluations for record in found.starts)
        noise.append(found.statistics.noise.factor or 0.0)
    size = np.abs(np.array(errors))
    covered = np.array(inside, dtype=float)
    count = f"{size.shape[1]} stiffnesses, {len(size)} seeds"
    return [
        compare_bound(f"{count}: largest error", size.max(), ERROR_LIMIT, "1 % noise"),
        show(f"{count}: root mean square of the errors", np.sqrt((size**2).mean()), "-"),
        compare_value(
            f"{count}: share of 95 % intervals that hold the truth",
            covered.mean(),
            COVERAGE,
            "at least 0.90",
        ),
        compare_value(
            f"{count}: the same for the parameter that fares worst",
            covered.mean(axis=0).min(),
            COVERAGE,
        ),
        compare_value(
            "noise found over noise put in, mean", np.mean(noise), Target(1.0, "-", 0.1, "identity")
        ),
        show("evaluations of the machine per fit", evaluations / len(size), "-"),
    ]


def _fit_seeds(folder: Path, seeds: Sequence[int]) -> list[Identification]:
    """Fit the eight stiffnesses to data with the noise of each seed; components are
    reduced once.
    """
    truth = _solve_measured(folder)
    problem = _prepare_text(folder, _write_measured(truth, 0, NOISE) + _write_parameters())
    return [
        fit_parameters(
            _with_data(folder, problem, _write_measured(truth, seed, NOISE)), f"seed {seed}"
        )
        for seed in seeds
    ]


def _evaluate_blindness(folder: Path) -> list[ValidationRow]:
    """Two springs of which only the sum is felt, and a place that hardly matters: both are
    named.
    """
    others = {name: value for name, value in _true_values().items() if name != "feet_z"}
    text = (
        _write_measured(_solve_measured(folder), 0, NOISE)
        + _write_parameters(others)
        + UNIDENTIFIABLE
    )
    found = fit_parameters(_prepare_text(folder, text), "blind")
    unidentifiable = {
        name: abs(share)
        for direction in found.statistics.unidentifiable
        for name, share in direction.entries[:1]
    }
    names = [item.parameter.name for item in found.parameters]
    springs = next(
        dict(direction.entries)
        for direction in found.statistics.unidentifiable
        if "pad_z" in dict(direction.entries)
    )
    stiffness = {
        name: found.values[name] * (1.0 if name == "feet_z" else -1.0)
        for name in ("feet_z", "pad_z")
    }
    # in logarithms the sum stays when d(ln a) : d(ln b) = 1 / a : -1 / b
    expected = np.array([1.0 / stiffness["feet_z"], 1.0 / stiffness["pad_z"]])
    direction = np.array([springs.get("feet_z", 0.0), springs.get("pad_z", 0.0)])
    along = abs(expected @ direction) / float(np.linalg.norm(expected) * np.linalg.norm(direction))
    total = sum(abs(value) for value in stiffness.values())
    seen = {name: float(found.parameters[names.index(name)].data_share) for name in names}
    return [
        compare_value(SPRINGS_ALONG, along, Target(1.0, "-", 1e-2, "closed form")),
        compare_value(
            "two springs side by side: sum", total / 1e6, Target(SUM, "N/um", 0.05, "identity")
        ),
        compare_bound(
            "a place that hardly matters: share the data see",
            seen["bolt_height"],
            0.5,
            "named as unidentifiable",
        ),
        compare_value(
            PLACE_SHARE, unidentifiable.get("bolt_height", 0.0), Target(1.0, "-", 0.05, "identity")
        ),
    ]


def _with_data(folder: Path, problem: FitProblem, cases: str) -> FitProblem:
    """Return the same problem with other data."""
    path = folder / "targets.toml"
    path.write_text(cases + _write_parameters())
    task = load_targets(path, folder / "machine.toml").task
    models = [
        dataclasses.replace(model, case=case)
        for model, case in zip(problem.cases, task.cases, strict=True)
    ]
    return dataclasses.replace(problem, cases=tuple(models))
