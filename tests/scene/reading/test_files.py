"""The loader's bounds: size, depth, kind of file, and nothing outside the scene's folder."""

import os
import time
from pathlib import Path

import pytest

from cases import cases
from fixture_machines import write_scene
from headstock.scene.reading.files import MAX_BYTES, TomlTable, read_scene, resolve_file
from headstock.scene.reading.findings import Findings, SceneError


def read(path: Path) -> TomlTable:
    return read_scene(path, Findings(str(path)))


def test_a_file_of_one_mebibyte_is_read_and_a_larger_one_is_not(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("#" + " " * (MAX_BYTES - 2) + "\n")
    assert read(path) == {}
    path.write_text("#" + " " * (MAX_BYTES - 1) + "\n")
    with pytest.raises(SceneError, match="1 MiB"):
        read(path)


def test_fifty_levels_are_read_and_more_are_refused(tmp_path: Path) -> None:
    path = write_scene(tmp_path, "a = " + "[" * 48 + "]" * 48)
    assert read(path)
    path.write_text("a = " + "[" * 51 + "]" * 51)
    with pytest.raises(SceneError, match="50 deep"):
        read(path)


HOSTILE = {
    "arrays": "a = " + "[" * 100_000,
    "tables": "a = " + "{b=" * 100_000,
    "dotted key": ".".join("a" * 300_000) + " = 1",
    "header": "[" + ".".join("a" * 300_000) + "]",
    "spaced key": "x = { " + " . ".join(["a"] * 100_000) + " = 1 }",
    "quoted key": "x = { " + ".".join(['"a"'] * 100_000) + " = 1 }",
    "word": "a" * 1_000_000,
    "string": '"' + "a" * 1_000_000,
    "keys": "".join(f"a{index} = 1\n" for index in range(100_000)),
    "sections": "".join(f"[a{index}]\n" for index in range(90_000)),
    "items": "a = [" + "1, " * 300_000 + "]",
    "digits": "a = " + "9" * 100_000,
    "hex": "a = 0x" + "f" * 100_000 + " }",
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_text_is_refused_within_a_second_of_processor_time(
    tmp_path: Path, text: str
) -> None:
    path = write_scene(tmp_path, text)
    start = time.process_time()  # of this process alone: others may be busy
    with pytest.raises(SceneError):
        read(path)
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize(
    ("data", "fragment"),
    [
        (b"\xef\xbb\xbfa = 1\n", "byte-order mark"),
        ("a = 1\n".encode("utf-16"), "not UTF-8"),
        (b"a = 1\nb = '\xe9'\n", "line 2"),
        (b"a = '\x00'\n", "not valid TOML"),
    ],
)
def test_only_plain_utf8_is_read(tmp_path: Path, data: bytes, fragment: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(data)
    with pytest.raises(SceneError, match=fragment):
        read(path)


def test_only_regular_toml_files_are_read(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"ends in \.toml"):
        read(tmp_path / "scene.yaml")
    with pytest.raises(SceneError, match=r"new FOLDER --part FILE"):
        read(tmp_path / "part.STEP")
    with pytest.raises(SceneError, match="No such file"):
        read(tmp_path / "missing.toml")
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(SceneError, match="not a regular file"):
        read(tmp_path / "folder.toml")
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(SceneError, match="not a regular file"):
        read(tmp_path / "pipe.toml")
    (tmp_path / "device.toml").symlink_to("/dev/zero")
    with pytest.raises(SceneError, match="not a regular file"):
        read(tmp_path / "device.toml")


def test_a_file_below_the_scene_is_found(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "bed.STEP").write_text("")
    assert (
        resolve_file(tmp_path, "parts/bed.STEP", (".step",))
        == (tmp_path / "parts" / "bed.STEP").resolve()
    )
    assert resolve_file(tmp_path, "parts/../parts/bed.STEP", (".step",)).name == "bed.STEP"


@cases
def test_a_path_that_leaves_the_folder_or_is_no_such_file_is_refused(
    tmp_path: Path, text: str, fragment: str
) -> None:
    root = tmp_path / "scene"
    (root / "parts").mkdir(parents=True)
    (tmp_path / "secret.step").write_text("")
    (root / "link.step").symlink_to(tmp_path / "secret.step")
    (root / "linked").symlink_to(tmp_path)
    (root / "loop.step").symlink_to(root / "loop.step")
    (root / "folder.step").mkdir()
    (root / "part.geo").write_text("")
    os.mkfifo(root / "pipe.step")
    with pytest.raises(ValueError, match=fragment):
        resolve_file(root, text, (".step", ".stp"))
