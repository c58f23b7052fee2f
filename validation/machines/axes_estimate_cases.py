"""Whether ± of volumetric maps, paths and contours covers the truth: machines of three axes drawn by
seed, beside the same machines of fine meshes with more modes.
"""

import dataclasses
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.answers.answer import Answer, find_answers
from headstock.pipeline.answers.contouring import ContourAnswer
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.answers.volumetric import VolumetricAnswer
from headstock.pipeline.numbers.numbers import Number
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene, keep_analyses
from headstock.solvers.mpi import MPI
from headstock.validation.coverage.coverage_case import UNSURE, CoverageCase
from headstock.validation.machines.drawn_axes import draw_axes
from headstock.validation.references.rows import ValidationRow

SEEDS, SMOKE_SEED = range(5), 0  # the factor of paths was fitted on the first three
FRESH = 5  # first seed of no machine above
FINE_MODES = 40
FINER, FINE_ACROSS = 2.0, 5  # meshes of the true machine: so much smaller, elements across a patch
SURE = 0.3  # of ±: what may be unknown of a truth
LARGEST_MEDIAN = 5.0
PATHS = (
    "deviations and joint forces of a path",
    "the same under control, torques and position errors",
)
PROBES = "stress and displacement at probes along both"
CLEAR = 1e-3  # of a number: true errors above which a ratio means something
LEAST = 1e-9  # [m, rad]: what varies less is no number of a map

LOOKED_AT, HELD_OUT, SMOKE_CONTOUR = 0, 3, 1
FRESH_CONTOURS = 5  # first seed of no machine above, nor of those of axes
FACES, PROFILES, LIMITS = "gap and forces of faces", "profiles of faces", "limit depths of cut"
# one body deforms, on a mesh so coarse that one of three elements across a patch is fine beside it
SMOKE_ACROSS = 3
SMOKE_SETTINGS = (
    "effects.regeneration=false",
    "effects.guide_errors=false",
    "probes={}",
    "components.bed.fidelity='rigid'",
    "components.bridge.fidelity='rigid'",
    "components.saddle.mesh.across_patches=2",
    "analyses.contouring.side='18 mm'",
    "analyses.contouring.steps_per_turn=60",
    "analyses.contouring.pose_model='frozen'",
)


@dataclass(frozen=True, eq=False)
class _ComparedNumbers:
    """Numbers of an analysis beside those of fine meshes, SI.

    Attributes:
        values: ``(n,)``.
        errors: ``(n,)`` their ±; inf for ``± ?``.
        truth: ``(n,)`` of fine meshes.
        doubt: ``(n,)`` how well these are known.
    """

    values: FloatArray
    errors: FloatArray
    truth: FloatArray
    doubt: FloatArray


def check_axes_estimates() -> list[ValidationRow]:
    """± of the maps and paths of five machines."""
    return _evaluate_machines(list(SEEDS))


def check_axes_smoke() -> list[ValidationRow]:
    """Check one machine in the same way."""
    return _evaluate_machines([SMOKE_SEED])


def compare_new_axes(first: int) -> list[ValidationRow]:
    """Check the same of machines that nothing was chosen on or judged with before.

    Args:
        first: Seed of the first of them, ``FRESH`` at least.
    """
    return _evaluate_machines(list(range(first, first + len(SEEDS))))


def _evaluate_machines(seeds: list[int]) -> list[ValidationRow]:
    found = [_compare_axes(seed) for seed in seeds]
    machines = f"machines {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"machine {seeds[0]}"
    return [
        row
        for kind in found[0]
        for row in _evaluate_numbers(f"{machines}, {kind}", [each[kind] for each in found])
    ]


def _compare_axes(seed: int) -> dict[str, _ComparedNumbers]:
    """Numbers of a machine by what they are, beside those of fine meshes with more modes: measures of
    its map, errors in single poses, paths with motors that follow and with drives under control.
    """
    with tempfile.TemporaryDirectory(prefix="headstock-axes-") as name:
        folder = Path(name)
        path = folder / "machine.toml"
        path.write_text(draw_axes(seed))
        store = Store(folder / "store")

        def run[Found: Answer](
            variant: str | None, analysis: str, kind: type[Found]
        ) -> tuple[Found, Found]:
            scene = keep_analyses(load_scene(path, variant=variant), (analysis,))
            both = []
            for one in (scene, _refine_scene(scene)):
                results = run_scene(one, folder / "results", comm=MPI.COMM_SELF, store=store)
                (answer,) = find_answers(results.answers, kind)
                both.append(answer)
            return both[0], both[1]

        coarse, fine = run(None, "volumetric", VolumetricAnswer)
        paths = [run(variant, "path", PathResult) for variant in (None, "controlled")]
    measures = _pair_numbers(*map(_list_measures, (coarse, fine)), least=LEAST)
    poses = _ComparedNumbers(
        *(each.ravel() for each in (coarse.total, coarse.grid_errors, fine.total, fine.grid_errors))
    )
    free, driven = (_pair_numbers(*map(_list_path, both), least=0.0) for both in paths)
    seen = [_list_probes([answers[place] for answers in paths]) for place in (0, 1)]
    return {
        "ranges, motions along axes and squareness": measures,
        "errors in single poses": poses,
        PATHS[0]: free,
        PATHS[1]: driven,
        PROBES: _pair_numbers(*seen, least=0.0),
    }


def _pair_numbers(
    coarse: tuple[FloatArray, FloatArray], fine: tuple[FloatArray, FloatArray], *, least: float
) -> _ComparedNumbers:
    """Numbers and their ±, beside those of fine meshes.

    Args:
        coarse: ``(n,)`` each.
        least: Numbers up to here are none.
    """
    (values, errors), (truth, doubt) = coarse, fine
    kept = values > least
    return _ComparedNumbers(values[kept], errors[kept], truth[kept], doubt[kept])


def _refine_scene(scene: Scene, across: int = FINE_ACROSS) -> Scene:
    """Refine a machine: fine meshes, corrected, and more modes."""
    fine = dict(scene.machine.components)
    for name, part in fine.items():
        size = part.mesh.size
        if part.fidelity == "elastic" and size is not None:
            mesh = dataclasses.replace(part.mesh, size=size / FINER, across_patches=across)
            reduction = dataclasses.replace(part.reduction, correct_mesh=True, modes=FINE_MODES)
            fine[name] = dataclasses.replace(part, mesh=mesh, reduction=reduction)
    return replace_components(scene, fine)


def _list_measures(answer: VolumetricAnswer) -> tuple[FloatArray, FloatArray]:
    """Return sizes ``(n,)`` of all that is measured of a map, and their ±; the largest error is among the
    ranges.
    """
    return _list_sizes(
        number for number in answer.list_numbers() if number.key.kind != "volumetric_error"
    )


PATH_KINDS = ("path_deviation", "motor_torque", "position_error", "joint_force")
PROBE_KINDS = ("peak_stress", "peak_displacement")


def _list_path(answer: PathResult) -> tuple[FloatArray, FloatArray]:
    """Return sizes ``(n,)`` of deviations on ramps, torques, position errors and forces of a path, and
    their ±.
    """
    return _list_sizes(
        number
        for number in answer.list_numbers()
        if number.key.kind in PATH_KINDS and number.key.get("zone") != "cruising"
    )


def _list_probes(answers: list[PathResult]) -> tuple[FloatArray, FloatArray]:
    """Return the largest equivalent stresses and displacements ``(n,)`` at probes, and their ±."""
    return _list_sizes(
        number
        for answer in answers
        for number in answer.list_numbers()
        if number.key.kind in PROBE_KINDS
    )


def _list_sizes(numbers: Iterable[Number]) -> tuple[FloatArray, FloatArray]:
    """Return sizes ``(n,)`` of numbers, and their ±, infinite without a bound."""
    values: list[float] = []
    errors: list[float] = []
    for number in numbers:
        total = None if number.error is None else number.error.total
        values.append(abs(number.value))
        errors.append(np.inf if total is None else total)
    return np.array(values), np.array(errors)


def _evaluate_numbers(what: str, machines: list[_ComparedNumbers]) -> list[ValidationRow]:
    """Check whether their ± covers the true errors, and how large it is compared with them."""
    values, errors, truth, doubt = (
        np.concatenate([np.abs(getattr(machine, field)) for machine in machines])
        for field in ("values", "errors", "truth", "doubt")
    )
    signed, right = (
        np.concatenate([getattr(machine, field) for machine in machines])
        for field in ("values", "truth")
    )
    missed = np.abs(signed - right)
    sure = np.isfinite(errors) & (UNSURE * doubt <= SURE * errors)
    clear = sure & (missed > CLEAR * values)
    shares = missed[clear] / np.maximum(values, truth)[clear]
    note = (
        f"{sure.sum()} numbers, {len(sure) - sure.sum()} more not compared;"
        f" true errors up to {100.0 * shares.max():.2g} %, {100.0 * np.median(shares):.2g} % in the median"
    )
    suite = CoverageCase(CLEAR, LARGEST_MEDIAN)
    return suite.evaluate(what, missed[sure], errors[sure], note, sizes=values[sure])


def check_contour_estimates() -> list[ValidationRow]:
    """± of contours of the machine that was looked at, and of the one held out."""
    return compare_new_contours(LOOKED_AT) + compare_new_contours(HELD_OUT)


def check_contour_smoke() -> list[ValidationRow]:
    """Gap and forces of a short contour of one machine with one body that deforms."""
    found = _compare_contours(SMOKE_CONTOUR, SMOKE_SETTINGS, SMOKE_ACROSS)
    return _evaluate_numbers(f"machine {SMOKE_CONTOUR}, {FACES}", [found[FACES]])


def compare_new_contours(seed: int) -> list[ValidationRow]:
    """± of the contour of a machine.

    Args:
        seed: Of it; ``FRESH_CONTOURS`` at least for one that nothing was chosen on or judged with.
    """
    return [
        row
        for kind, found in _compare_contours(seed).items()
        for row in _evaluate_numbers(f"machine {seed}, {kind}", [found])
    ]


def _compare_contours(
    seed: int, settings: tuple[str, ...] = (), across: int = FINE_ACROSS
) -> dict[str, _ComparedNumbers]:
    """Numbers of a contour by what they are, beside those of fine meshes with more modes.

    Args:
        settings: Keys of its scene that are others.
        across: Elements across a patch of the fine meshes.
    """
    with tempfile.TemporaryDirectory(prefix="headstock-contours-") as name:
        folder = Path(name)
        path = folder / "machine.toml"
        path.write_text(draw_axes(seed))
        scene = keep_analyses(
            load_scene(path, variant="milling", overrides=settings), ("contouring",)
        )
        both = []
        for one in (scene, _refine_scene(scene, across)):
            results = run_scene(
                one, folder / "results", comm=MPI.COMM_SELF, store=Store(folder / "store")
            )
            (answer,) = find_answers(results.answers, ContourAnswer)
            both.append([*answer.list_numbers()])
    found = {}
    for what in dict.fromkeys(KINDS.values()):
        coarse, fine = (
            _list_sizes(number for number in numbers if KINDS.get(number.key.kind) == what)
            for numbers in both
        )
        if len(coarse[0]):
            found[what] = _pair_numbers(coarse, fine, least=0.0)
    return found


KINDS = {
    "outward_gap": FACES,
    "contour_gap": FACES,
    "drive_force": FACES,
    "drive_torque": FACES,
    "profile": PROFILES,
    "limit_depth": LIMITS,
}
