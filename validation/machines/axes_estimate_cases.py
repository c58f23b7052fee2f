"""Whether ± of volumetric maps, paths and contours covers the truth: machines of three axes drawn by
seed, beside the same machines of fine meshes with more modes.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.contouring import ContourAnswer
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.answers.volumetric import VolumetricAnswer
from headstock.pipeline.numbers.numbers import Number
from headstock.scene.scene import Scene, keep_analyses
from headstock.validation.coverage.coverage_case import UNSURE, CoverageCase, open_scratch
from headstock.validation.machines.drawn_axes import draw_axes_scene
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
PATH_KINDS = ("path_deviation", "motor_torque", "position_error", "joint_force")
PROBE_KINDS = ("peak_stress", "peak_displacement")

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


KINDS = {
    "outward_gap": FACES,
    "contour_gap": FACES,
    "drive_force": FACES,
    "drive_torque": FACES,
    "profile": PROFILES,
    "limit_depth": LIMITS,
}


def check_axes_estimates() -> Iterator[ValidationRow]:
    """± of the maps and paths of five machines."""
    return _evaluate_machines(list(SEEDS))


def check_axes_smoke() -> Iterator[ValidationRow]:
    """Check one machine in the same way."""
    return _evaluate_machines([SMOKE_SEED])


def compare_new_axes(first: int) -> Iterator[ValidationRow]:
    """Check the same of machines that nothing was chosen on or compared with before.

    Args:
        first: Seed of the first of them, ``FRESH`` at least.
    """
    return _evaluate_machines(list(range(first, first + len(SEEDS))))


def check_contour_estimates() -> Iterator[ValidationRow]:
    """± of contours of the machine that was looked at, and of the one held out."""
    yield from compare_new_contours(LOOKED_AT)
    yield from compare_new_contours(HELD_OUT)


def check_contour_smoke() -> list[ValidationRow]:
    """Gap and forces of a short contour of one machine with one body that deforms."""
    compared = _compare_contours(SMOKE_CONTOUR, SMOKE_SETTINGS, SMOKE_ACROSS)
    return _evaluate_numbers(f"machine {SMOKE_CONTOUR}, {FACES}", [compared[FACES]])


def compare_new_contours(seed: int) -> Iterator[ValidationRow]:
    """± of the contour of a machine.

    Args:
        seed: Of it; ``FRESH_CONTOURS`` at least for one that nothing was chosen on or compared with.
    """
    for kind, compared in _compare_contours(seed).items():
        yield from _evaluate_numbers(f"machine {seed}, {kind}", [compared])


def _evaluate_machines(seeds: list[int]) -> Iterator[ValidationRow]:
    compared = [_compare_axes(seed) for seed in seeds]
    machines = f"machines {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"machine {seeds[0]}"
    for kind in compared[0]:
        yield from _evaluate_numbers(f"{machines}, {kind}", [own[kind] for own in compared])


def _compare_axes(seed: int) -> dict[str, FloatArray]:
    """Return numbers of a machine by what they are, compared with those of fine meshes with more modes:
    measures of its map, errors in single poses, paths with motors that follow and with drives under
    control.
    """
    with open_scratch() as scratch:

        def run[Found: Answer](
            variant: str | None, analysis: str, kind: type[Found]
        ) -> tuple[Found, Found]:
            scene = keep_analyses(scratch.load(draw_axes_scene(seed), variant=variant), (analysis,))
            return scratch.answer(scene, kind), scratch.answer(_refine_scene(scene), kind)

        maps = run(None, "volumetric", VolumetricAnswer)
        free, driven = (run(variant, "path", PathResult) for variant in (None, "controlled"))

    def is_measure(number: Number) -> bool:
        # the largest error is among the ranges
        return number.key.kind != "volumetric_error"

    def is_of_path(number: Number) -> bool:
        return number.key.kind in PATH_KINDS and number.key.get("zone") != "cruising"

    coarse, fine = maps
    single = (coarse.total, coarse.grid_errors, fine.total, fine.grid_errors)
    at_probes = [[*free[index].list_numbers(), *driven[index].list_numbers()] for index in (0, 1)]
    return {
        "ranges, motions along axes and squareness": _compare(
            [answer.list_numbers() for answer in maps], is_measure, least=LEAST
        ),
        "errors in single poses": np.array([errors.ravel() for errors in single]),
        PATHS[0]: _compare([answer.list_numbers() for answer in free], is_of_path),
        PATHS[1]: _compare([answer.list_numbers() for answer in driven], is_of_path),
        PROBES: _compare(at_probes, lambda number: number.key.kind in PROBE_KINDS),
    }


def _compare_contours(
    seed: int, settings: tuple[str, ...] = (), across: int = FINE_ACROSS
) -> dict[str, FloatArray]:
    """Return numbers of a contour by what they are, compared with those of fine meshes with more modes.

    Args:
        settings: Keys of its scene that are others.
        across: Elements across a patch of the fine meshes.
    """
    with open_scratch() as scratch:
        milling = scratch.load(draw_axes_scene(seed), variant="milling", overrides=settings)
        scene = keep_analyses(milling, ("contouring",))
        numbers = [
            [*scratch.answer(one, ContourAnswer).list_numbers()]
            for one in (scene, _refine_scene(scene, across))
        ]
    compared = {
        what: _compare(numbers, functools.partial(_is_of, what))
        for what in dict.fromkeys(KINDS.values())
    }
    return {what: found for what, found in compared.items() if found.size}


def _is_of(what: str, number: Number) -> bool:
    return KINDS.get(number.key.kind) == what


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


def _compare(
    machines: Sequence[Iterable[Number]], wanted: Callable[[Number], bool], *, least: float = 0.0
) -> FloatArray:
    """Return rows ``(4, n)``: sizes of numbers and their ±, and the same of fine meshes; ± is infinite
    without a bound.

    Args:
        machines: Numbers of the machine, and of that with fine meshes.
        least: Those whose size is up to here are left out.
    """
    rows = np.array([row for numbers in machines for row in _list_sizes(numbers, wanted)])
    return rows[:, rows[0] > least]


def _list_sizes(
    numbers: Iterable[Number], wanted: Callable[[Number], bool]
) -> tuple[list[float], list[float]]:
    kept = [number for number in numbers if wanted(number)]
    totals = [None if number.error is None else number.error.total for number in kept]
    return (
        [abs(number.value) for number in kept],
        [np.inf if total is None else total for total in totals],
    )


def _evaluate_numbers(what: str, machines: Sequence[FloatArray]) -> list[ValidationRow]:
    """Check whether their ± covers the true errors, and how large it is compared with them."""
    signed, _, right, _ = numbers = np.hstack(machines)
    values, errors, truth, doubt = np.abs(numbers)
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
