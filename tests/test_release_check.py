"""A tree that is fit to be released passes ./headstock release-check, and each way to break one is
found by the check that is for it. Archives are built and tried in test_wheel.py.
"""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

import release_check

ROOT = Path(__file__).resolve().parent.parent
# what the checks read of a tree
READ = (
    *("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "LICENSE", "Dockerfile", "environment.yml"),
    *("environment", "app/report/viewer", "docs/javascripts", "tests/data", "machines"),
    *("app/report/response_cursor.js", "app/report/sweep_maps.js", "pipeline/exchange/fmu"),
)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of what the checks read."""
    for name in READ:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        copy: Callable[..., object] = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, tmp_path / name)
    return tmp_path


def problems(tree: Path) -> dict[str, tuple[str, ...]]:
    """What each check finds wrong with a tree of which every file is tracked."""
    files = [path.relative_to(tree).as_posix() for path in tree.rglob("*") if path.is_file()]
    return {row.name: row.wrong for row in release_check.check_tree(tree, files)}


def replace(name: str, pattern: str, text: str) -> Callable[[Path], None]:
    def change(tree: Path) -> None:
        path = tree / name
        changed, count = re.subn(pattern, text, path.read_text(), count=1, flags=re.MULTILINE)
        assert count == 1, f"{name} has no {pattern}"
        path.write_text(changed)

    return change


def write(name: str, text: str) -> Callable[[Path], None]:
    def change(tree: Path) -> None:
        (tree / name).write_text(text)

    return change


def remove(name: str) -> Callable[[Path], None]:
    return lambda tree: (tree / name).unlink()


# taken apart, because this file is searched, too
NOTICE = " ".join(("Copyright", "(c)", "2020", "Somebody"))
VERSION, PIP, LISTS, LICENCES = "version", "pip packages", "lists of packages", "licences"
NO_HASH = "python.txt: pandas has no hash, or one that is none"
BRACKET = "machines/bracket.step: whose is it?"
COPIED = f"machines/copied.py names a holder that no licence file does: {NOTICE}"
SUPPORT = "tests/data/support.LICENSE, the licence of tests/data/support.step, is"
SCRIPT = "license-files of pyproject.toml lacks app/report/viewer/LICENSES.txt"
# a change of a file: a pattern and what takes its place; the check that finds it, and its words
CHANGED = {
    "CITATION.cff": [(r"^version: .*", "version: 0.0.9", VERSION, "CITATION.cff says 0.0.9")],
    "CHANGELOG.md": [
        (r"^## \S+", "## 0.0.9", VERSION, "of 0.0.9, pyproject.toml"),
        (r"^(## \S+).*", r"\1 (2026-12-31)", VERSION, "date-released None, CHANGELOG.md 2026-12-31"),
    ],
    "environment/lint.txt": [(r"^ruff==\S+", "ruff", PIP, "lint.txt: ruff has no version")],
    "environment/python.txt": [(r"--hash=sha256:\w{60}", "--hash=sha256:", PIP, NO_HASH)],
    "environment/packages.txt": [
        (r"^python3-gmsh$", "python3-gmsh\ngmsh-tools", LISTS, "environment.yml lacks gmsh-tools, packages.txt has gmsh-tools"),
    ],
    "environment.yml": [
        (r"^  - metis$", "  - metis\n  - petsc-tools=3", LISTS, "environment.yml has petsc-tools, packages.txt has nothing"),
    ],
    "pyproject.toml": [
        (r'^dependencies = \["numpy', 'dependencies = ["sympy>=1", "numpy', LISTS, "packages.txt lacks sympy, pyproject.toml has it"),
        (r"^license-files = .*", 'license-files = ["LICENSE"]', LICENCES, SCRIPT),
    ],
    "Dockerfile": [
        (r"^FROM debian:13", "FROM debian:12", LISTS, "begins with another Debian"),
        (r"&& rm -rf", r"\&\& apt-get install -y python3-sympy \\\n    \&\& rm -rf", LISTS, "the Dockerfile names packages itself"),
    ],
    "app/report/viewer/package.json": [
        (r'"three": "[^"]*"', '"three": "0.999.0"', LICENCES, "was not packed from three 0.999.0"),
    ],
}  # fmt: skip
Change = Callable[[Path], object]
BROKEN: list[tuple[Change, str, str]] = [
    (replace(name, pattern, text), check, words)
    for name, changes in CHANGED.items()
    for pattern, text, check, words in changes
]
BROKEN += [
    (
        write("environment/docs.txt", f"vtk==9.0.0 --hash=sha256:{'0' * 64}\n"),
        *(PIP, "vtk has several versions in one command: "),
    ),
    (write("machines/bracket.step", "ISO-10303-21;\n"), LICENCES, BRACKET),
    (write("machines/copied.py", f"# {NOTICE}\n"), LICENCES, COPIED),
    (remove("tests/data/support.LICENSE"), LICENCES, SUPPORT),
]


def test_this_tree_passes(tree: Path) -> None:
    assert set(problems(tree).values()) == {()}


@pytest.mark.parametrize(("change", "check", "message"), BROKEN, ids=[row[2] for row in BROKEN])
def test_what_is_broken_is_found_by_its_check_alone(
    tree: Path, change: Change, check: str, message: str
) -> None:
    change(tree)
    found = problems(tree)
    assert any(message in text for text in found.pop(check))
    assert set(found.values()) == {()}


def test_a_section_without_a_date_is_open_and_no_failure(tree: Path) -> None:
    replace("CHANGELOG.md", r"^(## \S+).*", r"\1 (not yet released)")(tree)
    row = release_check.check_version(tree)
    assert row.wrong == ()
    assert "give the section of" in row.open[0]
    replace("CHANGELOG.md", r"^(## \S+).*", r"\1 (2026-12-31)")(tree)
    replace("CITATION.cff", r"^(version: .*)", r"\1\ndate-released: 2026-12-31")(tree)
    row = release_check.check_version(tree)
    assert (row.wrong, row.open) == ((), ())
    lines = list(release_check.describe([row, release_check.Row("wheel", "x.whl", ("bad",))]))
    assert [line.split()[0] for line in lines] == ["ok", "FAILS", "-"]


def test_workflow_and_templates_ask_for_what_they_are_to() -> None:
    folder = ROOT / ".github"
    if not folder.is_dir():
        pytest.skip("archives of the source have no .github")
    workflow = yaml.safe_load((folder / "workflows" / "checks.yml").read_text())
    steps = [step.get("run", "") for job in workflow["jobs"].values() for step in job["steps"]]
    assert ".ci/run" in steps
    required = {
        field["id"]: field["attributes"]["label"]
        for field in yaml.safe_load((folder / "ISSUE_TEMPLATE" / "bug.yml").read_text())["body"]
        if field.get("validations", {}).get("required")
    }
    assert {"command", "scene", "doctor", "version"} <= set(required)
    assert "./headstock doctor" in required["doctor"]
    feature = yaml.safe_load((folder / "ISSUE_TEMPLATE" / "feature.yml").read_text())
    assert len(feature["body"]) > 2
