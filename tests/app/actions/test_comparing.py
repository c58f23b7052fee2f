"""``headstock compare`` prints one table, writes its files, and refuses what it cannot do before it
begins.
"""

import csv
import html
import json
import re
from pathlib import Path
from typing import Any

import pytest

from common import approx, call
from fixture_machines import machine, write_scene
from headstock.app.command_line import main
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


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    path = write_scene(tmp_path, SCENE, name="bar")
    return path


def test_one_table_tells_modes_compliances_weak_links_dofs_and_seconds(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, copy = tmp_path / "out", tmp_path / "copy.json"
    printed = call(capsys, ["compare", str(scene), "-o", str(out), "--json", str(copy)]).out
    for text in (
        "as written",
        "R",
        "thick",
        "MAC 1.00",
        "dx/Fx",
        "weak link z",
        "mount",
        "dofs solved for",
        "seconds from scene",
        "–",
    ):
        assert text in printed, text
    summary = json.loads((out / "compare.json").read_text())
    assert json.loads(copy.read_text()) == summary
    assert set(summary) == {
        "scene",
        "format",
        "pose",
        "reference",
        "mac_threshold",
        "modes",
        "columns",
        "variants",
        "not_computed",
        "verdicts",
        "not_compared",
        "provenance",
    }
    # every frequency of the reference is printed as the file has it
    for row in summary["modes"]:
        cell = row["variants"]["as written"]
        if cell is not None:
            assert show_bounded(cell["frequency_hz"], cell["error_hz"]) in printed
    assert {path.name for path in out.iterdir()} >= {
        "compare.html", "compare.json", "modes.csv", "compliances.csv", "variants.csv", "frequencies.png", "compliances.png",
    }  # fmt: skip


@pytest.mark.trials
def test_other_analyses_are_compared_as_run_finds_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    scene, out = tmp_path / "mill.toml", tmp_path / "out"
    mill = (Path(__file__).parents[2] / "data" / "mill.toml").read_text()
    scene.write_text(
        mill.replace('side = "40 mm"', 'side = "12 mm"')
        + LOBES
        + '[variants.soft]\n"joints.x_screw.stiffness.axial" = "75 N/um"\n'
    )
    printed = call(capsys, ["compare", str(scene), "-o", str(out)]).out
    assert "Limit depth of cut [mm]" in printed and "Profiles of faces [µm]" in printed
    variants = json.loads((out / "compare.json").read_text())["variants"]
    assert main(["run", str(scene), "-o", str(tmp_path / "run"), "--variant", "soft"]) == 0
    found = read_run_numbers(tmp_path / "run")
    soft = variants["soft"]["others"]
    assert {"limit depth of cut", "profiles of faces"} <= set(soft)
    for entries in soft.values():
        for name, other in entries.items():
            unit, factor = found[name].shown
            assert other["unit"] == unit
            assert other["value"] == approx(factor * found[name].value, rel=1e-9), name
    # along y the screw of X says nothing of where a face lies
    stiff = variants["as written"]["others"]["profiles of faces"]
    name = "profile(face=1,figure=location_error)"
    assert soft["profiles of faces"][name]["value"] > 1.1 * stiff[name]["value"]
    with (out / "others.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {"limit depth of cut", "profiles of faces"} <= {row["answer"] for row in rows}
    assert name in {row["entry"] for row in rows}


def test_csv_and_page_hold_the_unrounded_numbers_of_the_json(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["compare", str(scene), "-o", str(out), "--variants", "R,as written"]) == 0
    summary = json.loads((out / "compare.json").read_text())
    with (out / "modes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(summary["modes"])
    page = (out / "compare.html").read_text()
    for row, wanted in zip(rows, summary["modes"], strict=True):
        cell = wanted["variants"]["R"]
        assert row["R [Hz]"] == ("" if cell is None else repr(cell["frequency_hz"]))
        assert cell is None or f'value="{cell["frequency_hz"]!r}"' in page
    assert not re.search(r'(src|href)="(?!data:|#)', page)


def test_effort_begins_with_an_empty_store_and_shows_the_changed_model_too(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = [
        "compare",
        str(scene),
        "-o",
        str(out),
        "--variants",
        "as written",
        "--fidelity",
        "rigid,segmented",
    ]
    printed = call(capsys, [*arguments, "--effort", "--change", "thick"]).out
    assert (
        "Effort from scene to answers, from an empty store, then with thick" in printed
        and "CPU s" in printed
    )
    effort = json.loads((out / "compare.json").read_text())["effort"]
    assert effort["change"] == ["thick"] and list(effort["variants"]) == ["rigid", "segmented"]
    for runs in effort["variants"].values():
        assert list(runs) == ["first", "changed"]
        assert runs["first"]["seconds"]["total"] == approx(
            sum(list(runs["first"]["seconds"].values())[:-1]), abs=1e-3
        )
    assert not (tmp_path / "store").exists()


def test_a_scene_says_itself_what_to_compare_and_the_command_line_comes_first(
    scene: Path, tmp_path: Path
) -> None:
    scene.write_text(
        SCENE + '[compare]\nvariants = ["thick", "R"]\npose = "home"\nreference = "R"\n'
    )
    out = tmp_path / "out"
    assert main(["compare", str(scene), "-o", str(out)]) == 0
    summary = json.loads((out / "compare.json").read_text())
    assert list(summary["variants"]) == ["thick", "R"] and summary["reference"] == "R"
    assert main(["compare", str(scene), "-o", str(out), "--variants", "thick,as written"]) == 0
    summary = json.loads((out / "compare.json").read_text())
    assert list(summary["variants"]) == ["thick", "as written"] and summary["reference"] == "thick"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--variants", "Q"), "unknown variant 'Q'"),
        (("--fidelity", "stiff"), "there is no fidelity 'stiff'"),
        (("--pose", "away"), "there is no pose 'away'"),
        (("--reference", "Q"), "there is no variant 'Q'"),
        (("--effort", "--change", "components.bar.mass=heavy"), "heavy"),
        (
            (
                "--set",
                "components.bar.segments.along=x",
                "--set",
                'components.bar.solid={tube={outer="1 m",length="2 m"}}',
            ),
            "along z only",
        ),
    ],
)
def test_what_cannot_be_compared_ends_with_2_and_writes_nothing(
    scene: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    message: str,
) -> None:
    assert main(["compare", str(scene), "-o", str(tmp_path / "out"), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_static_analysis_that_is_refused_ends_with_1_and_the_modes_are_there(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.write_text(
        SCENE.replace(
            'vertical = "200 N/um", horizontal = "60 N/um"',
            'vertical = "0 N/um", horizontal = "0 N/um"',
        )
    )
    assert main(["compare", str(scene), "-o", str(tmp_path / "out"), "--variants", "R"]) == 1
    printed = capsys.readouterr().out
    assert "failed: R: static analysis" in printed and "Natural frequencies" in printed


def test_the_baseline_is_a_column_unless_it_is_refused(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"

    def compare(*arguments: str) -> Any:
        assert main(["compare", str(scene), "-o", str(out), *arguments]) == 0
        return json.loads((out / "compare.json").read_text())

    beside = compare("--variants", "thick")
    assert beside["columns"] == ["as written", "thick"] and beside["reference"] == "as written"
    first = beside["modes"][0]["variants"]
    assert first["thick"]["deviation"] == approx(
        first["thick"]["frequency_hz"] / first["as written"]["frequency_hz"] - 1.0
    )
    assert compare("--variants", "thick", "--no-baseline")["columns"] == ["thick"]


def test_a_baseline_without_an_answer_leaves_the_others_theirs(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spring = SCENE[SCENE.index('kind = "mount"') : SCENE.index("[points.tcp]")]
    text = SCENE.replace(spring, 'kind = "rigid"\n').replace(
        'fidelity = "segmented"', 'fidelity = "rigid"'
    )
    scene.write_text(text.replace('"rigid"\n[variants.thick]', '"segmented"\n[variants.thick]'))
    out = tmp_path / "out"
    assert main(["compare", str(scene), "-o", str(out), "--variants", "R"]) == 0
    summary = json.loads((out / "compare.json").read_text())
    assert summary["columns"] == ["as written", "R"] and list(summary["variants"]) == ["R"]
    assert "as written" in summary["not_computed"]
    assert "as written" in capsys.readouterr().out
    assert main(["compare", str(scene), "-o", str(out), "--variants", "R,as written"]) == 1


def test_a_comparison_states_the_errors_that_a_run_of_each_variant_states(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    elastic = (
        'fidelity = "elastic"\nmesh = { size = "20 mm", cells = "hex" }\nreduction = { modes = 10 }'
    )
    scene.write_text(SCENE.replace('fidelity = "segmented"', elastic))
    out = tmp_path / "out"
    assert main(["compare", str(scene), "--variants", "as written,R", "-o", str(out)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert main(["run", str(scene), "-o", str(tmp_path / "run"), "--no-figures"]) == 0
    summary, alone = (
        json.loads(path.read_text())
        for path in (out / "compare.json", tmp_path / "run" / "summary.json")
    )
    variant, rigid = (summary["variants"][name] for name in ("as written", "R"))
    modes, point = alone["modal"][0], alone["static"]["tcp"]
    # the same estimates, but for more modes kept in the search
    assert (
        variant["error_hz"] == approx(modes["error_hz"], rel=1e-6)
        and min(variant["error_hz"]) > 0.0
    )
    assert variant["static"]["tcp"]["error_um_per_kN"] == approx(point["error_um_per_kN"], rel=1e-6)
    # nothing is known of how far a rigid model is off
    assert set(rigid["error_hz"]) == {None} and rigid["error_share"] == [{}] * len(
        rigid["error_hz"]
    )
    assert rigid["error_left_out"] == ["rigid model of bar"]
    page = html.unescape((out / "compare.html").read_text())
    for hz, error in zip(variant["frequencies_hz"], variant["error_hz"], strict=True):
        assert f"{show_bounded(hz, error)} {show_bound(hz, error)}" in printed
        assert f'<data class="bound" value="{error!r}">' in page
    for direction, error in variant["static"]["tcp"]["error_um_per_kN"].items():
        place = "xyz".index(direction)
        value = variant["static"]["tcp"]["compliance_um_per_kN"][place][place]
        assert f"{show_bounded(value, error)} {show_bound(value, error)}" in printed
        assert f'<data class="bound" value="{error!r}">' in page
    for text in (
        "as written: ± covers 95 % of errors, from discretisation up to",
        "R: not in ±: rigid model of bar",
    ):
        assert text in printed and text in page
    known, unknown = printed.count("not in ±: rigid model of bar"), printed.count("± ?")
    assert (known, unknown) == (1, len(rigid["error_hz"]) + 3)
    with (out / "modes.csv").open() as file:
        row = next(csv.DictReader(file))
    assert float(row["as written ± [Hz]"]) >= variant["error_hz"][0] and row["R ± [Hz]"] == ""
    with (out / "compliances.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["as written ± [um/kN]"]]
    assert [(row["motion in"], row["force in"]) for row in rows] == [(d, d) for d in "xyz"]


@pytest.mark.parametrize("fidelity", ["rigid", "segmented"])
def test_a_run_of_rigid_or_segmented_parts_states_no_errors(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], fidelity: str
) -> None:
    damped = '[analyses.frf]\nup_to = "900 Hz"\npoints = 5\noutputs = ["tcp"]\n[effects]\ndamping = { modal = 0.02 }\n'
    scene.write_text(SCENE.replace('fidelity = "segmented"', f'fidelity = "{fidelity}"') + damped)
    out = tmp_path / "run"
    printed = call(capsys, ["run", str(scene), "-o", str(out), "--no-figures"]).out
    summary = json.loads((out / "summary.json").read_text())
    (modes,), (response,) = summary["modal"], summary["frf"].values()
    assert set(modes["error_hz"]) == {None} and response["error"] is None
    assert (
        "± <" not in printed
        and "± covers" not in printed
        and f"not in ±: {fidelity} model of bar" in printed
    )
    for table in (out / "tables").glob("modes_*.csv"):
        with table.open() as file:
            assert {row["± [Hz]"] for row in csv.DictReader(file)} == {""}
