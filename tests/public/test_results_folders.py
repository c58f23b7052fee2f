"""A folder of results decides nothing about files outside it, whatever links and lists it holds."""

import contextlib
import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import pytest

import headstock as hs
from common import run_alone
from fixture_machines import machine

ROOT = Path(__file__).resolve().parents[2]
SCENE = machine("""
machine = "block"
names = { block = "bar" }
without = ["analyses.modal"]
components.bar.solid = { box = ["40 mm", "40 mm", "200 mm"] }
joints.mount.stiffness = { x = "9 N/um", y = "9 N/um", z = "9 N/um", rx = "1 MN m/rad", ry = "1 MN m/rad", rz = "1 MN m/rad" }
[studies.stiff]
vary = { "joints.mount.stiffness.x" = ["5 N/um", "10 N/um"] }
watch = ["static.tcp.compliance_um_per_kN[0][0]"]
""")
Job = tuple[str, Callable[[Path, Path], None]]


def command(*words: str) -> Callable[[Path, Path], None]:
    """A command on the scene, where FOLDER stands for the folder of results."""

    def run(scene: Path, folder: Path) -> None:
        named = {"SCENE": str(scene), "FOLDER": str(folder)}
        done = run_alone(scene.parent, *(named.get(word, word) for word in words))
        assert done.returncode == 0 or "link" in done.stderr, done.stderr

    return run


JOBS: tuple[Job, ...] = (
    ("run", command("run", "SCENE", "-o", "FOLDER", "--no-figures")),
    ("report", command("report", "FOLDER")),
    ("study", command("study", "SCENE", "stiff", "-o", "FOLDER")),
    ("python", lambda scene, folder: print(hs.run(scene, output=folder).warnings)),
)


def note(folder: Path, name: str, content: bytes) -> None:
    """A line of the list of files that a command wrote."""
    line = json.dumps({"file": name, "sha256": hashlib.sha256(content).hexdigest()})
    with (folder / ".headstock-files").open("a") as listing:
        listing.write(f"{line}\n")


@pytest.mark.parametrize("job", JOBS, ids=[name for name, _ in JOBS])
def test_files_that_links_lead_to_stay(tmp_path: Path, job: Job) -> None:
    scene, folder, victim = tmp_path / "scene.toml", tmp_path / "out", tmp_path / "victim"
    scene.write_text(SCENE)
    hs.run(scene, output=folder)
    precious = {name: name.encode() for name in ("notes.csv", ".bashrc", "summary.json")}
    (victim / "tables").mkdir(parents=True)
    for name, content in precious.items():
        for place in (victim, victim / "tables"):
            (place / name).write_bytes(content)
    parts = ("tables", "figures", "modes", "volume")
    for part in parts:
        (folder / part).mkdir(exist_ok=True)
        (folder / part / "link").symlink_to(victim)
        for name, content in precious.items():
            (folder / part / f"link-{name}").symlink_to(victim / name)
            for text in (
                f"{part}/link/{name}",
                f"{part}/link/tables/{name}",
                f"{part}/link-{name}",
                f"{part}/./link/{name}",
                f"{part}//link/{name}",
                f"{part}/../../victim/{name}",
                str(victim / name),
            ):
                note(folder, text, content)
    job[1](scene, folder)
    left = {path: path.read_bytes() for path in victim.rglob("*") if path.is_file()}
    places = (victim, victim / "tables")
    assert left == {place / name: precious[name] for place in places for name in precious}


@pytest.mark.parametrize("job", JOBS, ids=[name for name, _ in JOBS])
def test_a_part_that_is_a_link_is_neither_emptied_nor_written_into(
    tmp_path: Path, job: Job
) -> None:
    scene, folder, victim = tmp_path / "scene.toml", tmp_path / "out", tmp_path / "victim"
    scene.write_text(SCENE)
    victim.mkdir()
    hs.run(scene, output=folder)
    for part in ("tables", "figures", "modes", "volume"):
        for file in (folder / part).glob("*"):
            file.unlink()
        if (folder / part).exists():
            (folder / part).rmdir()
        (folder / part).symlink_to(victim)
        (victim / f"{part}.csv").write_bytes(b"precious")
        note(folder, f"{part}/{part}.csv", b"precious")
    before = sorted(path.name for path in victim.iterdir())
    refused = pytest.raises(hs.HeadstockError, match="link")
    with refused if job[0] == "python" else contextlib.nullcontext():
        job[1](scene, folder)
    assert sorted(path.name for path in victim.iterdir()) == before


def test_a_list_with_a_second_name_elsewhere_is_not_written_into(tmp_path: Path) -> None:
    scene, folder, victim = tmp_path / "scene.toml", tmp_path / "out", tmp_path / "diary.txt"
    scene.write_text(SCENE)
    victim.write_text("dear diary\n")
    folder.mkdir()
    (folder / ".headstock-files").hardlink_to(victim)
    hs.run(scene, output=folder)
    assert (folder / "summary.json").is_file()
    assert victim.read_text() == "dear diary\n"
