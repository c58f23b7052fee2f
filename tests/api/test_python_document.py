"""docs/python.md names every public name and no other, and its code runs; so does README's."""

import re
from pathlib import Path

import pytest

import headstock as hs

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "python.md"
SNIPPET = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)


def run_snippets(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Runs the Python of a page in a folder beside the shipped machines; how much there was."""
    (folder / "machines").symlink_to(ROOT / "machines")
    monkeypatch.chdir(folder)
    snippets = SNIPPET.findall(page.read_text())
    for number, snippet in enumerate(snippets):
        exec(compile(snippet, f"{page.name} {number + 1}", "exec"), {})
    return len(snippets)


def test_the_page_and_the_surface_have_the_same_names() -> None:
    table = PAGE.read_text().partition("## Public names")[2].partition("\n\nEverything else")[0]
    cells = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    found = {re.match(r"\w+", code)[0] for cell in cells for code in re.findall("`([^`]+)`", cell)}  # type: ignore[index]
    assert found == set(hs.__all__)


def test_the_code_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas")
    assert run_snippets(PAGE, tmp_path, monkeypatch) == 5


def test_a_hundred_variants_take_ten_lines_of_the_readme(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pandas")
    assert run_snippets(ROOT / "README.md", tmp_path, monkeypatch) == 1
    (snippet,) = SNIPPET.findall((ROOT / "README.md").read_text())
    assert len(snippet.splitlines()) <= 10
    assert "100" in capsys.readouterr().out
