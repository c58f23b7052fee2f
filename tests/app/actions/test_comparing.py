"""``headstock compare`` prints one table, writes its files, and refuses what it cannot do before it
begins.
"""

import html
import re
from pathlib import Path

import pytest

from common import Shell, approx
from fixture_machines import machine
from headstock.app.texts.bounded_values import show_bound, show_bounded
from headstock.pipeline.numbers.folders import read_run_numbers

SCENE = machine("""
machine = "block"
names = { block = "bar" }
name = "A bar on springs"
components.bar.solid = { box = ["40 mm", "60 mm", "500 mm"] }
components.bar.fidelity = "segmented"
joints.mount.kind = "mount"
joints.mount.stiffness = { vertical = "200 N/um", horizontal = "60 N/um", tilt = "1 kN m/mrad", torsion = "4 kN m/mrad" }
poses.home = {}
variants.R = { "components.bar.fidelity" = "rigid" }
variants.thick = { "components.bar.solid.box" = ["50 mm", "60 mm", "500 mm"] }
""")

LOBES = """
[analyses.lobes]
mill = { diameter = "20 mm", teeth = 4 }
radial_depth = "5 mm"
material = "al7075-t6"
speeds = ["3000 rpm", "15000 rpm", 20]
"""


COMPARE = "compare scene.toml -o out"


@pytest.fixture
def bar(shell: Shell) -> Shell:
    shell.write(SCENE)
    return shell


def test_one_table_tells_modes_compliances_weak_links_dofs_and_seconds(bar: Shell) -> None:
    printed = bar(f"{COMPARE} --json copy.json").out
    titles = ("MAC 1.00", "dx/Fx", "weak link z", "dofs solved for", "seconds from scene", "–")
    assert [
        text for text in ("as written", "R", "thick", "mount", *titles) if text not in printed
    ] == []
    summary = bar.json("out/compare.json")
    assert bar.json("copy.json") == summary
    assert set(summary) == {
        *("scene", "format", "pose", "reference", "mac_threshold", "modes", "columns", "variants"),
        *("not_computed", "verdicts", "not_compared", "provenance"),
    }
    # every frequency of the reference is printed as the file has it
    cells = [row["variants"]["as written"] for row in summary["modes"]]
    known = [cell for cell in cells if cell is not None]
    shown = [show_bounded(cell["frequency_hz"], cell["error_hz"]) for cell in known]
    assert shown and [text for text in shown if text not in printed] == []
    pages = {"compare.html", "compare.json", "frequencies.png", "compliances.png"}
    assert bar.files("out") >= pages | {"modes.csv", "compliances.csv", "variants.csv"}


@pytest.mark.trials
def test_other_analyses_are_compared_as_run_finds_them(shell: Shell) -> None:
    mill = (Path(__file__).parents[2] / "data" / "mill.toml").read_text()
    soft = '[variants.soft]\n"joints.x_screw.stiffness.axial" = "75 N/um"\n'
    shell.write(mill + LOBES + soft, ('side = "40 mm"', 'side = "12 mm"'))
    printed = shell(COMPARE).out
    assert "Limit depth of cut [mm]" in printed and "Profiles of faces [µm]" in printed
    variants = shell.json("out/compare.json")["variants"]
    shell("run scene.toml -o run --variant soft")
    found = read_run_numbers(shell.folder / "run")
    others = variants["soft"]["others"]
    assert {"limit depth of cut", "profiles of faces"} <= set(others)
    for entries in others.values():
        for name, other in entries.items():
            unit, factor = found[name].shown
            assert other["unit"] == unit
            assert other["value"] == approx(factor * found[name].value, rel=1e-9), name
    # along y the screw of X says nothing of where a face lies
    stiff = variants["as written"]["others"]["profiles of faces"]
    name = "profile(face=1,figure=location_error)"
    assert others["profiles of faces"][name]["value"] > 1.1 * stiff[name]["value"]
    rows = shell.rows("out/others.csv")
    assert {"limit depth of cut", "profiles of faces"} <= {row["answer"] for row in rows}
    assert name in {row["entry"] for row in rows}


def test_csv_and_page_hold_the_unrounded_numbers_of_the_json(bar: Shell) -> None:
    bar(f"{COMPARE} --variants 'R,as written'")
    modes, rows = bar.json("out/compare.json")["modes"], bar.rows("out/modes.csv")
    assert len(rows) == len(modes)
    page = bar.text("out/compare.html")
    for row, wanted in zip(rows, modes, strict=True):
        cell = wanted["variants"]["R"]
        assert row["R [Hz]"] == ("" if cell is None else repr(cell["frequency_hz"]))
        assert cell is None or f'value="{cell["frequency_hz"]!r}"' in page
    assert not re.search(r'(src|href)="(?!data:|#)', page)


def test_effort_begins_with_an_empty_store_and_shows_the_changed_model_too(bar: Shell) -> None:
    options = "--variants 'as written' --fidelity rigid,segmented --effort --change thick"
    printed = bar(f"{COMPARE} {options}").out
    assert "Effort from scene to answers, from an empty store, then with thick" in printed
    assert "CPU s" in printed
    effort = bar.json("out/compare.json")["effort"]
    assert effort["change"] == ["thick"] and list(effort["variants"]) == ["rigid", "segmented"]
    for runs in effort["variants"].values():
        assert list(runs) == ["first", "changed"]
        *parts, total = runs["first"]["seconds"].values()
        assert total == approx(sum(parts), abs=1e-3)
    assert "store" not in bar.files()


CHOSEN = '[compare]\nvariants = ["thick", "R"]\npose = "home"\nreference = "R"\n'


@pytest.mark.parametrize(
    ("options", "columns", "reference"),
    [
        ("", ["thick", "R"], "R"),
        ("--variants 'thick,as written'", ["thick", "as written"], "thick"),
    ],
)
def test_a_scene_says_itself_what_to_compare_and_the_command_line_comes_first(
    bar: Shell, options: str, columns: list[str], reference: str
) -> None:
    bar.change(add=CHOSEN)
    bar(f"{COMPARE} {options}")
    summary = bar.json("out/compare.json")
    assert (list(summary["variants"]), summary["reference"]) == (columns, reference)


ALONG = "--set components.bar.segments.along=x --set"
TUBE = """'components.bar.solid={tube={outer="1 m",length="2 m"}}'"""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--variants Q", "unknown variant 'Q'"),
        ("--fidelity stiff", "there is no fidelity 'stiff'"),
        ("--pose away", "there is no pose 'away'"),
        ("--reference Q", "there is no variant 'Q'"),
        ("--effort --change components.bar.mass=heavy", "heavy"),
        (f"{ALONG} {TUBE}", "along z only"),
    ],
)
def test_what_cannot_be_compared_ends_with_2_and_writes_nothing(
    bar: Shell, options: str, message: str
) -> None:
    assert message in bar(f"{COMPARE} {options}", code=2).err
    assert "out" not in bar.files()


def test_a_static_analysis_that_is_refused_ends_with_1_and_the_modes_are_there(bar: Shell) -> None:
    bar.change(('vertical = "200 N/um", horizontal = "60', 'vertical = "0 N/um", horizontal = "0'))
    printed = bar(f"{COMPARE} --variants R", code=1).out
    assert "failed: R: static analysis" in printed and "Natural frequencies" in printed


def test_the_baseline_is_a_column_unless_it_is_refused(bar: Shell) -> None:
    bar(f"{COMPARE} --variants thick")
    found = bar.json("out/compare.json")
    assert found["columns"] == ["as written", "thick"] and found["reference"] == "as written"
    written, thick = (found["modes"][0]["variants"][name] for name in ("as written", "thick"))
    assert thick["deviation"] == approx(thick["frequency_hz"] / written["frequency_hz"] - 1.0)
    bar(f"{COMPARE} --variants thick --no-baseline")
    assert bar.json("out/compare.json")["columns"] == ["thick"]


def test_a_baseline_without_an_answer_leaves_the_others_theirs(bar: Shell) -> None:
    spring = SCENE[SCENE.index('kind = "mount"') : SCENE.index("[points.tcp]")]
    bar.change((spring, 'kind = "rigid"\n'), ('fidelity = "segmented"', 'fidelity = "rigid"'))
    bar.change(('"rigid"\n[variants.thick]', '"segmented"\n[variants.thick]'))
    printed = bar(f"{COMPARE} --variants R").out
    summary = bar.json("out/compare.json")
    assert summary["columns"] == ["as written", "R"] and list(summary["variants"]) == ["R"]
    assert "as written" in summary["not_computed"] and "as written" in printed
    bar(f"{COMPARE} --variants 'R,as written'", code=1)


ELASTIC = (
    'fidelity = "elastic"\nmesh = { size = "20 mm", cells = "hex" }\nreduction = { modes = 10 }'
)


def test_a_comparison_states_the_errors_that_a_run_of_each_variant_states(bar: Shell) -> None:
    bar.change(('fidelity = "segmented"', ELASTIC))
    printed = bar.prints(f"{COMPARE} --variants 'as written,R'")
    bar("run scene.toml -o run --no-figures")
    summary, alone = bar.json("out/compare.json"), bar.json("run/summary.json")
    variant, rigid = (summary["variants"][name] for name in ("as written", "R"))
    found, point = variant["static"]["tcp"], alone["static"]["tcp"]
    # the same estimates, but for more modes kept in the search
    assert variant["error_hz"] == approx(alone["modal"][0]["error_hz"], rel=1e-6)
    assert min(variant["error_hz"]) > 0.0
    assert found["error_um_per_kN"] == approx(point["error_um_per_kN"], rel=1e-6)
    # nothing is known of how far a rigid model is off
    assert set(rigid["error_hz"]) == {None}
    assert rigid["error_share"] == [{}] * len(rigid["error_hz"])
    assert rigid["error_left_out"] == ["rigid model of bar"]
    page = html.unescape(bar.text("out/compare.html"))
    shown = list(zip(variant["frequencies_hz"], variant["error_hz"], strict=True))
    shown += [
        (found["compliance_um_per_kN"]["xyz".index(direction)]["xyz".index(direction)], error)
        for direction, error in found["error_um_per_kN"].items()
    ]
    for value, error in shown:
        assert f"{show_bounded(value, error)} {show_bound(value, error)}" in printed
        assert f'<data class="bound" value="{error!r}">' in page
    for text in (
        "as written: ± covers 95 % of errors, from discretisation up to",
        "R: not in ±: rigid model of bar",
    ):
        assert text in printed and text in page
    known, unknown = printed.count("not in ±: rigid model of bar"), printed.count("± ?")
    assert (known, unknown) == (1, len(rigid["error_hz"]) + 3)
    row = bar.rows("out/modes.csv")[0]
    assert float(row["as written ± [Hz]"]) >= variant["error_hz"][0] and row["R ± [Hz]"] == ""
    rows = [row for row in bar.rows("out/compliances.csv") if row["as written ± [um/kN]"]]
    assert [(row["motion in"], row["force in"]) for row in rows] == [(d, d) for d in "xyz"]


DAMPED = """
[analyses.frf]
up_to = "900 Hz"
points = 5
outputs = ["tcp"]
[effects]
damping = { modal = 0.02 }
"""


@pytest.mark.parametrize("fidelity", ["rigid", "segmented"])
def test_a_run_of_rigid_or_segmented_parts_states_no_errors(bar: Shell, fidelity: str) -> None:
    bar.change(('fidelity = "segmented"', f'fidelity = "{fidelity}"'), add=DAMPED)
    printed = bar("run scene.toml -o out --no-figures").out
    summary = bar.json("out/summary.json")
    (modes,), (response,) = summary["modal"], summary["frf"].values()
    assert set(modes["error_hz"]) == {None} and response["error"] is None
    assert "± <" not in printed and "± covers" not in printed
    assert f"not in ±: {fidelity} model of bar" in printed
    tables = list((bar.folder / "out" / "tables").glob("modes_*.csv"))
    assert tables
    for table in tables:
        assert {row["± [Hz]"] for row in bar.rows(str(table))} == {""}
