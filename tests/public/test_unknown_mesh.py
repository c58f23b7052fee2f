"""A source of error that nobody knows leaves what is known of ±, marked as incomplete everywhere."""

import html

import pytest

import headstock as hs
from common import Shell, approx
from fixture_machines import stored_scene

BAR = stored_scene("unknown_mesh_bar")
COLUMN = "modal.error_hz[0]"
APART = "± known, unknown sources apart [Hz]"


@pytest.fixture
def bar(shell: Shell) -> Shell:
    shell.write(BAR)
    return shell


def modes_table(bar: Shell) -> dict[str, str]:
    """The first row of the table of modes of a run."""
    (table,) = (bar.folder / "out" / "tables").glob("modes_*.csv")
    return bar.rows(str(table))[0]


def test_a_study_shows_the_known_part_of_every_error_and_what_it_lacks(bar: Shell) -> None:
    printed = bar.prints("study scene.toml modes -o out")
    rows = bar.rows("out/study.csv")
    known = [float(row[f"{COLUMN} without unknown sources"]) for row in rows]
    assert len(known) == 4 and min(known) > 0.0
    # the more modes are kept the less the reduction leaves out, and no bound is claimed
    assert known[0] > known[1] >= known[2] > known[3]
    assert [row[COLUMN] for row in rows] == [""] * 4
    found = [float(row["modal.frequencies_hz[0]"]) for row in rows]
    # what is known is the reduction's: it covers the distance to the most modes
    for hz, error in zip(found, known, strict=True):
        assert 0.0 <= hz - found[-1] <= error
    assert printed.count(" + ?") >= 4 and "+ ? : not in error_hz: discretisation" in printed
    assert "the mesh of bar" in printed
    assert [row["known"][COLUMN] for row in bar.json("out/study.json")["rows"]] == known


def test_a_study_in_python_has_the_known_part_in_a_column_of_its_own(bar: Shell) -> None:
    table = hs.study("scene.toml", vary={"components.bar.reduction.modes": [0, 1]}, watch=[COLUMN])
    assert len(table.rows) == 2
    assert all(row.values[COLUMN] is None and row.known[COLUMN] > 0.0 for row in table.rows)
    assert all("discretisation" in " ".join(row.unknown) for row in table.rows)


def test_a_run_marks_an_error_with_an_unknown_source_wherever_it_shows_it(bar: Shell) -> None:
    printed = bar.prints("run scene.toml --no-figures -o out")
    assert " + ? bar bends" in printed and "± .. + ? : parts take part" in printed
    # nothing covers 95 % of errors here
    assert "covers 95 %" not in printed and "known of ±, not all: reduction up to" in printed
    page = html.unescape(bar.text("out/report.html"))
    assert " + ?</span>" in page and "known of ±, not all: reduction up to" in page
    modes = bar.json("out/summary.json")["modal"][0]
    assert modes["error_hz"] == [None, None]
    assert [share["discretisation"] for share in modes["error_share"]] == [None, None]
    row = modes_table(bar)
    assert row["± [Hz]"] == "" and float(row[APART]) > 0.0
    results = hs.open("out")
    assert " + ?" in results._repr_html_()
    known = results.modal[0].list_errors()[0].known
    assert known == approx(modes["error_share"][0]["reduction"])


def test_an_error_of_known_sources_is_shown_as_before(bar: Shell) -> None:
    bar.change(('20 mm", cells', '10 mm", cells'))
    printed = bar("run scene.toml --no-figures -o out").out
    assert "+ ?" not in printed and "± covers 95 % of errors" in printed
    assert APART not in modes_table(bar)


def test_a_comparison_marks_the_variant_whose_mesh_is_unknown(bar: Shell) -> None:
    bar.change(add='[variants.fine]\n"components.bar.mesh.size" = "10 mm"\n')
    printed = bar.prints("compare scene.toml -o out")
    assert printed.count(" + ?") >= 2
    assert "as written: known of ±, not all: reduction" in printed
    assert "fine: ± covers 95 % of errors, from" in printed
    assert " + ?" in html.unescape(bar.text("out/compare.html"))
