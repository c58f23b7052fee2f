"""Results of a search: kept in the store, so that the next run of the same scene computes its last
round alone, and as keys of the scene that give the same run without a search.
"""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from headstock.geometry.parts.components import (
    Component,
    CouplingKind,
    Fidelity,
    MeshSettings,
    ReductionSettings,
    SegmentSettings,
)
from headstock.meshing.size_files import SUFFIX
from headstock.pipeline.accuracy.followed import FOLLOWED
from headstock.pipeline.answers.accuracy import (
    AccuracyAnswer,
    ModelErrorsAnswer,
)
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.storage.content_keys import search_key
from headstock.pipeline.storage.store import Store, read_entry, write_entry
from headstock.pipeline.storage.typed_json import (
    decode_value,
    encode_value,
    reachable_classes,
)
from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.scene import Scene

PIECE = 4096  # characters

LENGTHS = ("size", "rim_size", "smallest", "leave_out", "details")  # of a mesh


@dataclass(frozen=True)
class _StoredSearch:
    """Store a search: JSON text in pieces."""

    text: tuple[str, ...]


@dataclass(frozen=True)
class _StoredComparison:
    """Store a comparison: JSON text in pieces."""

    text: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """Store the result of a comparison with finite elements: the numbers with their ±, in the order
    of the answers of a run, the changes, and the report.
    """

    numbers: tuple[Answer, ...]
    changes: ModelErrorsAnswer
    detail: str
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SearchRecord:
    """Store the result of a search for settings.

    Attributes:
        chosen: Components with the settings found.
        references: Finite elements or polynomials of the bodies whose models were chosen, to
            compare with.
        mesh_factors: Component to the safety factor on its mesh estimates.
    """

    chosen: Mapping[str, Component]
    references: Mapping[str, Component]
    mesh_factors: Mapping[str, float]
    answer: AccuracyAnswer


@dataclass(frozen=True)
class _Settings:
    """Store the settings that a search chooses of a component, with form and number of shapes of
    its interfaces.
    """

    fidelity: Fidelity
    mesh: MeshSettings
    reduction: ReductionSettings
    segments: SegmentSettings
    shapes: Mapping[str, tuple[CouplingKind, int]]

    @classmethod
    def of(cls, component: Component) -> "_Settings":
        """Take them from a component."""
        shapes = {
            name: (item.coupling, item.flexible) for name, item in component.interfaces.items()
        }
        kept = (component.fidelity, component.mesh, component.reduction, component.segments)
        return cls(*kept, shapes)

    def give(self, component: Component) -> Component:
        """Give them to a component of a scene."""
        interfaces = {}
        for name, item in component.interfaces.items():
            coupling, flexible = self.shapes[name]
            interfaces[name] = dataclasses.replace(item, coupling=coupling, flexible=flexible)
        return dataclasses.replace(
            component,
            fidelity=self.fidelity,
            mesh=self.mesh,
            reduction=self.reduction,
            segments=self.segments,
            interfaces=interfaces,
        )


@dataclass(frozen=True, eq=False)
class _SearchContent:
    """Define the stored form of a search."""

    chosen: Mapping[str, _Settings]
    references: Mapping[str, _Settings]
    mesh_factors: Mapping[str, float]
    answer: AccuracyAnswer


def remember_search(scene: Scene, store: Store, found: SearchRecord) -> str | None:
    """Store the result of a search; return a warning where the store cannot be written."""
    chosen, references = (
        {name: _Settings.of(part) for name, part in parts.items()}
        for parts in (found.chosen, found.references)
    )
    content = _SearchContent(chosen, references, dict(found.mesh_factors), found.answer)
    return _write(scene, store, _StoredSearch, content)


def recall_search(scene: Scene, store: Store) -> SearchRecord | None:
    """Return a stored search; None where there is none, or files or code have changed."""
    content = _read(scene, store, _StoredSearch, [_SearchContent])
    if not isinstance(content, _SearchContent):
        return None
    parts = scene.machine.components
    chosen, references = (
        {name: settings.give(parts[name]) for name, settings in kept.items()}
        for kept in (content.chosen, content.references)
    )
    return SearchRecord(chosen, references, content.mesh_factors, content.answer)


def remember_comparison(scene: Scene, store: Store, comparison: ModelComparison) -> str | None:
    """Store the result of a comparison; return a warning where the store cannot be written."""
    return _write(scene, store, _StoredComparison, comparison)


def recall_comparison(scene: Scene, store: Store) -> ModelComparison | None:
    """Return a stored comparison; None where there is none, or files or code have changed."""
    found = _read(scene, store, _StoredComparison, [ModelComparison, *FOLLOWED])
    return found if isinstance(found, ModelComparison) else None


type _Stored = _StoredSearch | _StoredComparison


def _write(scene: Scene, store: Store, kind: type[_Stored], content: object) -> str | None:
    if not scene.raw:
        # made by a program: its dependencies are unknown
        return None
    text = json.dumps(encode_value(content))
    pieces = tuple(text[at : at + PIECE] for at in range(0, len(text), PIECE))
    return write_entry(store, search_key(scene), kind(pieces))


def _read(
    scene: Scene, store: Store, kind: type[_Stored], classes: Sequence[type[Any]]
) -> object | None:
    entry = read_entry(store, search_key(scene), kind).value if scene.raw else None
    if entry is None:
        return None
    value: object = decode_value(json.loads("".join(entry.text)), reachable_classes(classes))
    return value


def list_values(components: Mapping[str, Component]) -> TomlTable:
    """Return values by dotted key, as ``load_scene`` takes them.

    Args:
        components: Components whose models, meshes, modes or interfaces were chosen, with the
            chosen settings.
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
            f"{key}.interfaces.{own}.coupling": {
                "flexible": item.flexible,
                "form": "strong" if item.coupling == "rigid" else "weak",
            }
            for own, item in part.interfaces.items()
            if item.flexible
        }
    return values


def _reduction_values(part: Component) -> TomlTable:
    settings = part.reduction
    values: TomlTable = {}
    if settings.modes_to_hz is not None:
        values["modes_to"] = f"{settings.modes_to_hz:.12g} Hz"
    elif settings.modes is not None:
        values["modes"] = settings.modes
    if settings.correct_mesh and part.fidelity == "elastic":
        values["correct_mesh"] = True
    return values


def _mesh_values(name: str, mesh: MeshSettings) -> TomlTable:
    """Return the keys of a mesh that differ from the default; varying sizes are in a file."""
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
