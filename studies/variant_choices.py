"""Which variants of a scene to hold side by side, each loaded and checked before anything is computed."""

from collections.abc import Sequence
from pathlib import Path

from headstock.geometry.parts.components import Fidelity
from headstock.geometry.parts.solids import SuperelementFile
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import Problem, SceneError
from headstock.scene.scene import Scene
from headstock.scene.schema.overrides import AS_WRITTEN
from headstock.studies.variants import VariantChoice


def choose_variants(
    path: Path, names: Sequence[str] = (), *, fidelities: Sequence[Fidelity] = (), overrides: Sequence[str] = ()
) -> tuple[VariantChoice, ...]:
    """Variants to compare.

    Args:
        path: Scene file.
        names: Variants, ``A+B`` for joined ones, ``as written`` for the scene itself; all of them when empty, and the scene as
            written where none of them is the same.
        fidelities: Each variant once per fidelity, taken by every component that it has elastic or segmented.
        overrides: ``key=value`` settings for all of them.

    Raises:
        SceneError: A variant has problems; holds those of all variants.
    """
    base = load_scene(path, overrides=overrides)
    scenes: list[tuple[VariantChoice, Scene]] = []
    problems: list[Problem] = []
    for name in names or (AS_WRITTEN, *base.variants):
        choice = VariantChoice(name, None if name == AS_WRITTEN else name, tuple(overrides))
        try:
            scenes.append((choice, load_scene(path, variant=choice.variant, overrides=overrides)))
        except SceneError as error:
            problems += error.problems
    if not names and any(choice.variant is not None and scene.raw == base.raw for choice, scene in scenes):
        scenes = [(choice, scene) for choice, scene in scenes if choice.variant is not None]
    choices = [made for choice, scene in scenes for made in _with_fidelities(choice, scene, fidelities)]
    if fidelities:
        problems += [problem for choice in choices for problem in _find_problems(path, choice)]
    if problems:
        raise SceneError(list(dict.fromkeys(problems)))
    return tuple(choices)


def _with_fidelities(choice: VariantChoice, scene: Scene, fidelities: Sequence[Fidelity]) -> list[VariantChoice]:
    deforming = [
        name
        for name, component in scene.machine.components.items()
        if component.fidelity != "rigid" and not isinstance(component.solid, SuperelementFile)
    ]
    if not deforming or not fidelities:
        return [choice]
    return [
        VariantChoice(
            f"{choice.name} {fidelity}",
            choice.variant,
            (*choice.overrides, *(f"components.{name}.fidelity={fidelity}" for name in deforming)),
        )
        for fidelity in fidelities
    ]


def _find_problems(path: Path, choice: VariantChoice) -> list[Problem]:
    try:
        load_scene(path, variant=choice.variant, overrides=choice.overrides)
    except SceneError as error:
        return list(error.problems)
    return []
