"""A folder that holds something else than a command can use is named with what to do: exit code 2,
and nothing in it is changed.
"""

import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

import headstock as hs
from common import Shell, read_json
from headstock.pipeline.storage.outputs import UnusableOutputError

RUN = "headstock run SCENE -o"


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def edit(folder: Path, **changes: object) -> None:
    path = folder / "summary.json"
    path.write_text(json.dumps(read_json(path) | changes))


def take_away(path: Path) -> None:
    path.unlink()
    path.mkdir()


def become_other(folder: Path, name: str) -> None:
    shutil.rmtree(folder)
    folder.mkdir()
    (folder / name).write_text("{}")


def write_summary(content: bytes) -> Callable[[Path], object]:
    return lambda folder: (folder / "summary.json").write_bytes(content)


OTHERS = {
    "sweep.json": "sweep",
    "study.json": "study",
    "compare.json": "compare",
    "convergence.json": "converge",
    "correlate.json": "correlate",
    "identification.json": "identify",
}
IS_FILE = "is a file; name the folder that a run has written"
OTHER_RUN = {"results.h5": {"sha256": "0" * 64}}
# what was done to a folder of results: a file and words that the message has
DAMAGES: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "missing": (shutil.rmtree, "summary.json", RUN),
    "of nobody": (partial(become_other, name="notes.txt"), "summary.json", RUN),
    "file": (lambda folder: (shutil.rmtree(folder), folder.write_text("")), "", IS_FILE),
    "summary cut": (lambda folder: cut(folder / "summary.json"), "summary.json", RUN),
    "summary is text": (write_summary(b"\xff\xfe no text"), "summary.json", RUN),
    "summary is deep": (write_summary(b"[" * 100_000), "summary.json", RUN),
    "summary is a list": (write_summary(b"[]"), "summary.json", RUN),
    "summary is a folder": (lambda folder: take_away(folder / "summary.json"), "summary.json", RUN),
    "format 1": (partial(edit, format=1), "summary.json", "reads format 2"),
    "format 3": (partial(edit, format=3), "summary.json", "has format 3"),
    "no files": (partial(edit, files=[]), "summary.json", RUN),
    "no results": (lambda folder: (folder / "results.h5").unlink(), "results.h5", RUN),
    "results cut": (lambda folder: cut(folder / "results.h5"), "results.h5", "is damaged"),
    "results are a folder": (lambda folder: take_away(folder / "results.h5"), "results.h5", RUN),
    "results of another run": (partial(edit, files=OTHER_RUN), "results.h5", "of another run"),
    **{
        f"of {command}": (partial(become_other, name=name), name, f"`headstock {command}`")
        for name, command in OTHERS.items()
    },
}
READERS: dict[str, Callable[[Path], object]] = {
    "hs.open": hs.open,
    "hs.read_mesh": lambda folder: hs.read_mesh(folder, "block"),
}


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("reader", ["report", *READERS])
def test_a_folder_that_cannot_be_used_is_named(
    block_results: Path, shell: Shell, damage: str, reader: str
) -> None:
    folder = shell.folder / "out"
    shutil.copytree(block_results, folder)
    spoil, file, words = DAMAGES[damage]
    spoil(folder)
    before = contents(shell.folder)
    if reader == "report":
        message = shell(f"report {folder}", code=2).err
        assert message.startswith("error: ")
    else:
        with pytest.raises(UnusableOutputError) as caught:
            READERS[reader](folder)
        message = str(caught.value)
    assert str(folder / file) in message and words in message
    assert contents(shell.folder) == before


# what a command reads or makes in its folder before it computes
WRITERS = {
    "run scene.toml --no-figures": (".headstock-files", "tables", "figures", "modes"),
    "sweep scene.toml line": ("poses",),
    "study scene.toml E": ("points.jsonl",),
    "converge scene.toml --accuracy 20%": ("points.jsonl",),
    "compare scene.toml": (".headstock-files",),
    "identify scene.toml targets.toml": (".headstock-files",),
}


@pytest.mark.parametrize(
    ("line", "name"), [(line, name) for line, names in WRITERS.items() for name in (*names, "")]
)
def test_what_lies_in_the_way_of_a_command_is_named_before_anything_is_computed(
    block: Shell, line: str, name: str
) -> None:
    """A file where a folder should be, a folder where a file should be, and a journal of another
    program.
    """
    if "converge" in line:
        block.change(('"rigid"', '"elastic"\nmesh = { size = "50 mm" }'))
    place = block.folder / "out" / name
    place.parent.mkdir(exist_ok=True)
    if name.startswith("."):
        place.mkdir()
    else:
        place.write_text("mine")
    message = block(f"{line} -o {block.folder / 'out'}", code=2).err
    assert message.startswith(f"error: {place} ") and "-o DIR" in message
    assert place.is_dir() or place.read_text() == "mine"
    assert "store" not in block.files()
