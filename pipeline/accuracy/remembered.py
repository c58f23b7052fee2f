"""What a search has found for a scene, kept in the store: the next run of the same scene computes its
last round alone.
"""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from headstock.geometry.parts.components import (
    Component,
    MeshSettings,
    ReductionSettings,
    SegmentSettings,
)
from headstock.pipeline.accuracy.followed import FOLLOWED
from headstock.pipeline.answers.accuracy import (
    AccuracyAnswer,
    AccuracyRound,
    BodyChoice,
    ModelErrorsAnswer,
    ResponseAccuracy,
)
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.storage.content_keys import search_key
from headstock.pipeline.storage.store import Store, read_entry, write_entry
from headstock.pipeline.storage.typed_json import (
    Coded,
    decode_value,
    encode_value,
    reachable_classes,
)
from headstock.scene.scene import Scene

PIECE = 4096  # characters
KEPT = ("fidelity", "mesh", "reduction", "segments")  # of a component
SETTINGS = reachable_classes([MeshSettings, ReductionSettings, SegmentSettings])


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
