"""``headstock effects --write``: what may be dropped of a scene, as a variant in a copy of its
file.
"""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

from headstock.geometry.errors import HeadstockError
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.estimates import show_share
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene
from headstock.scene.schema.overrides import VARIANT_JOINER
from headstock.studies.effects import MUCH, EffectTrial
from headstock.studies.good_enough import (
    VARIANT,
    Drop,
    append_variant,
    choose_drops,
    keep_within,
    name_variant,
)
from headstock.studies.model_trials import ModelTrial
from headstock.studies.model_worth import ModelFinding, try_models


def check_target(choice: SceneChoice, output: Path | None, *, force: bool) -> None:
    """Refuse a file that is there, before anything is computed.

    Raises:
        click.UsageError: It is the scene itself, or is there without ``force``.
    """
    target = _target(choice, output)
    if target.absolute() == choice.path.absolute():
        raise click.UsageError("--write leaves the scene as it is; name another file with -o")
    if target.exists() and not force:
        raise click.UsageError(f"{target} is there; name another file with -o, or add --force")
    if not target.absolute().parent.is_dir():
        raise click.UsageError(f"there is no folder {target.parent} for -o")


def write_good_enough(
    choice: SceneChoice,
    scene: Scene,
    trials: Sequence[EffectTrial],
    findings: Sequence[ModelFinding],
    output: Path | None,
) -> None:
    """Try together what moves little alone, and write it as a variant.

    Args:
        choice: The scene.
        scene: As written.
        trials: Of its effects.
        findings: Of changes of its model.
        output: File to write; None for one beside the scene.

    Raises:
        HeadstockError: The variant cannot be read where the file is to lie.
    """
    drops = choose_drops(scene, trials, findings)
    tried: dict[tuple[str, ...], ModelFinding] = {}

    def try_together(some: Sequence[Drop]) -> float:
        settings = tuple(setting for drop in some for setting in drop.settings)
        trial = ModelTrial("several", (), "all", "without", settings, "simpler")
        found = try_models(choice, Store(default_store_root()), trials=[trial])[0]
        if found.obstacle:
            raise HeadstockError(
                f"what may be dropped cannot be dropped together: {found.obstacle}"
            )
        tried[settings] = found
        return found.worth

    # of a lumped mechanism, effects alone can be dropped, each for less than a tenth of that
    kept = drops if scene.is_lumped else keep_within(drops, MUCH, try_together)
    if not kept:
        print("\nNothing may be dropped; no file is written")
        return
    target, name = _target(choice, output), name_variant(scene)
    content = append_variant(
        choice.path.read_bytes().decode(), kept, name=name, overrides=choice.overrides
    )
    whole = name if choice.variant is None else f"{choice.variant}{VARIANT_JOINER}{name}"
    _write_checked(target, content, whole)
    print(f"\n{target}: {len(kept)} of {len(drops)} that may be dropped, as a variant")
    settings = tuple(setting for drop in kept for setting in drop.settings)
    if settings in tried:
        found = tried[settings]
        print(
            f"together they move {found.changes[0].answer} by {show_share(found.worth)}:"
            f" {found.written.cpu_seconds:.2g} s become {found.tried.cpu_seconds:.2g} s"
        )
    print(f"  ./headstock run {target} --variant {whole}")


def _target(choice: SceneChoice, output: Path | None) -> Path:
    return output or choice.path.with_name(f"{choice.path.stem}_{VARIANT}.toml")


def _write_checked(target: Path, content: str, variant: str) -> None:
    """Put the file in its place once it has been read with its variant beside that."""
    handle, place = tempfile.mkstemp(suffix=".toml", dir=target.absolute().parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode())
        plan_scene(load_scene(Path(place), variant=variant))
        Path(place).chmod(0o644)
        Path(place).replace(target)
    except SceneError as error:
        raise HeadstockError(
            f"{target} is not written: {error.problems[0].message}; write [variants] as a table"
            " of its own, and the file beside the scene"
        ) from error
    finally:
        Path(place).unlink(missing_ok=True)
