"""nothing outside the scene's folder is read, and nothing but regular files of moderate
size.
"""

import os
import re
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from faults.runs import SCENE
from fixture_machines import write_scene
from headstock.geometry.parts.solids import MeshFile
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene

pytestmark = pytest.mark.hard("H49")

# a mesh of a file takes no size, and that problem is not to hide another one
PLAIN_SCENE = SCENE.replace('mesh = { size = "20 mm" }\n', "")
SOLID = 'solid = { box = ["40 mm", "60 mm", "200 mm"] }'
# meant as an escape of TOML; other backslashes stand for themselves
ESCAPE = re.compile(r"\\[unt]")
ATTACKS = [
    # up and out
    "../secret.msh", "../../secret.msh", "./../secret.msh", "parts/../../secret.msh", "parts/./../../secret.msh", "parts//..//../secret.msh",
    "../scene/../secret.msh", "../" * 40 + "etc/secret.msh", "parts/../../scene/../secret.msh", "missing/../../secret.msh",
    # absolute, home, other systems, addresses
    "/etc/secret.msh", "//etc/secret.msh", "/proc/self/root/etc/secret.msh", "/dev/stdin.msh", "~/secret.msh", "~root/secret.msh",
    "$HOME/../../secret.msh", "C:\\secret.msh", "C:/secret.msh", "\\\\server\\share\\secret.msh", "..\\secret.msh", "parts\\..\\..\\secret.msh",
    "file:///etc/secret.msh", "http://localhost/secret.msh", "ftp:secret.msh", "data:,secret.msh", "%2e%2e/secret.msh", "..%2fsecret.msh",
    "．．/secret.msh", "..／secret.msh",
    # links
    "link.msh", "linked/secret.msh", "chain.msh", "loop.msh", "dangling.msh", "to_device.msh", "parts/up/secret.msh", "root.msh/etc/secret.msh",
    # no regular files
    "pipe.msh", "folder.msh", "socket.msh", "/dev/zero", "/dev/urandom.msh", "parts",
    # names
    "", " ", ".", "..", "a\\u0000.msh", "own.msh\\u0000.txt", "own\\n.msh", "own.msh\\t", "a" * 300 + ".msh", "x/" * 2000 + "own.msh",
    # other kinds
    "own.geo", "own.msh.geo", "own.GEO", "own.py", "own.so", "own.pickle", "own.txt",
]  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "scene"
    (folder / "parts").mkdir(parents=True)
    for path in (
        tmp_path / "secret.msh",
        *(
            folder / f"own.{kind}"
            for kind in ("msh", "geo", "msh.geo", "GEO", "py", "so", "pickle", "txt")
        ),
    ):
        path.write_text("$MeshFormat\n")
    for name, target in {
        "link.msh": "../secret.msh",
        "linked": "..",
        "chain.msh": "link.msh",
        "loop.msh": "loop.msh",
        "dangling.msh": "nowhere.msh",
        "to_device.msh": "/dev/zero",
        "parts/up": "../..",
        "root.msh": "/",
    }.items():
        (folder / name).symlink_to(target)
    (folder / "folder.msh").mkdir()
    os.mkfifo(folder / "pipe.msh")
    here = Path.cwd()
    os.chdir(folder)  # the name of a socket may not be long
    try:
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind("socket.msh")
            yield folder
    finally:
        os.chdir(here)


def load(folder: Path, name: str, *, kind: str = "mesh", overrides: tuple[str, ...] = ()) -> Scene:
    path = write_scene(folder, PLAIN_SCENE.replace(SOLID, f'solid = {{ {kind} = "{name}" }}'))
    return load_scene(path, overrides=overrides)


def test_the_list_holds_at_least_fifty_different_attacks() -> None:
    assert len(set(ATTACKS)) == len(ATTACKS) >= 50


@pytest.mark.parametrize(
    "name",
    [attack if ESCAPE.search(attack) else attack.replace("\\", "\\\\") for attack in ATTACKS],
)
def test_an_attack_is_refused(folder: Path, name: str) -> None:
    with pytest.raises(SceneError) as caught:
        load(folder, name)
    assert any("components.column" in problem.key for problem in caught.value.problems)


@pytest.mark.parametrize("kind", ["step", "mesh", "superelement"])
@pytest.mark.parametrize("name", ["../secret", "/etc/secret", "link", "pipe"])
def test_every_kind_of_file_is_guarded_also_when_it_is_set_on_the_command_line(
    folder: Path, kind: str, name: str
) -> None:
    suffix = {"step": ".step", "mesh": ".msh", "superelement": ".h5"}[kind]
    with pytest.raises(SceneError):
        load(
            folder, "own.msh", overrides=(f'components.column.solid={{{kind} = "{name}{suffix}"}}',)
        )


def test_the_same_file_under_its_own_name_is_found(folder: Path) -> None:
    found = MeshFile((folder / "own.msh").resolve())
    assert load(folder, "own.msh").machine.components["column"].solid == found
    (folder / "inside.msh").symlink_to("own.msh")
    assert load(folder, "inside.msh").machine.components["column"].solid == found


def test_a_file_beyond_the_size_cap_is_refused_with_its_size(folder: Path) -> None:
    os.truncate(folder / "own.msh", 5 << 30)  # without a byte of it on the disk
    with pytest.raises(SceneError, match=r"'own.msh' has 5.4 GB; a file of a part may have"):
        load(folder, "own.msh")


@pytest.mark.parametrize(
    "name", ["../x", "a/b", "..", "a\\u0000", "a b", "\\n", "é", "-x", "a" * 65, "<script>"]
)
@pytest.mark.parametrize("section", ["components", "poses", "points", "joints", "variants"])
def test_names_that_might_become_file_names_hold_nothing_but_letters_digits_and_lines(
    folder: Path, section: str, name: str
) -> None:
    path = write_scene(folder, f'{SCENE}\n[{section}."{name}"]\n')
    with pytest.raises(SceneError):
        load_scene(path)
