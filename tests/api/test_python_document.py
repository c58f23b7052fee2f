"""docs/python.md names every public name and no other, and its code runs; so does README's."""

import ast
import json
import re
from pathlib import Path

import pytest

import headstock as hs

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "docs" / "example.ipynb"
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


def run_cells(cells: list[str]) -> list[object]:
    """Runs cells one after the other as a notebook does; what each shows at its end."""
    namespace: dict[str, object] = {}
    shown = []
    for number, cell in enumerate(cells):
        tree = ast.parse(cell.rstrip().removesuffix(";"), f"cell {number + 1}")
        *body, last = tree.body
        exec(compile(ast.Module(body, []), f"cell {number + 1}", "exec"), namespace)
        if isinstance(last, ast.Expr):
            shown.append(eval(compile(ast.Expression(last.value), "", "eval"), namespace))
        else:
            exec(compile(ast.Module([last], []), f"cell {number + 1}", "exec"), namespace)
    return shown


def test_the_notebook_runs_from_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pandas = pytest.importorskip("pandas")
    (tmp_path / "machines").symlink_to(ROOT / "machines")
    (tmp_path / "docs").mkdir()
    monkeypatch.chdir(tmp_path / "docs")
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = json.loads(NOTEBOOK.read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    modes, budget, study, _, arrays = run_cells(["".join(cell["source"]) for cell in cells])
    assert isinstance(modes, pandas.DataFrame)
    assert isinstance(study, pandas.DataFrame)
    assert repr(budget).startswith("z_drive")
    # a drive is a spring in series: compliances differ by 1/15 - 1/25 um/N
    compliance = list(study["compliance [um/kN]"])
    assert compliance[0] - compliance[1] == pytest.approx(1e3 * (1 / 15 - 1 / 25), rel=1e-6)
    assert isinstance(arrays, list)
    assert "mode 01 shape [m/sqrt(kg)]" in arrays
    assert [path.name for path in Path.cwd().iterdir()] == []
