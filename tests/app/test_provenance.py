"""Every result says where it comes from: scene, overrides, program, time, place; and `--version` says which program this is."""

import hashlib
import html
import json
import re
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from headstock.app.command_line import main
from headstock.pipeline.provenance import UNKNOWN, find_version

SCENE = """\
name = "A block <on> springs"
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"  # µ & <b>
[components.block]
solid = { box = ["100 mm", "100 mm", "100 mm"] }
material = "steel"
fidelity = "rigid"
[components.block.interfaces]
foot = { face = "z-" }
tip = { face = "z+" }
[joints.mount]
between = ["ground", "block.foot"]
kind = "spring"
stiffness = { x = "10 N/um", y = "10 N/um", z = "40 N/um", rx = "1 MN m/rad", ry = "1 MN m/rad", rz = "1 MN m/rad" }
[axes.X]
joints = ["mount"]
direction = "x"
limits = ["-50 mm", "50 mm"]
[points]
tcp = { tool = "block.tip", work = "ground" }
[analyses.static]
at = "tcp"
[analyses.modal]
count = 6
[variants.heavy]
"materials.steel.rho" = "8000 kg/m^3"
[sweeps.line]
axes = { X = ["0 mm", "10 mm", 2] }
[studies.E]
vary = { "materials.steel.rho" = ["7000 kg/m^3", "8000 kg/m^3"] }
watch = ["modal.frequencies_hz[0:3]"]
"""
OVERRIDE = "materials.steel.nu=0.29"


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    path = tmp_path / "block.toml"
    path.write_text(SCENE)
    return path


def require_origin(found: dict[str, object], scene: Path) -> None:
    assert found["scene_file"] == "block.toml"
    assert found["scene_text"] == SCENE
    assert found["scene_sha256"] == hashlib.sha256(scene.read_bytes()).hexdigest()
    assert found["overrides"] == [OVERRIDE]
    assert (found["version"], found["commit"]) == (find_version().version, find_version().commit)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", str(found["date"]))
    assert (found["ranks"], found["threads"]) == (1, 1)


def test_a_run_states_its_origin_in_summary_results_and_report(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["run", str(scene), "-o", str(out), "--no-figures", "--variant", "heavy", "--set", OVERRIDE, "--analysis", "modal"]
    assert main(words) == 0
    found = json.loads((out / "summary.json").read_text())["provenance"]
    require_origin(found, scene)
    assert found["variant"] == "heavy"
    assert found["analyses"] == ["modal"]
    assert found["command"] == words
    assert found["host"]
    with h5py.File(out / "results.h5") as file:
        group = file["provenance"]
        assert group["scene_text"][()].decode() == SCENE
        assert group.attrs["scene_sha256"] == found["scene_sha256"]
        assert json.loads(group.attrs["overrides"]) == [OVERRIDE]
        assert json.loads(group.attrs["command"]) == words
        assert {name: group.attrs[name] for name in ("variant", "version", "commit", "date", "host", "ranks")} == {
            name: found[name] for name in ("variant", "version", "commit", "date", "host", "ranks")
        }
    page = html.unescape((out / "report.html").read_text())
    for text in (found["scene_sha256"], found["commit"], found["date"], found["host"], OVERRIDE, "heavy", SCENE, " ".join(words)):
        assert text in page
    assert "A block <on> springs" not in (out / "report.html").read_text()


def test_no_host_leaves_host_and_command_out_of_every_file(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socket.gethostname", lambda: "secret-host")
    out = tmp_path / "secret-folder"
    assert main(["run", str(scene), "-o", str(out), "--no-figures", "--set", OVERRIDE, "--no-host"]) == 0
    found = json.loads((out / "summary.json").read_text())["provenance"]
    require_origin(found, scene)
    assert not {"host", "command"} & set(found)
    for path in (path for path in out.rglob("*") if path.is_file()):
        assert not re.search(rb"secret-(host|folder)", path.read_bytes()), path
    assert main(["report", str(out)]) == 0


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["sweep", "{scene}", "line"], "provenance.json"),
        (["study", "{scene}", "E"], "study.json"),
        (["compare", "{scene}"], "compare.json"),
    ],
)
@pytest.mark.parametrize("extra", [[], ["--no-host"]])
def test_many_runs_state_their_origin(scene: Path, tmp_path: Path, words: list[str], name: str, extra: list[str]) -> None:
    out = tmp_path / "out"
    assert main([*(word.format(scene=scene) for word in words), "-o", str(out), "--set", OVERRIDE, *extra]) == 0
    content = json.loads((out / name).read_text())
    found = content.get("provenance", content)
    require_origin(found, scene)
    assert ("host" in found) == ("command" in found) == (not extra)


def test_version_prints_version_and_commit_and_computes_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    found = find_version()
    assert capsys.readouterr().out == f"headstock {found.version} (commit {found.commit})\n"
    code = (
        "import sys; from headstock.app.command_line import main; main(['--version'])\n"
        "print([name for name in ('numpy', 'h5py', 'mpi4py', 'pydantic') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout.splitlines()[1:] == ["[]"]


@pytest.mark.parametrize("packed", [False, True])
def test_the_commit_of_a_checkout_and_of_a_worktree_is_read_without_git(tmp_path: Path, packed: bool) -> None:
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
    if packed:
        (main_folder / ".git" / "packed-refs").write_text(f"# pack-refs with: peeled\n{commit} refs/heads/topic\n")
    else:
        (main_folder / ".git" / "refs" / "heads").mkdir(parents=True)
        (main_folder / ".git" / "refs" / "heads" / "topic").write_text(f"{commit}\n")
    for folder in (main_folder, tree):
        found = find_version(folder)
        assert (found.version, found.commit) == ("9.8.7", commit)
    (linked / "HEAD").write_text(f"{commit}\n")
    find_version.cache_clear()
    assert find_version(tree).commit == commit
    (linked / "HEAD").write_text("ref: refs/heads/none\n")
    find_version.cache_clear()
    assert find_version(tree).commit == UNKNOWN


def test_what_is_neither_checkout_nor_installed_is_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("headstock.pipeline.provenance.DISTRIBUTION", "headstock-that-nobody-installs")
    found = find_version(tmp_path)
    assert (found.version, found.commit) == (UNKNOWN, UNKNOWN)
