"""Where a result comes from: the scene as it was read, what was changed on the command line, and
the program, time and place.
"""

import dataclasses
import functools
import hashlib
import importlib
import json
import os
import re
import socket
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, NotRequired, TypedDict, cast

if TYPE_CHECKING:  # `--version` loads no numpy
    from headstock.scene.reading.open_values import OpenValue

DISTRIBUTION = "headstock"
UNKNOWN = "unknown"
COMMIT = re.compile(r"[0-9a-f]{40}([0-9a-f]{24})?")
# with machines/, tests/ and the launcher, in a checkout
PROJECT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class _ProgramVersion:
    """Version of Headstock, and the commit of its checkout or of what was installed; ``unknown``
    where nothing says it.
    """

    version: str
    commit: str


@dataclass(frozen=True)
class SceneChoice:
    """A scene file, its variant, ``KEY=VALUE`` of each ``--set``, and the analyses named."""

    path: Path
    variant: str | None = None
    overrides: tuple[str, ...] = ()
    analyses: tuple[str, ...] = ()


class ProvenanceSummary(TypedDict):
    """Where a result comes from, as files tell it: ``command`` and ``host`` where they are known,
    no scene in files of one model.
    """

    scene_file: str
    scene_sha256: str
    scene_text: NotRequired[str]
    variant: str | None
    overrides: list[str]
    analyses: list[str]
    version: str
    commit: str
    date: str
    ranks: int
    threads: int
    accepted_defaults: NotRequired[list[str]]
    command: NotRequired[list[str]]
    host: NotRequired[str]


@dataclass(frozen=True)
class Provenance:
    """Where a result comes from.

    Attributes:
        scene_text: Of the file, before variant and overrides; with the files it includes as one
            scene.
        variant: That was applied; None for none.
        overrides: ``KEY=VALUE`` of each ``--set``, in their order.
        analyses: Named on the command line; empty for all that the scene asks for.
        accepted_defaults: Open values of the scene whose defaults were used.
        date: When the command began, UTC, ISO 8601.
        command: Words of the command line, without the program; None where they are left out or
            there was none.
        host: Name of the computer; None where it is left out.
    """

    scene_file: str
    scene_sha256: str
    scene_text: str
    variant: str | None
    overrides: tuple[str, ...]
    analyses: tuple[str, ...]
    version: str
    commit: str
    date: str
    ranks: int
    threads: int
    accepted_defaults: tuple[str, ...] | None = None
    command: tuple[str, ...] | None = None
    host: str | None = None

    def summarise(self) -> ProvenanceSummary:
        """The same for a summary; host and command only where they are known."""
        return {**self.summarise_for_export(), "scene_text": self.scene_text}

    def summarise_for_export(self) -> ProvenanceSummary:
        """The same for a file of one model that is passed on: the digest of the scene, not its
        text, which may tell more than the model.
        """
        fields = dataclasses.asdict(self)
        left_out = {"scene_text", *(name for name, value in fields.items() if value is None)}
        left_out.discard("variant")
        summary = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in fields.items()
            if name not in left_out
        }
        return cast(ProvenanceSummary, summary)


def trace_content(
    choice: SceneChoice,
    content: bytes,
    *,
    ranks: int,
    accepted: "Sequence[OpenValue]" = (),
    command: Sequence[str] | None = None,
    with_host: bool = True,
) -> Provenance:
    """Return where what is computed now from the content of a scene file comes from.

    Args:
        choice: Name of the file, and what is changed of its content.
        content: Of the scene file with what it includes, or of what would be one.
        accepted: Its open values, whose defaults are used.
        command: Words of the command line; None without one.
        with_host: State host and command line.
    """
    program = find_version()
    return Provenance(
        scene_file=choice.path.name,
        scene_sha256=hashlib.sha256(content).hexdigest(),
        scene_text=content.decode("utf-8", "replace"),
        variant=choice.variant,
        overrides=choice.overrides,
        analyses=choice.analyses,
        version=program.version,
        commit=program.commit,
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        ranks=ranks,
        threads=int(os.environ.get("OMP_NUM_THREADS", os.cpu_count() or 1)),
        accepted_defaults=tuple(map(str, accepted)) or None,
        command=tuple(command) if with_host and command is not None else None,
        host=socket.gethostname() if with_host else None,
    )


@functools.cache
def find_version(root: Path = PROJECT) -> _ProgramVersion:
    """Version and commit of this program: of a folder's checkout, else of the distribution."""
    try:
        project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
        if project["name"] == DISTRIBUTION:
            return _ProgramVersion(str(project["version"]), _read_head(root) or UNKNOWN)
    except (OSError, ValueError, KeyError):
        pass  # no checkout
    # it loads the reader of e-mails, which no checkout needs
    metadata = importlib.import_module("importlib.metadata")
    try:
        distribution = metadata.distribution(DISTRIBUTION)
        origin = json.loads(distribution.read_text("direct_url.json") or "{}")
        return _ProgramVersion(
            distribution.version, str(origin.get("vcs_info", {}).get("commit_id", UNKNOWN))
        )
    except (ModuleNotFoundError, ValueError, AttributeError):
        return _ProgramVersion(UNKNOWN, UNKNOWN)


def _read_head(root: Path) -> str | None:
    """The commit that is checked out, read from git's files: git itself may not be installed."""
    try:
        folder = root / ".git"
        if folder.is_file():  # a worktree of another checkout
            folder = (root / folder.read_text().partition("gitdir:")[2].strip()).resolve()
        head = (folder / "HEAD").read_text().strip()
        name = head.removeprefix("ref:").strip()
        if name == head:
            return head if COMMIT.fullmatch(head) else None
        common = folder / "commondir"
        shared = (folder / common.read_text().strip()).resolve() if common.is_file() else folder
        for file in (folder / name, shared / name):
            if file.is_file():
                found = file.read_text().strip()
                return found if COMMIT.fullmatch(found) else None
        packed = (line.partition(" ") for line in (shared / "packed-refs").read_text().splitlines())
        return next(
            (commit for commit, _, ref in packed if ref == name and COMMIT.fullmatch(commit)), None
        )
    except OSError:
        return None
