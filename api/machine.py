"""The nouns of a scene in Python, and ``Machine``, a whole scene: built of nouns or loaded from a
file, changed, and saved as TOML.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from inspect import Parameter, Signature
from keyword import iskeyword
from pathlib import Path
from typing import ClassVar, Self, TypedDict, Unpack

from pydantic import BaseModel

from headstock.arguments import read_keys, read_name, read_path_argument
from headstock.pipeline.storage.atomic_files import write_atomically
from headstock.pipeline.storage.content_keys import file_digest, file_digests
from headstock.pipeline.storage.outputs import naming_output
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.scene.building.loader import build_scene, read_tables
from headstock.scene.expansion.overrides import apply_settings, apply_variant
from headstock.scene.reading.files import TomlTable, TomlValue, write_toml, write_value
from headstock.scene.reading.findings import Findings, Problem, SceneError
from headstock.scene.reading.keys import split_key
from headstock.scene.scene import Scene
from headstock.scene.schema.scene import SceneTable, complete_scene
from headstock.scene.schema.validation import known_keys, validate_against
from headstock.values import find_strange, freeze_table, write_at, write_table


class Noun:
    """A table of the scene as an object: constructed from its keys, which docs/scene_reference.md
    lists, and frozen. A quantity is a text with a unit, or a number in SI units.
    """

    schema: ClassVar[type[BaseModel]]
    only_key: ClassVar[str]

    def __init_subclass__(cls, *, schema: type[BaseModel], kind: str = "") -> None:
        """Keys of the table become the parameters that ``help`` and notebooks show.

        Args:
            kind: The one key of the table whose own keys the noun has; empty for those of the
                table.
        """
        super().__init_subclass__()
        cls.schema, cls.only_key = schema, kind
        if "__init__" not in cls.__dict__:
            cls.__signature__ = Signature(  # type: ignore[attr-defined]
                [Parameter(name, Parameter.KEYWORD_ONLY) for name in cls._keys()]
            )

    @classmethod
    def _keys(cls) -> list[str]:
        """Keys of the noun as Python has them: ``from_`` for ``from``, which is a word of its own."""
        known = known_keys((), cls.schema) or []
        if cls.only_key:
            known = known_keys((cls.only_key,), cls.schema) or []
        return [f"{key}_" if iskeyword(key) else key for key in known if key.isidentifier()]

    def __init__(self, **keys: object) -> None:
        """Raises SceneError with every problem of the keys."""
        keys = {_without_underscore(key): value for key, value in keys.items()}
        given = {self.only_key: keys} if self.only_key else keys
        self.table: TomlTable = freeze_table(write_table(self.schema, given))
        findings = Findings(type(self).__name__)
        full = self._in_full(findings)
        self._checked: BaseModel | None = validate_against(self.schema, full, findings)
        findings.raise_if_any()

    def _in_full(self, findings: Findings) -> TomlTable:
        """Return the table with what it leaves to others."""
        return self.table

    def __getattr__(self, key: str) -> object:
        """Return what a key holds, in SI units, with defaults where it was not given."""
        if key.startswith("_") or key not in self._keys():
            raise AttributeError(f"a {type(self).__name__} has no {key!r}")
        checked = getattr(self._checked, self.only_key) if self.only_key else self._checked
        known = {} if checked is None else type(checked).model_fields
        aliases = {field.alias: name for name, field in known.items()}
        return getattr(checked, aliases.get(_without_underscore(key), key))

    def __setattr__(self, name: str, value: object) -> None:
        """Set what is not set yet: an object is made once."""
        if name in self.__dict__ or name in self._keys():
            kind = type(self).__name__
            raise AttributeError(f"a {kind} is not changed ({name}); make another {kind}")
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._keys()]

    def __eq__(self, other: object) -> bool:
        """Return whether both say the same, whatever units it is written in."""
        if not isinstance(other, Noun) or self.schema is not other.schema:
            return NotImplemented
        return self._checked == other._checked

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        table = self.table[self.only_key] if self.only_key else self.table
        items = table.items() if isinstance(table, dict) else ()
        keys = ", ".join(f"{key}={value!r}" for key, value in items)
        return f"{type(self).__name__}({keys})"


def _without_underscore(key: str) -> str:
    """``from`` for ``from_``."""
    return key[:-1] if iskeyword(key[:-1]) else key


type Table = Noun | Mapping[str, object]
type Entries = Mapping[str, Table]


class Sections(TypedDict, total=False):
    """Sections of a scene, as a machine is made of them."""

    name: str
    parameters: Mapping[str, object]
    materials: Entries
    cutting: Entries
    components: Entries
    joints: Entries
    chains: Entries
    points: Entries
    axes: Entries
    supports: Entries
    loads: Entries
    probes: Entries
    sensors: Entries
    masses: Entries
    mechanism: Table
    variants: Mapping[str, Mapping[str, object]]
    compare: Table
    poses: Mapping[str, Mapping[str, object]]
    sweeps: Entries
    studies: Entries
    drives: Entries
    exports: Entries
    effects: Mapping[str, object] | Sequence[str]
    analyses: Entries
    orientation: Table
    limits: Table
    accuracy: Table | str | float
    model_errors: bool
    interface_errors: bool
    free: bool
    accept_defaults: bool


class Machine(Noun, schema=SceneTable):
    """A scene: a machine, its poses and what is to be computed. It is checked as
    ``headstock check`` does when it is made, and is not changed afterwards.

    Attributes:
        table: As TOML has it, with variant and settings applied.
        scene: Built of it; not public.
        choice: File, variant and settings that give the same; None where there is no such file.
    """

    table: TomlTable
    scene: Scene
    choice: SceneChoice | None

    def __init__(self, *, folder: str | Path = ".", **keys: Unpack[Sections]) -> None:
        """Build a machine of nouns and tables, with the sections of a scene as keys.

        Args:
            folder: Where files lie that it refers to (STEP parts, meshes).
            keys: ``name``, ``materials``, ``components``, ``joints`` and so on.

        Raises:
            SceneError: Anything is wrong; holds every problem.
        """
        table = write_table(complete_scene(), keys)
        path = read_path_argument(
            folder, "Machine", "folder"
        ) / f"{table.get('name') or 'machine'}.toml".replace("/", "-")
        self._take(table, Findings("Machine"), path=path, variant=None, choice=None)

    @classmethod
    def load(cls, choice: SceneChoice) -> Self:
        """Load a machine from a scene file; raises SceneError with every problem."""
        made = cls.__new__(cls)
        findings = Findings(str(choice.path))
        table = read_tables(
            choice.path, findings, variant=choice.variant, overrides=choice.overrides
        )
        made._take(table, findings, path=choice.path, variant=choice.variant, choice=choice)
        return made

    def _take(
        self,
        table: TomlTable,
        findings: Findings,
        *,
        path: Path,
        variant: str | None,
        choice: SceneChoice | None,
    ) -> None:
        self.table, self.choice = freeze_table(table), choice
        self._origins, self._lines = dict(findings.origins), findings.lines
        self._included = dict(findings.included)
        self.scene = build_scene(table, findings, path=path, variant=variant)

    @cached_property
    def _checked(self) -> BaseModel | None:  # type: ignore[override]
        return validate_against(complete_scene(), self.scene.raw, Findings(str(self.scene.path)))

    def change(
        self, set: Mapping[str, object] | None = None, *, variant: str | None = None
    ) -> "Machine":
        """Return the machine with a variant of its own and other values.

        Args:
            set: Dotted key to value, applied after the variant.
            variant: Name; several joined by ``+``.

        Raises:
            SceneError: The result has problems.
        """
        path = self.scene.path
        findings = Findings(
            str(path), self._lines, dict(self._origins), included=dict(self._included)
        )
        overrides = write_settings(read_keys(set, "Machine.change", "set"))
        if variant is not None:
            read_name(variant, "Machine.change", "variant")
        table = apply_variant(self.table, variant, findings)
        apply_settings(table, overrides, findings)
        joined = "+".join(filter(None, [self.scene.variant, variant])) or None
        choice = self.choice
        if choice is not None:
            # on the command line settings come after all variants
            choice = (
                replace(choice, variant=joined, overrides=(*choice.overrides, *overrides))
                if variant is None or not choice.overrides
                else None
            )
        made = Machine.__new__(Machine)
        made._take(table, findings, path=path, variant=joined, choice=choice)
        return made

    def save(self, path: str | Path) -> Path:
        """Write the machine as a scene file, with the files it refers to beside it.

        Args:
            path: A ``.toml`` file; it is the old one or the whole new one.

        Raises:
            SceneError: Another file of the name of one it refers to is in the way, or the path does
                not end in .toml.
            OutputError: A file cannot be written.
        """
        target, source = read_path_argument(path, "Machine.save", "path"), self.scene.path.parent
        findings = Findings(str(target))
        if target.suffix.lower() != ".toml":
            findings.add_line(None, f"a scene file ends in .toml; write {target.stem}.toml")
        copies: list[str] = []
        for name, digest in file_digests(source, self.scene.raw):
            place = target.parent / name
            if not place.parent.resolve().is_relative_to(target.parent.resolve()):
                findings.add_line(
                    None, f"{place.parent} leads out of {target.parent} by a link; save elsewhere"
                )
            elif not os.path.lexists(place):
                copies.append(name)
            elif place.is_symlink() or not place.is_file() or file_digest(place) != digest:
                findings.add_line(
                    None,
                    f"{place} is another file than the machine's; save elsewhere",
                )
        findings.raise_if_any()
        for name in copies:
            (target.parent / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source / name, target.parent / name)
        with naming_output(target):
            write_atomically(target, write_toml(self.table).encode())
        return target

    @contextmanager
    def on_disk(self) -> Iterator[SceneChoice]:
        """Provide the machine as a scene file with variant and settings: its own file where that still
        says the same, else a temporary one. Not public.
        """
        if self.choice is not None and self._is_as_written(self.choice):
            yield self.choice
            return
        with tempfile.TemporaryDirectory(prefix="headstock-scene-") as folder:
            yield SceneChoice(self.save(Path(folder) / self.scene.path.name))

    def _is_as_written(self, choice: SceneChoice) -> bool:
        try:
            return self.table == read_tables(
                choice.path,
                Findings(str(choice.path)),
                variant=choice.variant,
                overrides=choice.overrides,
            )
        except SceneError:
            return False


def write_settings(values: Mapping[str, object]) -> Sequence[str]:
    """``key=value`` of each setting, as the command line has it.

    Args:
        values: Dotted key to value; numbers are in SI units.
    """
    return tuple(f"{key}={write_value(write_setting(key, value))}" for key, value in values.items())


def write_setting(key: str, value: object) -> TomlValue:
    """Return the value of a dotted key as TOML has it; a number is in SI units.

    Raises:
        SceneError: It is of a kind that no file can hold.
    """
    try:
        path = split_key(key)
    except ValueError:
        path = (key,)  # what is wrong with it the scene says
    written = write_at(complete_scene(), path, value)
    if (strange := find_strange(written)) is not None:
        message = f"holds {strange}, which is no value of a scene; write a number, a text, a list or a table"
        raise SceneError([Problem("Python", key, "", message)])
    return written
