"""What a search chose: kept in the store, so that the next run of the same scene computes its last round
alone, and as keys of the scene that give the same run again without a search.
"""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from headstock.geometry.parts.components import (
    Component,
    Interface,
    MeshSettings,
    ReductionSettings,
    SegmentSettings,
)
from headstock.meshing.size_files import SUFFIX, encode_sizes
from headstock.pipeline.accuracy.followed import FOLLOWED
from headstock.pipeline.answers.accuracy import (
    AccuracyAnswer,
    AccuracyRound,
    BodyChoice,
    ModelErrorsAnswer,
    ResponseAccuracy,
)
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.storage.content_keys import search_key
from headstock.pipeline.storage.outputs import replace_outputs
from headstock.pipeline.storage.store import Store, read_entry, write_entry
from headstock.pipeline.storage.typed_json import (
    Coded,
    decode_value,
    encode_value,
    reachable_classes,
)
from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.scene import Scene

PIECE = 4096  # characters
KEPT = ("fidelity", "mesh", "reduction", "segments")  # of a component
SETTINGS = reachable_classes([MeshSettings, ReductionSettings, SegmentSettings])

LENGTHS = ("size", "rim_size", "smallest", "leave_out", "details")  # of a mesh


SIZES_FOLDER = "sizes"


@dataclass(frozen=True)
class FoundSettings:
    """An entry of the store: a text of JSON in pieces."""

    text: tuple[str, ...]


@dataclass(frozen=True)
class JudgedNumbers:
    """An entry of the store: a text of JSON in pieces."""

    text: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Judged:
    """What a comparison with finite elements has found: the numbers with their ±, in the order of
    the answers of a run, the changes, and what it said.
    """

    numbers: tuple[Answer, ...]
    changes: ModelErrorsAnswer
    detail: str
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Remembered:
    """How a search for settings ended.

    Attributes:
        chosen: Components with the settings found.
        references: Bodies whose models were chosen, as the finite elements or polynomials that they
            were compared with.
        mesh_factors: Component to what its estimates of mesh errors were multiplied by.
        answer: What is said of the search.
    """

    chosen: Mapping[str, Component]
    references: Mapping[str, Component]
    mesh_factors: Mapping[str, float]
    answer: AccuracyAnswer


def remember_search(scene: Scene, store: Store, found: Remembered) -> str | None:
    """Keep what was found for a scene; a warning where the store cannot be written."""
    if not scene.raw:
        # made by a program: nothing says what it depends on
        return None
    content = {
        "chosen": {name: _keep(part) for name, part in found.chosen.items()},
        "references": {name: _keep(part) for name, part in found.references.items()},
        "mesh_factors": dict(found.mesh_factors),
        "answer": dataclasses.asdict(found.answer),
    }
    return write_entry(store, search_key(scene), FoundSettings(_cut(json.dumps(content))))


def recall_search(scene: Scene, store: Store) -> Remembered | None:
    """What was found for a scene; None where nothing was, or other files or code lay behind it."""
    if not scene.raw:
        return None
    entry = read_entry(store, search_key(scene), FoundSettings).value
    if entry is None:
        return None
    content = json.loads("".join(entry.text))
    parts = scene.machine.components
    chosen, references = (
        {name: _restore(parts[name], kept) for name, kept in content[kind].items()}
        for kind in ("chosen", "references")
    )
    factors = content["mesh_factors"]
    return Remembered(chosen, references, factors, _restore_answer(content["answer"]))


def remember_judged(scene: Scene, store: Store, judged: Judged) -> str | None:
    """Keep what a comparison found; a warning where the store cannot be written."""
    if not scene.raw:
        return None
    text = json.dumps(encode_value(judged))
    return write_entry(store, search_key(scene), JudgedNumbers(_cut(text)))


def recall_judged(scene: Scene, store: Store) -> Judged | None:
    """What a comparison found; None where there was none, or other files or code lay behind it."""
    if not scene.raw:
        return None
    entry = read_entry(store, search_key(scene), JudgedNumbers).value
    if entry is None:
        return None
    classes = reachable_classes([Judged, *FOLLOWED])
    found = decode_value(json.loads("".join(entry.text)), classes)
    return found if isinstance(found, Judged) else None


def _cut(text: str) -> tuple[str, ...]:
    return tuple(text[at : at + PIECE] for at in range(0, len(text), PIECE))


def _keep(component: Component) -> Coded:
    shapes = {name: (item.coupling, item.flexible) for name, item in component.interfaces.items()}
    return encode_value({**{name: getattr(component, name) for name in KEPT}, "shapes": shapes})


def _restore(component: Component, coded: Coded) -> Component:
    kept = decode_value(coded, SETTINGS)
    interfaces = {
        name: dataclasses.replace(
            item, coupling=kept["shapes"][name][0], flexible=kept["shapes"][name][1]
        )
        for name, item in component.interfaces.items()
    }
    return dataclasses.replace(
        component,
        interfaces=interfaces,
        **{name: kept[name] for name in KEPT},
    )


def _restore_answer(content: Mapping[str, Any]) -> AccuracyAnswer:
    rounds = tuple(
        AccuracyRound(**{**one, "owner": one["owner"] and tuple(one["owner"])})
        for one in content["rounds"]
    )
    models = {name: BodyChoice(**body) for name, body in content["models"].items()}
    own = content["responses"]
    responses = None if own is None else ResponseAccuracy(**own)
    known = {"rounds": rounds, "models": models, "responses": responses}
    return AccuracyAnswer(**{**content, **known})


def write_sizes(folder: Path, components: Mapping[str, Component]) -> list[str]:
    """Write the element sizes of meshes that have them from place to place; remarks.

    Args:
        components: By name, with the settings of their meshes.

    Raises:
        OutputError: The disk is full or the folder is gone.
    """
    contents = {
        f"{file_stem(name)}{SUFFIX}": encode_sizes(part.mesh.sizes)
        for name, part in components.items()
        if part.fidelity == "elastic" and part.mesh.sizes is not None
    }
    return replace_outputs(folder, SIZES_FOLDER, contents)


def list_values(components: Mapping[str, Component]) -> TomlTable:
    """Values by dotted key, which ``load_scene`` takes.

    Args:
        components: Those whose models, meshes, modes or interfaces were chosen, with what was.
    """
    values: TomlTable = {}
    for name, part in components.items():
        key = f"components.{name}"
        values[f"{key}.fidelity"] = part.fidelity
        if part.fidelity == "segmented":
            values[f"{key}.segments.count"] = part.segments.count
        if part.fidelity == "elastic":
            values[f"{key}.mesh"] = _mesh_values(name, part.mesh)
        if part.fidelity in ("elastic", "polynomial") and (kept := _reduction_values(part)):
            values[f"{key}.reduction"] = kept
        values |= {
            f"{key}.interfaces.{own}.coupling": _coupling_value(item)
            for own, item in part.interfaces.items()
            if item.flexible
        }
    return values


def _reduction_values(part: Component) -> TomlTable:
    settings = part.reduction
    values: TomlTable = {}
    if settings.modes_to_hz is not None:
        values["modes_to"] = f"{settings.modes_to_hz:.12g} Hz"
    if settings.correct_mesh and part.fidelity == "elastic":
        values["correct_mesh"] = True
    return values


def _mesh_values(name: str, mesh: MeshSettings) -> TomlTable:
    """Those of its keys that are not the default; sizes from place to place are those of a file beside
    the scene.
    """
    plain = MeshSettings()
    changed: dict[str, TomlValue] = {
        field.name: value
        for field in dataclasses.fields(mesh)
        if field.name != "sizes"
        and (value := getattr(mesh, field.name)) != getattr(plain, field.name)
    }
    if mesh.sizes is not None:
        del changed["size"]
    written: TomlTable = {
        key: f"{1e3 * float(str(value)):.12g} mm" if key in LENGTHS else value
        for key, value in changed.items()
    }
    return written if mesh.sizes is None else {**written, "sizes": f"{file_stem(name)}{SUFFIX}"}


def _coupling_value(interface: Interface) -> TomlValue:
    form = "strong" if interface.coupling == "rigid" else "weak"
    return {"flexible": interface.flexible, "form": form}
