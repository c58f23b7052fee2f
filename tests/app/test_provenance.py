"""Every result says where it comes from: scene, overrides, program, time, place; and `--version`
says which program this is.
"""

import hashlib
import html
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from common import Shell, approx, read_json, run_process
from headstock.app.actions import publishing
from headstock.app.pictures.pictures import Drawing
from headstock.pipeline.storage.provenance import UNKNOWN, find_version
from headstock.pipeline.storage.superelements import read_superelement

SET = "--set materials.steel.nu=0.29"
OVERRIDE = SET.split()[1]


@pytest.fixture
def secret(block: Shell, monkeypatch: pytest.MonkeyPatch) -> Shell:
    """In a folder that no file should name."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr("socket.gethostname", lambda: "secret-host")
    block.change(("A block on springs", "A block <on> springs"), add="# µ & <b>\n")
    block.folder = block.folder / "secret-folder"
    block.folder.mkdir()
    monkeypatch.chdir(block.folder)
    for name in ("scene.toml", "targets.toml"):
        (block.folder.parent / name).rename(name)
    return block


def require_origin(found: Mapping[str, object], scene: str) -> None:
    assert found["scene_text"] == scene
    require_origin_of_export(found, scene)


def require_origin_of_export(found: Mapping[str, object], scene: str) -> None:
    assert found["scene_file"] == "scene.toml"
    assert found["scene_sha256"] == hashlib.sha256(scene.encode()).hexdigest()
    assert found["overrides"] == [OVERRIDE]
    assert (found["version"], found["commit"]) == (find_version().version, find_version().commit)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", str(found["date"]))
    assert (found["ranks"], found["threads"]) == (1, 1)


def test_a_run_states_its_origin_in_summary_results_and_report(secret: Shell) -> None:
    line = f"run scene.toml -o out --no-figures --variant heavy {SET} --analysis modal"
    secret(line)
    text = secret.text("scene.toml")
    found = secret.json("out/summary.json")["provenance"]
    require_origin(found, text)
    assert found["variant"] == "heavy"
    assert found["analyses"] == ["modal"]
    assert found["command"] == line.split()
    assert found["host"] == "secret-host"
    with h5py.File("out/results.h5") as file:
        group = file["provenance"]
        assert group["scene_text"][()].decode() == text
        assert json.loads(group.attrs["overrides"]) == [OVERRIDE]
        assert json.loads(group.attrs["command"]) == line.split()
        for name in ("scene_sha256", "variant", "version", "commit", "date", "host", "ranks"):
            assert group.attrs[name] == found[name]
    page = html.unescape(secret.text("out/report.html"))
    facts = [found[name] for name in ("scene_sha256", "commit", "date", "host")]
    for fact in (*facts, OVERRIDE, "heavy", text, line):
        assert fact in page
    assert "A block <on> springs" not in secret.text("out/report.html")


# command, the file that says where its results come from, and a page that does
COMMANDS = {
    "run scene.toml --no-figures -o out": ("summary.json", "report.html"),
    "sweep scene.toml line -o out --json out/copy.json": ("provenance.json", "report.html"),
    "study scene.toml E -o out": ("study.json", None),
    "compare scene.toml -o out": ("compare.json", "compare.html"),
    "identify scene.toml targets.toml -o out": ("identification.json", None),
    "effects scene.toml --json out/effects.json": ("effects.json", None),
}
TRIAL = pytest.mark.trials


@pytest.mark.parametrize(
    ("line", "extra"),
    [
        *((line, "--no-host") for line in COMMANDS),
        *(pytest.param(line, "", marks=[TRIAL] * (line[:3] != "run")) for line in COMMANDS),
    ],
)
def test_results_of_every_command_state_their_origin_and_with_no_host_neither_host_nor_folder(
    secret: Shell, line: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for draw in ("draw_machine", "draw_modes", "draw_charts"):  # no text of theirs is looked at
        monkeypatch.setattr(publishing, draw, lambda *_: Drawing({}))
    out, text = secret.folder / "out", secret.text("scene.toml")
    out.mkdir()
    secret(f"{line} {SET} {extra}")
    name, page = COMMANDS[line]
    for path in (out / name, *out.glob("copy.json")):
        content = read_json(path)
        found = content.get("provenance", content)
        require_origin(found, text)
        assert ("host" in found) == ("command" in found) == (not extra)
    if page is not None:
        shown = html.unescape((out / page).read_text())
        for fact in (found["scene_sha256"], found["commit"], found["date"], OVERRIDE, text):
            assert fact in shown
        assert ("secret-host" in shown) == (not extra)
    if extra:
        for path in (path for path in out.rglob("*") if path.is_file()):
            assert not re.search(rb"secret-(host|folder)", path.read_bytes()), path
        if name == "summary.json":
            secret("report out")


@pytest.mark.parametrize("extra", ["", "--no-host"])
def test_an_exported_model_states_its_origin_but_not_the_text_of_the_scene(
    secret: Shell, extra: str
) -> None:
    element, space = (secret.folder / name for name in ("block.h5", "block.mat"))
    secret(f"export scene.toml block -o block.h5 {SET} {extra}")
    secret(f"export scene.toml --state-space '500 Hz' -o block.mat {SET} {extra}")
    with h5py.File(element) as file:
        stored = dict(file["provenance"].attrs)
    stored["overrides"] = json.loads(stored["overrides"])
    read = scipy.io.loadmat(space, simplify_cells=True)["provenance"]
    read["overrides"] = np.atleast_1d(read["overrides"]).tolist()
    for found in (stored, read):
        require_origin_of_export(found, secret.text("scene.toml"))
        assert ("host" in found) == ("command" in found) == (not extra)
    for path in (element, space):
        content = path.read_bytes()
        assert b"stiffness =" not in content and b"<on>" not in content
        assert not extra or not re.search(rb"secret-(host|folder)", content)
    assert read_superelement(element).mass_kg == approx(7.85)


def test_version_prints_version_and_commit_and_computes_nothing(shell: Shell) -> None:
    found = find_version()
    assert shell("--version").out == f"headstock {found.version} (commit {found.commit})\n"
    code = (
        "import sys; from headstock.app.command_line import main; main(['--version'])\n"
        "print([name for name in ('numpy', 'h5py', 'mpi4py', 'pydantic') if name in sys.modules])"
    )
    done = run_process([sys.executable, "-P", "-c", code], timeout=120)
    assert done.stdout.splitlines()[1:] == ["[]"]


@pytest.mark.parametrize("packed", [False, True])
def test_the_commit_of_a_checkout_and_of_a_worktree_is_read_without_git(
    tmp_path: Path, packed: bool
) -> None:
    commit = "0123456789abcdef" * 2 + "01234567"
    main_folder, tree = tmp_path / "main", tmp_path / "tree"
    linked = main_folder / ".git" / "worktrees" / "tree"
    linked.mkdir(parents=True)
    tree.mkdir()
    for folder in (main_folder, tree):
        (folder / "pyproject.toml").write_text('[project]\nname = "headstock"\nversion = "9.8.7"\n')
    (tree / ".git").write_text(f"gitdir: {linked}\n")
    (linked / "commondir").write_text("../..\n")
    for head in (main_folder / ".git" / "HEAD", linked / "HEAD"):
        head.write_text("ref: refs/heads/topic\n")
    heads = main_folder / ".git" / "refs" / "heads"
    heads.mkdir(parents=True)
    if packed:
        peeled = f"# pack-refs with: peeled\n{commit} refs/heads/topic\n"
        (main_folder / ".git" / "packed-refs").write_text(peeled)
    else:
        (heads / "topic").write_text(f"{commit}\n")
    for folder in (main_folder, tree):
        found = find_version(folder)
        assert (found.version, found.commit) == ("9.8.7", commit)
    for text, known in ((commit, commit), ("ref: refs/heads/none", UNKNOWN)):
        (linked / "HEAD").write_text(f"{text}\n")
        find_version.cache_clear()
        assert find_version(tree).commit == known


def test_what_is_neither_checkout_nor_installed_is_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "headstock.pipeline.storage.provenance.DISTRIBUTION"
    monkeypatch.setattr(name, "headstock-that-nobody-installs")
    found = find_version(tmp_path)
    assert (found.version, found.commit) == (UNKNOWN, UNKNOWN)
