"""What README and tutorial tell the reader to type works, and what is generated is up to date."""

import ast
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from common import place_launcher, run_in, run_process
from headstock.app.actions.cataloguing import _render_catalogue, _render_cutting
from headstock.app.actions.schemas import _render_reference, _render_units, plain_schema, rules_in
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.results.files import read_mesh
from headstock.scene.expansion.catalogue import read_catalogue, read_cutting_materials
from headstock.scene.reading.units import measure_unit
from headstock.scene.schema.types import MEANING
from headstock.studies.identification.targets import TargetsTable

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = (
    "README.md",
    *(
        pytest.param(f"docs/{name}.md", marks=pytest.mark.trials)
        for name in ("hpc", "tutorial", "comparing", "show", "mesh_files", "assemblies")
    ),
)
BLOCK = re.compile(r"^```(\w+)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
# these would run the tests again, build an environment, or run for minutes; their own tests see to
# them
SKIPPED = re.compile(r"\./headstock (test|exec|validate)\b|docker |apt|git clone")
SECONDS = 300
TEXT_FOLDERS = ("docs", "benchmarks", "validation")
LEFT_OUT = re.compile(r"\A---\n(?s:.*?)\n---\n|^(?:\||    |#|<|\$\$).*$", re.MULTILINE)
LINK_TARGET = re.compile(r"\]\([^)]*\)")
CODE = re.compile(r"`[^`]*`")
# also at entries of lists, in lines (·) too
SENTENCE_END = re.compile(r"(?<=[.!?:])[)\"*_\]]*\s+|\n\s*\n|\n\s*(?:[-*]|\d+\.) | · ")
# write compared with, next to, rotation, friction, evaluate, report, uncertainty, constrained
IDIOMS = re.compile(
    r"\b(?:second[- ]roads?|(?:path|leg)[-_ ]roads?|the way is followed|worth|judge[sd]?|judging|told|tells?|"
    r"rub(?:s|bed|bing)?|march(?:es|ed|ing)?|what probes saw|feels?|let go|led|swings?|carried modes|beside|"
    r"(?<!inertia )relie(?:f|ves?|ved)|g[ia]ves? way|leaves? it open|held(?![- ]out)|called off|no longer refused|"
    r"better machines?|what stands behind)\b",
    re.IGNORECASE,
)


def blocks(document: str, language: str) -> list[str]:
    path = ROOT / document
    return [text for kind, text in BLOCK.findall(path.read_text()) if kind == language]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder in which the commands of a document can be typed without leaving anything in the
    real one.
    """
    for name in ("machines", "tests", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    return place_launcher(tmp_path)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_command_of_a_document_runs_as_typed(document: str, checkout: Path) -> None:
    shown = [text for text in blocks(document, "sh") if not SKIPPED.search(text)]
    assert shown
    for text in shown:
        run_in(checkout, "sh", "-eu", "-c", text)


def test_the_python_of_the_page_of_files_finds_the_arrays_of_its_table(checkout: Path) -> None:
    page = "docs/files.md"
    (command,), (program,) = blocks(page, "sh"), blocks(page, "python")
    run_in(checkout, "sh", "-eu", "-c", command)
    printed = run_in(checkout, sys.executable, "-P", "-c", program)
    summary = read_summary(checkout / "results" / "files")
    compliance = summary["static"]["tcp"]["compliance_um_per_kN"][0][0]
    assert printed == f"{compliance:.0f} um/kN\n"
    mesh = read_mesh(checkout / "results" / "files", "column")
    kept = [
        name for name in mesh.array_names if not re.search(r"mode (?!01)|static tcp [yz]", name)
    ]
    table = re.findall(r"^\| (`[^|]*`) \| (?:points|cells|field)", (ROOT / page).read_text(), re.M)
    stated = {name for row in table for name in re.findall(r"`([^`]+)`", row)}
    assert stated - set(kept) == {"damping ratios [1]"} and set(kept) <= stated


def test_the_reader_of_the_page_of_other_programs_finds_frequencies_and_their_errors(
    checkout: Path,
) -> None:
    page = "docs/exchange.md"
    (command,) = (text for text in blocks(page, "sh") if "--to h5" in text)
    (program,) = (text for text in blocks(page, "python") if "h5py" in text)
    assert len(program.strip().splitlines()) <= 30
    run_in(checkout, "sh", "-eu", "-c", command.replace(" -o", " --variant coarse -o"))
    printed = run_in(checkout, sys.executable, "-P", "-c", program)
    first, *lines = printed.splitlines()
    assert "front" in first and "36 dofs" in first
    values = [float(line.split()[0]) for line in lines]
    errors = [float(line.split()[3]) for line in lines]
    assert len(lines) == 6 and values == sorted(values) and values[0] > 100.0
    assert all(0.0 < error < 50.0 for error in errors)


def test_the_python_of_the_page_of_architecture_prints_what_it_shows(checkout: Path) -> None:
    page = "docs/architecture.md"
    _, shown = blocks(page, "text")
    program = "\n".join(blocks(page, "python"))
    assert run_in(checkout, sys.executable, "-P", "-c", program) == shown


def test_the_page_of_architecture_names_what_exists() -> None:
    page = (ROOT / "docs/architecture.md").read_text()
    named = re.findall(r"`((?:\w+/)+\w+\.py):([\w.]+)`", page)
    assert len(named) > 30
    assert [each for each in named if each[1] not in defined_in(ROOT / each[0])] == []


def defined_in(path: Path) -> set[str]:
    """Functions, classes, methods and constants of a module."""
    names: set[str] = set()
    for node in ast.parse(path.read_text()).body if path.is_file() else ():
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
            names |= {
                f"{node.name}.{each.name}"
                for each in getattr(node, "body", ())
                if isinstance(each, ast.FunctionDef)
            }
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return names


def test_the_cost_of_a_large_part_on_the_page_of_clusters_is_what_its_command_prints(
    tmp_path: Path,
) -> None:
    printed = run_in(tmp_path, sys.executable, str(ROOT / "benchmarks" / "large_model.py"))
    (total,) = re.findall(r"^all +(.*)$", printed, re.M)
    first, *_, longest, memory = total.split()
    page = " ".join((ROOT / "docs" / "hpc.md").read_text().split())
    assert f"take {int(first) / 60:.0f} to {int(longest) / 60:.0f} minutes and {memory} GB" in page


@pytest.mark.parametrize(
    ("page", "command", "render"),
    [
        ("scene_reference", "schema --markdown", lambda: _render_reference(plain_schema())),
        ("units", "schema units", _render_units),
        ("catalogue", "catalogue --markdown", lambda: _render_catalogue(read_catalogue().values())),
        (
            "cutting_coefficients",
            "catalogue cutting --markdown",
            lambda: _render_cutting(read_cutting_materials().values()),
        ),
    ],
)
def test_a_page_that_a_command_writes_is_up_to_date(
    page: str, command: str, render: Callable[[], str]
) -> None:
    path = ROOT / "docs" / f"{page}.md"
    assert path.read_text() == render(), f"./headstock {command} > docs/{page}.md"


def test_every_unit_on_the_page_of_units_is_read() -> None:
    rows = re.findall(r"^\| (`.*`) \| an? ", _render_units(), re.M)
    units = [unit for row in rows for unit in re.findall("`([^`]+)`", row)]
    assert {"mm", "um"}.isdisjoint(units) and {"m", "rpm", "psi"} <= {*units}
    assert [unit for unit in units if measure_unit(unit)[0] <= 0] == []


def test_no_cell_of_the_scene_reference_is_empty() -> None:
    rows = [line for line in _render_reference(plain_schema()).splitlines() if line.startswith("|")]
    assert len(rows) > 400
    cells = {row: re.split(r"(?<!\\)\|", row)[1:-1] for row in rows}
    assert [row for row, texts in cells.items() if not all(text.strip() for text in texts)] == []
    assert {len(texts) for texts in cells.values()} == {4}


def test_every_key_of_scenes_and_target_files_says_what_it_means() -> None:
    scene, targets = plain_schema(), TargetsTable.model_json_schema()
    tables = rules_in(scene, "$defs") | rules_in(targets, "$defs")
    tables |= {"Scene": scene, "Targets": targets}
    rules = {
        f"{name}.{key}": rule
        for name, table in tables.items()
        for key, rule in rules_in(table, "properties").items()
    }
    assert len(rules) > 400
    assert [key for key, rule in rules.items() if not rule.get(MEANING)] == []


@pytest.mark.parametrize(
    "document",
    [
        "README.md",
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        *sorted(
            f"{folder}/{path.name}"
            for folder in ("benchmarks", "docs", "validation")
            for path in (ROOT / folder).glob("*.md")
        ),
    ],
)
def test_links_of_a_document_lead_to_files(document: str) -> None:
    path = ROOT / document
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", path.read_text())
    local = [link for link in links if "://" not in link]
    assert local or document != "README.md", "no links are found where there are some"
    assert [link for link in local if not (path.parent / link).exists()] == []


@pytest.mark.trials
@pytest.mark.process
def test_the_site_builds_and_none_of_its_links_is_broken(tmp_path: Path) -> None:
    command = [str(ROOT / "headstock"), "docs", "--quick", "-o", str(tmp_path / "site")]
    done = run_process(command, timeout=SECONDS)
    assert done.returncode == 0, done.stderr[-2000:]
    pages = {path.stem for path in (tmp_path / "site").glob("*.html")}
    assert {path.stem for path in (ROOT / "docs").glob("*.md")} <= pages
    notebook = (tmp_path / "site" / "notebooks" / "first_machine.html").read_text()
    assert "hs.load" in re.sub(r"<[^>]*>", "", notebook)  # words of code have colours
    assert "identify" in (tmp_path / "site" / "api.html").read_text()
    # a script from a network: search was hidden where there is none
    assert 'src="http' not in (tmp_path / "site" / "index.html").read_text()


def test_the_list_of_hard_cases_is_what_their_tests_say_of_themselves() -> None:
    told = []
    for path in (ROOT / "tests").rglob("test_*.py"):
        text = path.read_text()
        if number := re.search(r'^pytestmark = .*hard\("(H\d\d)"\)', text, re.M):
            title = (ast.get_docstring(ast.parse(text)) or "").split("\n\n")[0]
            told.append(f"- [{number[1]}](../{path.relative_to(ROOT)}): {' '.join(title.split())}")
    page = (ROOT / "validation" / "hard_cases.md").read_text()
    assert sorted(told) == sorted(line for line in page.splitlines() if line.startswith("- "))
    assert {line[3:6] for line in told} == {f"H{number:02}" for number in range(1, 53)}


@pytest.mark.parametrize("document", ["README.md", "CONTRIBUTING.md", "docs/architecture.md"])
def test_files_that_a_document_names_exist(document: str) -> None:
    named = set(re.findall(r"`((?:\w+/)+[a-z]\w*\.(?:py|toml|md))`", (ROOT / document).read_text()))
    assert named
    assert {path for path in named if "NAME" not in path and not (ROOT / path).is_file()} == set()


def test_every_picture_of_the_documents_is_drawn_by_a_script_and_shown() -> None:
    site = ROOT / "docs" / "site"
    drawn = set(re.findall(r'"(\w+)": (?:Shot|Output|")', read_scripts(site)))
    # a picture per entry of a table, in a family of names
    drawings = (site / "pictures.py").read_text()
    for family, table in (("joint", "JOINTS"), ("patch", "PATCHES")):
        entries = drawings.split(f"\n{table}: ", 1)[1].split("\n}\n", 1)[0]
        drawn |= {f"{family}_{kind}" for kind in re.findall(r'^    "(\w+)": ', entries, re.M)}
    costs = (ROOT / "benchmarks" / "next_digit.py").read_text()
    drawn |= {f"cost_{name}" for name in re.findall(r'Case\(\s*"(\w+)"', costs)}
    pictures = {path.stem for path in (ROOT / "docs" / "images").iterdir()}
    assert pictures <= drawn, pictures - drawn
    texts = "".join(path.read_text() for path in (*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")))
    assert {name for name in pictures if f"images/{name}." not in texts} == set()


def test_sentences_of_the_documents_are_short() -> None:
    lengths = [
        (len(words), name, " ".join(words[:12]))
        for name, text in written_texts().items()
        for words in map(str.split, SENTENCE_END.split(text))
    ]
    assert len(lengths) > 1000
    long = sorted((each for each in lengths if each[0] > 35), reverse=True)
    assert [each for each in long if each[0] > 40] == []
    assert len(long) <= 20, long


def test_documents_speak_as_engineers_do() -> None:
    texts = written_texts()
    assert len(texts) > 40
    found = [(name, each[0]) for name, text in texts.items() for each in IDIOMS.finditer(text)]
    assert found == []


def written_texts() -> dict[str, str]:
    """What documents say in sentences: without code, tables, headings and targets of links."""
    paths = [ROOT / "environment" / "README.md", *ROOT.glob("*.md")]
    paths += [path for folder in TEXT_FOLDERS for path in (ROOT / folder).glob("*.md")]
    return {
        str(path.relative_to(ROOT)): CODE.sub("X", LINK_TARGET.sub("", LEFT_OUT.sub("\n\n", text)))
        for path in paths
        for text in [BLOCK.sub("\n\n", path.read_text())]
    }


def read_scripts(folder: Path) -> str:
    return "".join(path.read_text() for path in folder.glob("*_pictures.py"))
