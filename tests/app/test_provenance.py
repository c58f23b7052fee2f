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

from common import approx, run_process
from headstock.app.actions import publishing
from headstock.app.command_line import main
from headstock.app.pictures.pictures import Drawing
from headstock.pipeline.storage.provenance import UNKNOWN, find_version
from headstock.pipeline.storage.superelements import read_superelement

OVERRIDE = "materials.steel.nu=0.29"


@pytest.fixture
def scene(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """In a folder that no file should name."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr("socket.gethostname", lambda: "secret-host")
    text = scene_file.read_text().replace("A block on springs", "A block <on> springs")
    path = scene_file.parent / "secret-folder" / "block.toml"
    path.parent.mkdir()
    path.write_text(f"{text}# µ & <b>\n")
    path.with_name("targets.toml").write_text(scene_file.with_name("targets.toml").read_text())
    return path


def require_origin(found: Mapping[str, object], scene: Path) -> None:
    assert found["scene_text"] == scene.read_text()
    require_origin_of_export(found, scene)


def require_origin_of_export(found: Mapping[str, object], scene: Path) -> None:
    assert found["scene_file"] == "block.toml"
    assert found["scene_sha256"] == hashlib.sha256(scene.read_bytes()).hexdigest()
    assert found["overrides"] == [OVERRIDE]
    assert (found["version"], found["commit"]) == (find_version().version, find_version().commit)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", str(found["date"]))
    assert (found["ranks"], found["threads"]) == (1, 1)


def test_a_run_states_its_origin_in_summary_results_and_report(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = [
        "run",
        str(scene),
        "-o",
        str(out),
        "--no-figures",
        "--variant",
        "heavy",
        "--set",
        OVERRIDE,
        "--analysis",
        "modal",
    ]
    assert main(words) == 0
    found = json.loads((out / "summary.json").read_text())["provenance"]
    require_origin(found, scene)
    assert found["variant"] == "heavy"
    assert found["analyses"] == ["modal"]
    assert found["command"] == words
    assert found["host"] == "secret-host"
    with h5py.File(out / "results.h5") as file:
        group = file["provenance"]
        assert group["scene_text"][()].decode() == scene.read_text()
        assert group.attrs["scene_sha256"] == found["scene_sha256"]
        assert json.loads(group.attrs["overrides"]) == [OVERRIDE]
        assert json.loads(group.attrs["command"]) == words
        assert {
            name: group.attrs[name]
            for name in ("variant", "version", "commit", "date", "host", "ranks")
        } == {
            name: found[name] for name in ("variant", "version", "commit", "date", "host", "ranks")
        }
    page = html.unescape((out / "report.html").read_text())
    for text in (
        found["scene_sha256"],
        found["commit"],
        found["date"],
        found["host"],
        OVERRIDE,
        "heavy",
        scene.read_text(),
        " ".join(words),
    ):
        assert text in page
    assert "A block <on> springs" not in (out / "report.html").read_text()


# command, the file that says where its results come from, and a page that does
COMMANDS = {
    "run {scene} --no-figures -o {out}": ("summary.json", "report.html"),
    "sweep {scene} line -o {out} --json {out}/copy.json": ("provenance.json", "report.html"),
    "study {scene} E -o {out}": ("study.json", None),
    "compare {scene} -o {out}": ("compare.json", "compare.html"),
    "identify {scene} {targets} -o {out}": ("identification.json", None),
    "effects {scene} --json {out}/effects.json": ("effects.json", None),
}


@pytest.mark.parametrize(
    ("text", "extra"),
    [
        *((text, ["--no-host"]) for text in COMMANDS),
        *(
            pytest.param(text, [], marks=[pytest.mark.trials] * (not text.startswith("run")))
            for text in COMMANDS
        ),
    ],
)
def test_results_of_every_command_state_their_origin_and_with_no_host_neither_host_nor_folder(
    scene: Path, tmp_path: Path, text: str, extra: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for draw in ("draw_machine", "draw_modes", "draw_charts"):  # no text of theirs is looked at
        monkeypatch.setattr(publishing, draw, lambda *_: Drawing({}))
    out = tmp_path / "secret-folder" / "out"
    out.mkdir()
    places = {"scene": scene, "targets": scene.with_name("targets.toml"), "out": out}
    words = [word.format(**places) for word in text.split()]
    assert main([*words, "--set", OVERRIDE, *extra]) == 0
    name, page = COMMANDS[text]
    for path in (out / name, *out.glob("copy.json")):
        content = json.loads(path.read_text())
        found = content.get("provenance", content)
        require_origin(found, scene)
        assert ("host" in found) == ("command" in found) == (not extra)
    if page is not None:
        shown = html.unescape((out / page).read_text())
        for fact in (
            found["scene_sha256"],
            found["commit"],
            found["date"],
            OVERRIDE,
            scene.read_text(),
        ):
            assert fact in shown
        assert ("secret-host" in shown) == (not extra)
    if extra:
        for path in (path for path in out.rglob("*") if path.is_file()):
            assert not re.search(rb"secret-(host|folder)", path.read_bytes()), path
        assert name != "summary.json" or main(["report", str(out)]) == 0


@pytest.mark.parametrize("extra", [[], ["--no-host"]])
def test_an_exported_model_states_its_origin_but_not_the_text_of_the_scene(
    scene: Path, tmp_path: Path, extra: list[str]
) -> None:
    element, space = tmp_path / "block.h5", tmp_path / "block.mat"
    assert main(["export", str(scene), "block", "-o", str(element), "--set", OVERRIDE, *extra]) == 0
    options = ["--state-space", "500 Hz", "-o", str(space), "--set", OVERRIDE, *extra]
    assert main(["export", str(scene), *options]) == 0
    with h5py.File(element) as file:
        stored = dict(file["provenance"].attrs)
    stored["overrides"] = json.loads(stored["overrides"])
    read = scipy.io.loadmat(space, simplify_cells=True)["provenance"]
    read["overrides"] = np.atleast_1d(read["overrides"]).tolist()
    for found in (stored, read):
        require_origin_of_export(found, scene)
        assert ("host" in found) == ("command" in found) == (not extra)
    for path in (element, space):
        content = path.read_bytes()
        assert b"stiffness =" not in content and b"<on>" not in content
        assert not extra or not re.search(rb"secret-(host|folder)", content)
    assert read_superelement(element).mass_kg == approx(7.85)


def test_version_prints_version_and_commit_and_computes_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--version"]) == 0
    found = find_version()
    assert capsys.readouterr().out == f"headstock {found.version} (commit {found.commit})\n"
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
    if packed:
        (main_folder / ".git" / "packed-refs").write_text(
            f"# pack-refs with: peeled\n{commit} refs/heads/topic\n"
        )
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


def test_what_is_neither_checkout_nor_installed_is_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "headstock.pipeline.storage.provenance.DISTRIBUTION", "headstock-that-nobody-installs"
    )
    found = find_version(tmp_path)
    assert (found.version, found.commit) == (UNKNOWN, UNKNOWN)
