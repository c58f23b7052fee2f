"""Whether the part ``model`` of ± covers what rigid and segmented bodies leave out, over drawn
machines: beside each stands the same machine of fine finite elements.
"""

import dataclasses
import hashlib
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import headstock.geometry
import headstock.meshing
import headstock.pipeline
import headstock.reduction
import headstock.solvers
from headstock.geometry.frames import FloatArray
from headstock.pipeline.accuracy.followed import list_followed
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.accuracy.settings import start_component
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.runner import find_handler
from headstock.pipeline.stages.frf import estimate_response_errors, prepare_response
from headstock.pipeline.stages.machine import CoupledPose, couple_pose
from headstock.pipeline.stages.run_state import RunState, run_stage
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.storage.content_keys import code_fingerprint
from headstock.pipeline.storage.store import Store, default_store_root, read_entry, write_entry
from headstock.reduction.estimates.model_errors import WatchedModes, compare_modes, watch_modes
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, place_motion
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene
from headstock.solvers.linear.frequency_response import evaluate_frf
from headstock.solvers.mpi import MPI
from headstock.validation.machines.drawn_machines import HIGHEST_HZ, draw_machine
from headstock.validation.references.rows import ValidationRow, judge_bound, show

CASE, SMOKE = "model-estimates", "model-estimates-smoke"
# the margins of the stage were chosen on the first machines; the others were drawn for the held-out
# judgement
CALIBRATION, HOLD_OUT = range(8), range(8, 32)
FRESH = 52  # first seed of no machine above, nor of `model-choice`
SMOKE_MACHINES = (0,)
TRUE_ACCURACY = 0.002  # with which the meshes of the true machine begin
TRUE_MODES_TO = 12.0 * HIGHEST_HZ
# the error of a true machine is known within this share of its estimate (see coverage/cases.py)
UNSURE, SURE = 0.5, 0.1
COVERED, COVERED_RESPONSES, LARGEST_MEDIAN = 0.95, 0.9, 3.0
CLEAR = 1e-3  # true errors above which a ratio means something
VISIBLE = 1e-2  # 40 dB below the highest peak
JUDGED_LINES = 0.5  # of the visible ones


@dataclass(frozen=True, eq=False)
class MachineNumbers:
    """Numbers of a machine of rigid and segmented bodies beside those of fine finite elements.

    Attributes:
        compliances: ``(n,)`` 1 for compliances, 0 for frequencies.
        errors: ``(n,)`` true errors over the number; NaN for modes without a partner of their
            shape.
        estimates: ``(n,)`` what stands behind ±, over the number; NaN for ``± ?``.
        unsure: ``(n,)`` how well the truth is known, over the number.
        lines: ``(m,)`` per frequency response the share of its visible lines that is covered, of
            those whose truth is sure enough; NaN where that are too few.
        named: Missing modes that the run names and the true machine has, and all that it has.
    """

    seed: int
    compliances: FloatArray
    errors: FloatArray
    estimates: FloatArray
    unsure: FloatArray
    lines: FloatArray
    named: tuple[int, int]


def compare_machine(seed: int) -> MachineNumbers:
    """Return the numbers of a seed, from the store where they are there: what was stopped goes on."""
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
    known = read_entry(store, key, MachineNumbers).value
    if known is not None:
        return known
    with tempfile.TemporaryDirectory(prefix="headstock-models-") as folder:
        path = Path(folder) / "machine.toml"
        path.write_text(draw_machine(seed))
        found = measure_machine(seed, load_scene(path), Store(Path(folder) / "store"))
    write_entry(store, key, found)
    return found


def measure_machine(seed: int, scene: Scene, store: Store) -> MachineNumbers:
    """Errors and estimates of a machine of rigid and segmented bodies.

    Args:
        scene: With ``model_errors``, and statics, modes and a frequency response.
    """
    plain = _solve(scene, store)
    fine = {
        name: start_component(
            dataclasses.replace(part, fidelity="elastic"), TRUE_ACCURACY, TRUE_MODES_TO
        )
        for name, part in scene.machine.components.items()
    }
    true = _solve(replace_components(dataclasses.replace(scene, model_errors=False), fine), store)
    (pose,) = plain.plan.poses.values()
    machines = couple_pose(plain.parts, pose), couple_pose(true.parts, pose)
    rows, named = _compare_modes(plain, true, machines)
    rows += _compare_compliances(plain, true)
    table = np.array(rows).T
    lines = _cover_lines(plain, machines[1])
    return MachineNumbers(seed, table[0], table[1], table[2], table[3], lines, named)


def _solve(scene: Scene, store: Store) -> RunState:
    """Run all stages of a scene but that which writes."""
    state = start_run(scene, MPI.COMM_SELF, store)
    make_superelements(state)
    for stage in state.plan.stages[:-1]:
        if stage.component is None:
            run_stage(state, stage, find_handler(stage.kind))
    return state


def _compare_modes(
    plain: RunState, true: RunState, machines: tuple[CoupledPose, CoupledPose]
) -> tuple[list[list[float]], tuple[int, int]]:
    """Rows of frequencies, and how many missing modes are named of all."""
    (modes,) = plain.modal
    count = len(modes.frequencies_hz)
    places = {name: choose_places(part) for name, part in plain.parts.superelements.items()}
    watched = [_watch(machine, places, count) for machine in machines]
    found = compare_modes(*watched, count=count)
    estimates = machines[1].estimate_mode_errors(watched[1].modes)
    rows = []
    for index in range(modes.rigid_count, count):
        hz, error = float(modes.frequencies_hz[index]), modes.list_errors()[index].total
        estimate = np.nan if error is None else error / hz
        partner = found.partners[index]
        if partner < 0:
            rows.append([0.0, np.nan, estimate, 0.0])
            continue
        left = _expected_error(true, estimates[partner])
        right = float(watched[1].modes.frequencies_hz[partner]) - left
        rows.append([0.0, abs(hz - right) / hz, estimate, UNSURE * left / hz])
    words = " ".join(warning for warning in plain.warnings if "lacks" in warning)
    named = words.count(" Hz (")
    return rows, (min(named, len(found.missing)), len(found.missing))


def _watch(machine: CoupledPose, places: dict[str, BodyPlaces], count: int) -> WatchedModes:
    elements = machine.coupled.layout.superelements
    motions = {name: place_motion(elements[name], each.points) for name, each in places.items()}
    return watch_modes(machine.coupled, places, motions, count=count)


def _expected_error(state: RunState, error: Estimate) -> float:
    """Return what the estimate says without what covers its doubt."""
    meshes = sum(
        size / state.reduced[name].superelement.errors.mesh_safety
        for name, size in error.parts.get(DISCRETISATION, {}).items()
    )
    return meshes + 0.5 * (error.shares.get(REDUCTION) or 0.0)


def _compare_compliances(plain: RunState, true: RunState) -> list[list[float]]:
    rows = []
    (found,), (exact,) = plain.static, true.static
    right_numbers = exact.numbers
    for number in list_followed(found):
        if number.error is not None:
            value, there = number.value, right_numbers[number.key]
            left = _expected_error(true, there.error or Estimate())
            right = there.value + left
            estimate = np.nan if number.error.total is None else number.error.total / value
            rows.append([1.0, abs(value - right) / value, estimate, UNSURE * left / value])
    return rows


def _cover_lines(plain: RunState, true: CoupledPose) -> FloatArray:
    """Share of the visible and sure lines whose error is covered, along each load."""
    (answer,) = find_answers(plain.answers, PoseResponse)
    curves = answer.curves
    prepared = prepare_response(true)
    response = evaluate_frf(prepared, curves.frequencies_hz)
    sizes = estimate_response_errors(
        true.parts, prepared.direct.system, true.coupled, true.all_modes, response
    ).shares
    doubt = UNSURE * np.sum(list(sizes.values()), axis=0)
    total = curves.error
    if total is None:
        return np.zeros(0)
    shares = []
    for index in range(len(curves.inputs)):
        right, own = response.receptance[:, index, index], curves.receptance[:, index, index]
        visible = np.abs(right) >= VISIBLE * np.abs(right).max()
        judged = visible & (doubt[:, index, index] <= SURE * total[:, index, index])
        covered = judged & (np.abs(own - right) <= total[:, index, index])
        enough = judged.sum() >= JUDGED_LINES * visible.sum()
        shares.append(covered.sum() / judged.sum() if enough else np.nan)
    return np.array(shares)


def check_model_estimates() -> list[ValidationRow]:
    """Coverage on the machines that margins were chosen on, and on the others."""
    return [
        *_judge(CASE, "chosen on", [compare_machine(seed) for seed in CALIBRATION]),
        *_judge(CASE, "held out", [compare_machine(seed) for seed in HOLD_OUT]),
    ]


def compare_new_machines(first: int) -> list[ValidationRow]:
    """Coverage on machines that nothing was chosen on or judged with before.

    Args:
        first: Seed of the first of them, ``FRESH`` at least.
    """
    seeds = range(first, first + len(HOLD_OUT))
    machines = [compare_machine(seed) for seed in seeds]
    return _judge(CASE, f"new, seeds {seeds[0]} to {seeds[-1]}", machines)


def check_model_estimates_smoke() -> list[ValidationRow]:
    """Check one machine of three bodies in the same way."""
    return _judge(SMOKE, "one machine", [compare_machine(seed) for seed in SMOKE_MACHINES])


def _judge(case: str, what: str, machines: Sequence[MachineNumbers]) -> list[ValidationRow]:
    known = [_known(machine) for machine in machines]
    given = np.concatenate([m.estimates[own] for m, own in zip(machines, known, strict=True)])
    true = np.concatenate([m.errors[own] for m, own in zip(machines, known, strict=True)])
    kinds = np.concatenate([m.compliances[own] for m, own in zip(machines, known, strict=True)])
    numbers = sum(len(machine.errors) for machine in machines)
    silent = sum(int(np.isnan(machine.estimates).sum()) for machine in machines)
    alone = sum(
        int((np.isnan(machine.errors) & ~np.isnan(machine.estimates)).sum()) for machine in machines
    )
    named, missing = np.sum([machine.named for machine in machines], axis=0)
    clear = true > CLEAR
    lines = np.concatenate([machine.lines for machine in machines])
    sure = lines[~np.isnan(lines)]
    note = (
        f"{int((kinds == 0.0).sum())} frequencies and {int(kinds.sum())} compliances of {len(machines)} machines; {silent} say ± ?, of"
        f" {numbers - silent - len(given)} the truth is not sure enough; largest true error {100.0 * true.max():.0f} %"
    )
    rows = [
        judge_bound(
            case,
            f"{what}: share of numbers that ± does not cover",
            float(((given < true).sum() + alone) / (len(given) + alone)),
            1.0 - COVERED,
            note,
        ),
        judge_bound(
            case,
            f"{what}: ± over true error, median",
            float(np.median(given[clear] / true[clear])),
            LARGEST_MEDIAN,
            f"{clear.sum()} numbers with errors above {100.0 * CLEAR:g} %; 10 and 90 %: "
            f"{np.quantile(given[clear] / true[clear], 0.1):.2f}, {np.quantile(given[clear] / true[clear], 0.9):.1f}",
        ),
        show(
            case,
            f"{what}: modes named of all that the machines lack",
            float(named / missing) if missing else 1.0,
            "-",
            f"{named} of {missing}; {alone} modes have an estimate and no true partner (counted as not covered)",
        ),
    ]
    if len(sure):
        rows.append(
            judge_bound(
                case,
                f"{what}: share of frequency responses without 95 % of their lines covered",
                float((sure < COVERED).mean()),
                1.0 - COVERED_RESPONSES,
                f"{len(sure)} responses, {len(lines) - len(sure)} more whose truth is not sure enough; lines within 40 dB of the"
                " highest peak",
            )
        )
    return rows


def _known(machine: MachineNumbers) -> FloatArray:
    """Return which numbers have an estimate, and a truth that is sure enough to judge it."""
    return np.asarray(
        (machine.unsure <= SURE * machine.estimates) & np.isfinite(machine.errors), dtype=bool
    )
