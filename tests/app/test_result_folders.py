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
from headstock.app.command_line import main
from headstock.pipeline.storage.outputs import UnusableOutputError

RUN = "headstock run SCENE -o"


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def edit(folder: Path, **changes: object) -> None:
    path = folder / "summary.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def take_away(path: Path) -> None:
    path.unlink()
    path.mkdir()


def become_other(folder: Path, name: str) -> None:
    shutil.rmtree(folder)
    folder.mkdir()
    (folder / name).write_text("{}")


# what was done to a folder of results: a file and words that the message has
DAMAGES: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "missing": (shutil.rmtree, "summary.json", RUN),
    "of nobody": (partial(become_other, name="notes.txt"), "summary.json", RUN),
    "file": (
        lambda folder: (shutil.rmtree(folder), folder.write_text("")),
        "",
        "is a file; name the folder that a run has written",
    ),
    "summary cut": (lambda folder: cut(folder / "summary.json"), "summary.json", RUN),
    "summary is text": (
        lambda folder: (folder / "summary.json").write_bytes(b"\xff\xfe no text"),
        "summary.json",
        RUN,
    ),
    "summary is deep": (
        lambda folder: (folder / "summary.json").write_text("[" * 100_000),
        "summary.json",
        RUN,
    ),
    "summary is a list": (
        lambda folder: (folder / "summary.json").write_text("[]"),
        "summary.json",
        RUN,
    ),
    "summary is a folder": (lambda folder: take_away(folder / "summary.json"), "summary.json", RUN),
    "format 1": (lambda folder: edit(folder, format=1), "summary.json", "reads format 2"),
    "format 3": (lambda folder: edit(folder, format=3), "summary.json", "has format 3"),
    "no files": (lambda folder: edit(folder, files=[]), "summary.json", RUN),
    "no results": (lambda folder: (folder / "results.h5").unlink(), "results.h5", RUN),
    "results cut": (lambda folder: cut(folder / "results.h5"), "results.h5", "is damaged"),
    "results are a folder": (lambda folder: take_away(folder / "results.h5"), "results.h5", RUN),
    "results of another run": (
        lambda folder: edit(folder, files={"results.h5": {"sha256": "0" * 64}}),
        "results.h5",
        "of another run",
    ),
    **{
        f"of {command}": (partial(become_other, name=name), name, f"`headstock {command}`")
        for name, command in {
            "sweep.json": "sweep",
            "study.json": "study",
            "compare.json": "compare",
            "convergence.json": "converge",
            "identification.json": "identify",
        }.items()
    },
}
READERS: dict[str, Callable[[Path], object]] = {
    "report": lambda folder: main(["report", str(folder)]),
    "hs.open": hs.open,
    "hs.read_mesh": lambda folder: hs.read_mesh(folder, "block"),
}


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("reader", READERS)
def test_a_folder_that_cannot_be_used_is_named(
    block_results: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    damage: str,
    reader: str,
) -> None:
    folder = tmp_path / "out"
    shutil.copytree(block_results, folder)
    spoil, file, words = DAMAGES[damage]
    spoil(folder)
    before = contents(tmp_path)
    if reader == "report":
        assert READERS[reader](folder) == 2
        message = capsys.readouterr().err
        assert message.startswith("error: ")
    else:
        with pytest.raises(UnusableOutputError) as caught:
            READERS[reader](folder)
        message = str(caught.value)
    assert str(folder / file) in message
    assert words in message
    assert contents(tmp_path) == before


# what a command reads or makes in its folder before it computes
WRITERS = {
    "run {scene} --no-figures -o {out}": (".headstock-files", "tables", "figures", "modes"),
    "sweep {scene} line -o {out}": ("poses",),
    "study {scene} E -o {out}": ("points.jsonl",),
    "converge {scene} --accuracy 20% -o {out}": ("points.jsonl",),
    "compare {scene} -o {out}": (".headstock-files",),
    "identify {scene} {targets} -o {out}": (".headstock-files",),
}


@pytest.mark.parametrize(
    ("text", "name"), [(text, name) for text, names in WRITERS.items() for name in (*names, "")]
)
def test_what_lies_in_the_way_of_a_command_is_named_before_anything_is_computed(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, name: str
) -> None:
    """A file where a folder should be, a folder where a file should be, and a journal of another
    program.
    """
    out, targets = tmp_path / "out", scene_file.with_name("targets.toml")
    if "converge" in text:
        block = scene_file.read_text()
        scene_file.write_text(block.replace('"rigid"', '"elastic"\nmesh = { size = "50 mm" }'))
    place = out / name
    place.parent.mkdir(exist_ok=True)
    if name.startswith("."):
        place.mkdir()
    else:
        place.write_text("mine")
    words = [word.format(scene=scene_file, targets=targets, out=out) for word in text.split()]
    assert main(words) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"error: {place} ") and "-o DIR" in message
    assert place.is_dir() or place.read_text() == "mine"
    assert not (tmp_path / "store").exists()
