"""Whether ± of contours covers the truth: machines of three axes drawn by seed that mill a block, beside
the same machines of fine meshes with more modes.
"""

import tempfile
from pathlib import Path

from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.contouring import ContourAnswer
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import keep_analyses
from headstock.solvers.mpi import MPI
from headstock.validation.machines.axes_estimate_cases import (
    FINE_ACROSS,
    ComparedNumbers,
    evaluate_numbers,
    list_sizes,
    pair_numbers,
    refine_scene,
)
from headstock.validation.machines.drawn_axes import draw_axes
from headstock.validation.references.rows import ValidationRow

LOOKED_AT, HELD_OUT, SMOKE_SEED = 0, 3, 1
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


def check_contour_estimates() -> list[ValidationRow]:
    """± of contours of the machine that was looked at, and of the one held out."""
    return compare_new_contours(LOOKED_AT) + compare_new_contours(HELD_OUT)


def check_contour_smoke() -> list[ValidationRow]:
    """Gap and forces of a short contour of one machine with one body that deforms."""
    found = _compare_contours(SMOKE_SEED, SMOKE_SETTINGS, SMOKE_ACROSS)
    return evaluate_numbers(f"machine {SMOKE_SEED}, {FACES}", [found[FACES]])


def compare_new_contours(seed: int) -> list[ValidationRow]:
    """± of the contour of a machine.

    Args:
        seed: Of it; ``FRESH_CONTOURS`` at least for one that nothing was chosen on or judged with.
    """
    return [
        row
        for kind, found in _compare_contours(seed).items()
        for row in evaluate_numbers(f"machine {seed}, {kind}", [found])
    ]


def _compare_contours(
    seed: int, settings: tuple[str, ...] = (), across: int = FINE_ACROSS
) -> dict[str, ComparedNumbers]:
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
        for one in (scene, refine_scene(scene, across)):
            results = run_scene(
                one, folder / "results", comm=MPI.COMM_SELF, store=Store(folder / "store")
            )
            (answer,) = find_answers(results.answers, ContourAnswer)
            both.append([*answer.list_numbers()])
    found = {}
    for what in dict.fromkeys(KINDS.values()):
        coarse, fine = (
            list_sizes(number for number in numbers if KINDS.get(number.key.kind) == what)
            for numbers in both
        )
        if len(coarse[0]):
            found[what] = pair_numbers(coarse, fine, least=0.0)
    return found


KINDS = {
    "outward_gap": FACES,
    "contour_gap": FACES,
    "drive_force": FACES,
    "drive_torque": FACES,
    "profile": PROFILES,
    "limit_depth": LIMITS,
}
