"""Whether the part ``model`` of ± covers what rigid and segmented bodies leave out, over drawn
machines: beside each stands the same machine of fine finite elements.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import headstock.pipeline
from headstock.geometry.frames import FloatArray
from headstock.pipeline.accuracy.followed import list_followed
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.accuracy.settings import start_component
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.runner import run_stages
from headstock.pipeline.stages.frf import estimate_response_errors, prepare_response
from headstock.pipeline.stages.machine import CoupledPose, couple_pose
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.storage.content_keys import code_fingerprint
from headstock.pipeline.storage.store import Store
from headstock.reduction.estimates.model_errors import WatchedModes, compare_modes, watch_modes
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, place_motion
from headstock.scene.scene import Scene
from headstock.solvers.linear.frequency_response import evaluate_frf
from headstock.solvers.mpi import MPI
from headstock.validation.coverage.coverage_case import (
    COMPLIANCE,
    FREQUENCY,
    SURE,
    UNSURE,
    CoverageCase,
    CoverageSuite,
    Scratch,
    compare_number,
    cover_lines,
)
from headstock.validation.machines.drawn_machines import HIGHEST_HZ, draw_machine_scene
from headstock.validation.references.rows import ValidationRow, show

# the margins of the stage were chosen on the first machines; the others were drawn for the held-out
# judgement
CALIBRATION, HOLD_OUT = range(8), range(8, 32)
FRESH = 52  # first seed of no machine above, nor of `model-choice`
SMOKE_MACHINES = (0,)
TRUE_ACCURACY = 0.002  # with which the meshes of the true machine begin
TRUE_MODES_TO = 12.0 * HIGHEST_HZ
CLEAR, LARGEST_MEDIAN = 1e-3, 3.0


@dataclass(frozen=True, eq=False)
class _MachineNumbers:
    """Numbers of a machine of rigid and segmented bodies beside those of fine finite elements.

    Attributes:
        compliances: ``(n,)`` 1 for compliances, 0 for frequencies.
        errors: ``(n,)`` true errors over the number; NaN for modes without a partner of their
            shape.
        estimates: ``(n,)`` ±, over the number; NaN for ``± ?``.
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


def _measure_machine(seed: int, scene: Scene, store: Store) -> _MachineNumbers:
    """Errors and estimates of a machine of rigid and segmented bodies.

    Args:
        scene: With ``model_errors``, and statics, modes and a frequency response.
    """
    plain = run_stages(scene, MPI.COMM_SELF, store)
    fine = {
        name: start_component(
            dataclasses.replace(part, fidelity="elastic"), TRUE_ACCURACY, TRUE_MODES_TO
        )
        for name, part in scene.machine.components.items()
    }
    elastic = replace_components(dataclasses.replace(scene, model_errors=False), fine)
    true = run_stages(elastic, MPI.COMM_SELF, store)
    (pose,) = plain.plan.poses.values()
    machines = couple_pose(plain.parts, pose), couple_pose(true.parts, pose)
    rows, named = _compare_modes(plain, true, machines)
    rows += _compare_compliances(plain, true)
    table = np.array(rows).T
    lines = _cover_lines(plain, machines[1])
    return _MachineNumbers(seed, table[0], table[1], table[2], table[3], lines, named)


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
        partner, left, truth = found.partners[index], 0.0, np.nan
        if partner >= 0:
            left = _expected_error(true, estimates[partner])
            truth = float(watched[1].modes.frequencies_hz[partner]) - left
        rows.append(compare_number(FREQUENCY, hz, truth, estimate=error, left=left))
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
            there, estimate = right_numbers[number.key], number.error.total
            left = _expected_error(true, there.error or Estimate())
            truth = there.value + left
            rows.append(
                compare_number(COMPLIANCE, number.value, truth, estimate=estimate, left=left)
            )
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
    found, right, total, doubt = (
        np.diagonal(lines, axis1=1, axis2=2)
        for lines in (curves.receptance, response.receptance, total, doubt)
    )
    return cover_lines(found, right, total=total, doubt=doubt)


def _evaluate(what: str, machines: Sequence[_MachineNumbers]) -> Iterator[ValidationRow]:
    known = [
        (machine.unsure <= SURE * machine.estimates) & np.isfinite(machine.errors)
        for machine in machines
    ]
    given, true, kinds = (
        np.concatenate([getattr(m, name)[own] for m, own in zip(machines, known, strict=True)])
        for name in ("estimates", "errors", "compliances")
    )
    numbers = sum(len(machine.errors) for machine in machines)
    silent = sum(int(np.isnan(machine.estimates).sum()) for machine in machines)
    alone = sum(
        int((np.isnan(machine.errors) & ~np.isnan(machine.estimates)).sum()) for machine in machines
    )
    named, missing = np.sum([machine.named for machine in machines], axis=0)
    note = (
        f"{int((kinds == 0.0).sum())} frequencies and {int(kinds.sum())} compliances of {len(machines)} machines; {silent} say ± ?, of"
        f" {numbers - silent - len(given)} the truth is not sure enough; largest true error {100.0 * true.max():.0f} %"
    )
    suite = CoverageCase(CLEAR, LARGEST_MEDIAN)
    yield from suite.evaluate(what, true, given, note, uncovered=alone)
    yield show(
        f"{what}: modes named of all that the machines lack",
        float(named / missing) if missing else 1.0,
        "-",
        f"{named} of {missing}; {alone} modes have an estimate and no true partner (counted as not covered)",
    )
    lines = np.concatenate([machine.lines for machine in machines])
    if np.isfinite(lines).any():
        yield suite.evaluate_responses(what, lines)


def _measure_seed(seed: int, scratch: Scratch) -> _MachineNumbers:
    scene = scratch.load(draw_machine_scene(seed))
    return _measure_machine(seed, scene, Store(scratch.folder / "store"))


def _texts_of(seed: int) -> tuple[str, ...]:
    code = code_fingerprint(headstock.pipeline), Path(__file__).read_text()
    return (*code, draw_machine_scene(seed))


SUITE = CoverageSuite(_measure_seed, _MachineNumbers, _texts_of, _evaluate)
