"""What a command says it wrote is there, and a file of the wrong kind is called that."""

import fnmatch
import re
from pathlib import Path

import pytest
from cross_slide import ANALYSES, SCENE, TARGETS

from common import Shell, present
from fixture_machines import machine, stored_scene, targets

ROOT = Path(__file__).resolve().parents[2]
# as documents and `--help` write files: a word in capitals stands for a name
NAMED_FILE = re.compile(
    r"[`/ ](?!self\.)((?:[a-z]+/)?\w+\.(?:csv|html|h5|jsonl?|png|pvd|vtu|glb))[`,. \"]"
)
STANDS_FOR = re.compile(r"[A-Z]{2,}|(?<=_)N(?=\.)")
# of other programs; examples of what a name in capitals stands for; what needs controlled drives, a
# study of costs, an assembly or an elastic machine that mills
NO_OUTPUT = {
    *("dolfinx_jit_options.json", "ffcx_options.json"),
    *("tables/path_600.csv", "tables/path_3000.csv", "results/report.html", "show/three_axis.png"),
    *("tables/guard_frequencies.csv", "machines/three_axis_push.csv"),
    *("tables/motors_path_FEED.csv", "cost.csv", "cost.png", "tables/probes_contour.csv"),
    *("tables/guard_bands.csv", "left_out.csv"),
}
PROBED = stored_scene("named_files_probed")

CANTILEVER = machine("""
machine = "bar"
names = { bar = "part" }
components.part.solid = { box = ["40 mm", "40 mm", "100 mm"] }
components.part.mesh = { size = "40 mm", cells = "hex" }
analyses.static = { at = "tcp" }
""")
UFF = "    -1\n   151\nmodal test\n    -1\n"
TARGET = targets(60, E="materials.steel.E: 100 GPa, 300 GPa")


@pytest.fixture
def part(shell: Shell) -> Shell:
    shell.write(CANTILEVER)
    shell.write(TARGET, name="targets")
    (shell.folder / "measured.uff").write_text(UFF)
    return shell


def test_every_file_that_converge_names_is_there(part: Shell) -> None:
    """With few meshes no number has a limit, and nothing is drawn."""
    printed = part.prints("converge scene.toml --most-dofs 1000 -o out")
    named = present(re.search(r"results in .* \((.*)\)", printed))
    names = named[1].split(", ")
    assert "convergence.csv" in names
    assert set(names) <= part.files("out")
    assert "convergence.png" not in part.files("out")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("identify scene.toml measured.uff", "targets are read from a .toml file"),
        ("identify scene.toml measured.uff", "of a UFF file into [cases.NAME]"),
        ("identify scene.toml scene.toml", "is a scene, not a target file"),
        ("identify targets.toml scene.toml", "headstock identify SCENE TARGETS"),
        ("run targets.toml", "is a target file, not a scene"),
        ("check part.step", "`headstock new FOLDER --part FILE` writes one"),
        ("run part.med", "`headstock new FOLDER --part FILE` writes one"),
        ("report scene.toml", "is a file; name the folder that a run has written"),
    ],
)
def test_a_file_of_the_wrong_kind_is_called_that(part: Shell, line: str, said: str) -> None:
    assert said in part.refuses(line)


def test_every_file_that_documents_and_help_name_is_written(part: Shell) -> None:
    tables = {name: f"[analyses.{name}]\n{table}\n" for name, (_, table) in ANALYSES.items()}
    asked = "".join(tables[name] for name, (_, table) in ANALYSES.items() if table)
    part.write(SCENE + asked, ("guide_errors", "cutting_force = true\nguide_errors"), name="slide")
    # without what takes long
    part.write(SCENE, name="bare")
    part.write(SCENE + tables["frf"] + tables["lobes"], name="plain")
    part.write(TARGETS, name="fit")
    part.write(CANTILEVER + PROBED, name="probed")
    for line in (
        "run slide.toml -o run",
        "report run",
        "run probed.toml -o probed --volume --no-figures",
        "numbers run --csv numbers.csv",
        "sweep plain.toml line -o sweep",
        "study bare.toml drive -o study",
        "compare plain.toml -o compare",
        "effects scene.toml --only effects --json effects.json --page effects.html",
        "identify bare.toml fit.toml -o identify",
        "export plain.toml --uff tested.uff --set analyses.frf.points=80",
        "correlate plain.toml tested.uff -o correlate",
        "modes tested.uff -o modes",
        "converge scene.toml -o converge",
        "show bare.toml",
    ):
        part(line)
    folder = part.folder
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
