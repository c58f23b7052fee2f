"""What a command says it wrote is there, and a file of the wrong kind is called that."""

import fnmatch
import re
from pathlib import Path

import pytest
from cross_slide import ANALYSES, SCENE, TARGETS

from common import run_alone
from fixture_machines import machine

ROOT = Path(__file__).resolve().parents[2]
# as documents and `--help` write files: a word in capitals stands for a name
NAMED_FILE = re.compile(
    r"[`/ ](?!self\.)((?:[a-z]+/)?\w+\.(?:csv|html|h5|jsonl?|png|pvd|vtu|glb))[`,. \"]"
)
STANDS_FOR = re.compile(r"[A-Z]{2,}|(?<=_)N(?=\.)")
# of other programs; examples of what a name in capitals stands for; what needs controlled drives, a
# study of costs or an elastic machine that mills
NO_OUTPUT = {
    *("dolfinx_jit_options.json", "ffcx_options.json"),
    *("tables/path_600.csv", "tables/path_3000.csv", "results/report.html", "show/three_axis.png"),
    *("tables/motors_path_FEED.csv", "cost.csv", "cost.png", "tables/probes_contour.csv"),
}
PROBED = """
[probes.top]
component = "part"
at = ["0 mm", "0 mm", "50 mm"]
[effects]
damping = { modal = "2 %" }
[analyses.modal]
count = 1
[analyses.frf]
inputs = [["tcp", "x"]]
up_to = "300 Hz"
points = 5
[analyses.transient]
loads.push = { at = ["tcp", "x"], shape = "step", size = "1 N" }
duration = "5 ms"
"""

CANTILEVER = machine("""
machine = "bar"
names = { bar = "part" }
components.part.solid = { box = ["40 mm", "40 mm", "100 mm"] }
components.part.mesh = { size = "40 mm", cells = "hex" }
analyses.static = { at = "tcp" }
""")
UFF = "    -1\n   151\nmodal test\n    -1\n"


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "scene.toml").write_text(CANTILEVER)
    (tmp_path / "measured.uff").write_text(UFF)
    (tmp_path / "targets.toml").write_text(
        '[cases.a]\ntolerance = "1 %"\nfrequencies = ["60 Hz"]\n[parameters.E]\nkeys = ["materials.steel.E"]\n'
        'bounds = ["100 GPa", "300 GPa"]\n'
    )
    return tmp_path / "scene.toml"


def test_every_file_that_converge_names_is_there(scene: Path) -> None:
    """With few meshes no number has a limit, and nothing is drawn."""
    out = scene.parent / "out"
    words = ["converge", str(scene), "--most-dofs", "1000", "-o", str(out)]
    done = run_alone(scene.parent, *words)
    named = re.search(r"results in .* \((.*)\)", done.stdout.replace("\n", " "))
    assert done.returncode == 0 and named is not None, done.stdout + done.stderr
    names = named[1].split(", ")
    assert "convergence.csv" in names
    assert [name for name in names if not (out / name).is_file()] == []
    assert not (out / "convergence.png").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["identify", "scene.toml", "measured.uff"], "targets are read from a .toml file"),
        (["identify", "scene.toml", "measured.uff"], "of a UFF file into [cases.NAME]"),
        (["identify", "scene.toml", "scene.toml"], "is a scene, not a target file"),
        (["identify", "targets.toml", "scene.toml"], "headstock identify SCENE TARGETS"),
        (["run", "targets.toml"], "is a target file, not a scene"),
        (["check", "part.step"], "`headstock new FOLDER --part FILE` writes one"),
        (["run", "part.med"], "`headstock new FOLDER --part FILE` writes one"),
        (["report", "scene.toml"], "is a file; name the folder that a run has written"),
    ],
)
def test_a_file_of_the_wrong_kind_is_called_that(scene: Path, words: list[str], said: str) -> None:
    command, *files = words
    done = run_alone(scene.parent, command, *(str(scene.parent / file) for file in files))
    assert done.returncode == 2
    assert said in " ".join((done.stdout + done.stderr).split())


def test_every_file_that_documents_and_help_name_is_written(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = scene.parent
    monkeypatch.chdir(folder)
    tables = "".join(
        f"[analyses.{name}]\n{table}\n" for name, (_, table) in ANALYSES.items() if table
    )
    Path("slide.toml").write_text(
        SCENE.replace("guide_errors", "cutting_force = true\nguide_errors") + tables
    )
    some = "".join(f"[analyses.{name}]\n{ANALYSES[name][1]}\n" for name in ("frf", "lobes"))
    # without what takes long
    Path("bare.toml").write_text(SCENE)
    Path("plain.toml").write_text(SCENE + some)
    Path("fit.toml").write_text(TARGETS)
    Path("probed.toml").write_text(CANTILEVER + PROBED)
    for words in (
        "run slide.toml -o run",
        "report run",
        "run probed.toml -o probed --volume --no-figures",
        "numbers run --csv numbers.csv",
        "sweep plain.toml line -o sweep",
        "study bare.toml drive -o study",
        "compare plain.toml -o compare",
        "effects scene.toml --only effects --json effects.json --page effects.html",
        "identify bare.toml fit.toml -o identify",
        "converge scene.toml -o converge",
        "show bare.toml",
    ):
        done = run_alone(folder, *words.split())
        assert done.returncode == 0, done.stdout + done.stderr
    written = [str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()]
    sources = [*ROOT.glob("docs/*.md"), ROOT / "README.md", *ROOT.glob("app/commands/*.py")]
    named = {name for source in sources for name in NAMED_FILE.findall(source.read_text())}
    assert len(named) > 30
    missing = {
        name
        for name in named - NO_OUTPUT
        if not fnmatch.filter(written, f"*{STANDS_FOR.sub('*', name)}")
    }
    assert missing == set()
