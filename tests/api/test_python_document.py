"""docs/python.md names every public name and no other, and its code runs; so does README's."""

import ast
import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import headstock as hs
from common import approx

pytestmark = [pytest.mark.process, pytest.mark.fem]

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = ROOT / "docs" / "notebooks"
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


@pytest.fixture
def run_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[object]]:
    """Runs a notebook from its folder, with nothing else beside the shipped files."""
    pytest.importorskip("pandas")
    (tmp_path / "docs" / "notebooks").mkdir(parents=True)
    for name in ("machines", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path / "docs" / "notebooks")
    monkeypatch.setenv("MPLBACKEND", "agg")

    def run(name: str) -> list[object]:
        notebook = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text())
        cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
        shown = run_cells(["".join(cell["source"]) for cell in cells])
        assert list((tmp_path / "docs" / "notebooks").iterdir()) == []
        return shown

    return run


def test_the_first_notebook_runs_from_its_folder(
    run_notebook: Callable[[str], list[object]],
) -> None:
    modes, budget, study, _, arrays = run_notebook("first_machine")
    assert repr(modes).count("reference")
    assert repr(budget).startswith("z_drive")
    # a drive is a spring in series: compliances differ by 1/15 - 1/25 um/N
    compliance = list(study["compliance [um/kN]"])  # type: ignore[index]
    assert compliance[0] - compliance[1] == approx(1e3 * (1 / 15 - 1 / 25), rel=1e-6)
    assert isinstance(arrays, list)
    assert "mode 01 shape [m/sqrt(kg)]" in arrays


TRIAL = pytest.mark.trials


@pytest.mark.parametrize(
    "name",
    [
        "frf_and_chatter",
        pytest.param("mesh_convergence", marks=TRIAL),
        pytest.param("step_part", marks=TRIAL),
        pytest.param("workspace", marks=TRIAL),
    ],
)
def test_a_notebook_runs_from_its_folder(
    name: str, run_notebook: Callable[[str], list[object]]
) -> None:
    shown = run_notebook(name)
    assert shown
    # poses that are reached
    assert name != "workspace" or shown[0] == 21


def test_every_notebook_has_its_test_and_its_place_in_the_site() -> None:
    names = {path.stem for path in NOTEBOOKS.glob("*.ipynb")}
    text, site = Path(__file__).read_text(), (ROOT / "mkdocs.yml").read_text()
    assert names
    assert all(f'"{name}"' in text and f"notebooks/{name}.md" in site for name in names)
