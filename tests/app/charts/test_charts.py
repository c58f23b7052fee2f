"""Charts: every series is drawn and named, axes hold numbers with units, labels do not touch."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from common import approx, sketch
from headstock.app.charts import comparison, results, study, sweep
from headstock.app.charts.axis_kit import FIGURE_NAME, draw_axis_kit
from headstock.app.charts.charts import label_decades, new_figure
from headstock.app.charts.comparison import _spread_labels, draw_comparison
from headstock.app.charts.results import _draw_responses
from headstock.app.charts.study import _describe_column, draw_study
from headstock.app.charts.sweep import draw_sweep
from headstock.app.drawings.frf import draw_overlay
from headstock.app.report.pages import render_comparison
from headstock.app.texts.curves import response_unit, round_ticks
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.scene.reading.files import TomlValue
from headstock.scene.studies import Study, StudyFamily, Sweep
from headstock.studies.comparison_summary import ComparisonSummary, _LinkSummary
from headstock.studies.parameters.records import StudyRecord
from headstock.studies.parameters.tables import StudyTable, tabulate_study, varied_numbers
from headstock.studies.sweeps.results import SweepResults
from headstock.validation.machines.axis_kit_cases import (
    CASE,
    FIDELITIES,
    MEASURED_COMPLIANCE,
    VARIANTS,
    compliance_name,
)
from headstock.validation.references.rows import Target, ValidationRow, compare_value

YOUNG, COUNT = "materials.steel.E", "components.a_component_with_a_long_name.segments.count"


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures that charts were made of, drawn."""
    found: list[Figure] = []

    def keep(figure: Figure) -> bytes:
        FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call] # matplotlib's own
        found.append(figure)
        return b""

    for module in (study, comparison, sweep, results):
        monkeypatch.setattr(module, "encode_figure", keep)
    return found


def make_table(counts: int, youngs: tuple[str | float, ...], watched: int = 2) -> StudyTable:
    vary = {YOUNG: youngs, COUNT: tuple(range(1, counts + 1))}
    study = Study("s", (StudyFamily("", "", {}, vary),), ("modal.frequencies_hz",))
    records = []
    for (number, young), count in itertools.product(enumerate(youngs), range(1, counts + 1)):
        hz = [100.0 * number + count + index for index in range(watched)]
        summary = {"modal": [{"pose_name": "p", "frequencies_hz": hz}]}
        varied: dict[str, TomlValue] = {YOUNG: young, COUNT: count}
        records.append(StudyRecord(f"{young} {count}", "", varied, "done", summary=summary))
    return tabulate_study(study, records)


def test_every_series_of_a_study_is_drawn_and_its_legend_is_whole(figures: list[Figure]) -> None:
    draw_study(make_table(20, ("110 GPa", "150 GPa", "210 GPa")))
    (figure,) = figures
    assert [len(axes.get_lines()) for axes in figure.axes] == [20, 20]
    looks = {(line.get_color(), line.get_linestyle()) for line in figure.axes[0].get_lines()}
    assert len(looks) == 20
    (legend,) = figure.legends
    words = [text.get_text().split()[-1] for text in legend.get_texts()]
    assert words == [str(n) for n in range(1, 21)]
    box, page = legend.get_window_extent(), figure.bbox
    assert page.x0 <= box.x0 and box.x1 <= page.x1 and page.y0 <= box.y0 and box.y1 <= page.y1
    panel = figure.axes[0].get_tightbbox()
    assert panel is not None and box.y1 <= panel.y0 + 1.0


def test_quantities_stand_on_an_axis_of_numbers_with_their_unit_and_titles_are_words(
    figures: list[Figure],
) -> None:
    def places(axes: Axes) -> FloatArray:
        return np.asarray(axes.get_lines()[0].get_xdata(), dtype=float)

    draw_study(make_table(2, ("110 GPa", "150 GPa", "210 GPa")))
    axes = figures[0].axes[0]
    np.testing.assert_allclose(places(axes), [110.0, 150.0, 210.0])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["110", "150", "210"]
    assert axes.get_xlabel() == "materials.steel.E [GPa]"
    assert axes.get_title("left") == "frequency 1 [Hz]"
    draw_study(make_table(2, ("210 GPa", "1.5e5 MPa")))
    np.testing.assert_allclose(places(figures[1].axes[0]), [1.5e11, 2.1e11])
    assert figures[1].axes[0].get_xlabel() == "materials.steel.E [Pa]"


def test_a_study_with_more_numbers_than_panels_says_so(figures: list[Figure]) -> None:
    draw_study(make_table(2, ("110 GPa", "210 GPa"), watched=40))
    assert len(figures[0].axes) == 30
    assert figures[0].get_suptitle() == "the first 30 of 40 watched numbers; study.csv holds all"


def test_words_among_quantities_are_no_numbers() -> None:
    table = make_table(1, ("110 GPa", "soft"))
    assert varied_numbers(table, YOUNG) is None
    assert varied_numbers(make_table(1, ("110 GPa", "2 m")), YOUNG) is None
    found = varied_numbers(make_table(1, ("110 GPa", "2e5 MPa")), YOUNG)
    assert found is not None and (found.unit, found.values) == ("Pa", (110e9, 200e9))


COMPLIANCE = "compliance_um_per_kN"


@pytest.mark.parametrize(
    ("path", "short", "title"),
    [
        ("modal.frequencies_hz[0]", "frequencies_hz[0]", "frequency 1 [Hz]"),
        (f"static.tcp.{COMPLIANCE}[0][2]", f"{COMPLIANCE}[0][2]", "compliance xz [µm/kN]"),
        (f"static.a.{COMPLIANCE}[0][0]", f"a.{COMPLIANCE}[0][0]", "a compliance xx [µm/kN]"),
        ("totals.mass_kg", "mass_kg", "mass [kg]"),
        ("seconds", "seconds", "seconds [s]"),
        ("modal.rigid_count", "rigid_count", "rigid count"),
    ],
)
def test_a_watched_path_is_titled_in_words_with_its_unit(path: str, short: str, title: str) -> None:
    assert _describe_column(path, short) == title


def test_labels_that_would_touch_are_moved_up() -> None:
    assert _spread_labels([1.0, 1.1, 5.0], 1.0) == [1.0, 2.0, 5.0]


STEPS = ("load", "components", "couple", "modes", "static", "frf", "others", "total")


def make_variant() -> dict[str, object]:
    point = {
        "compliance_um_per_kN": np.diag([1010.2, 2.0, 3.0]).tolist(),
        "compliance_6x6": np.eye(6).tolist(),
        "weak_link": dict.fromkeys("xyz"),
        "error_um_per_kN": {"x": 0.12, "y": 0.01, "z": None},
        "error_share": {"x": {"discretisation": 0.12}},
    }
    seconds = dict.fromkeys(STEPS, 1.0)
    effort = {"seconds": seconds, "cpu_seconds": seconds, "elastic_components": 0}
    effort |= {"from_store": 0, "peak_rss_mb": 100.0}
    variant: dict[str, object] = {
        "static": {"tcp": point},
        "frf": [],
        "others": {},
        "mac": [],
        "failures": [],
    }
    variant |= {"effort": effort, "error_hz": [0.5] * 4, "error_left_out": [], "rigid_count": 0}
    variant |= dict.fromkeys(("full_dofs", "reduced_dofs", "coupled_dofs"), 6)
    return variant | {"error_share": [{"discretisation": 0.5}] * 4}


def make_comparison() -> ComparisonSummary:
    names = [f"variant_with_a_long_name_{number}" for number in range(7)]
    rows = []
    for number, hz in enumerate((1010.2, 1010.4, 1012.0, 99.5)):
        cell = {"number": number + 1, "frequency_hz": hz, "error_hz": 0.5, "deviation": 0.0}
        variants = {name: cell | {"mac": 1.0} for name in names}
        rows.append({"name": f"part bends {number}", "origin": names[0], "variants": variants})
    found = {"scene": "s", "pose": "p", "reference": names[0], "mac_threshold": 0.5}
    found |= {"modes": rows, "variants": {name: make_variant() for name in names}}
    found |= {"columns": names, "not_computed": {}, "verdicts": {}, "not_compared": []}
    return sketch(ComparisonSummary, found)


def test_labels_of_a_comparison_do_not_touch_and_have_no_bare_point(figures: list[Figure]) -> None:
    draw_comparison(make_comparison(), {})
    levels, bars = figures
    texts = [text for text in levels.axes[0].texts if text.get_text()]
    shown = {text.get_text() for text in texts}
    assert {"1010", "1012", "99.50"} <= shown and not any(text.endswith(".") for text in shown)
    boxes = [text.get_window_extent() for text in texts if text.get_text()[0].isdigit()]
    assert len(boxes) == 4 * 7
    for one, other in itertools.combinations(boxes, 2):
        apart = one.x1 <= other.x0 or other.x1 <= one.x0
        assert apart or one.y1 <= other.y0 + 1.0 or other.y1 <= one.y0 + 1.0
    (legend,) = bars.legends
    assert legend.get_window_extent().x0 >= 0.0 and legend.get_window_extent().x1 <= bars.bbox.x1


def test_a_comparison_of_single_parts_names_no_weak_links() -> None:
    summary = make_comparison()
    assert "weak link" not in render_comparison(summary, {})
    link: _LinkSummary = {"name": "bed", "share": 0.5, "change_if_doubled": -0.2}
    summary["variants"]["variant_with_a_long_name_1"]["static"]["tcp"]["weak_link"]["y"] = link
    page = render_comparison(summary, {})
    assert "weak link y" in page and "weak link x" not in page


def test_colour_bars_of_a_sweep_hold_whole_numbers_not_offsets(figures: list[Figure]) -> None:
    positions = np.array([[0.0, 0.0], [0.0, 1.0], [0.1, 0.0], [0.1, 1.0]])
    nothing: dict[str, Any] = {"modes": None, "tracked": None, "points": {}, "figures": {}}
    found = SweepResults(
        name="machine",
        key="",
        sweep=Sweep("plane", "grid", ("X", "Y"), ("m", "rad"), positions, (2, 2)),
        states=("done",) * 4,
        errors=("",) * 4,
        shapes=np.zeros((4, 0, 0), dtype=np.float32),
        condition=np.array([1.10801, 1.10802, 1.10803, 1.10804]),
        **nothing,
    )
    draw_sweep(found)
    bar = figures[0].axes[1]
    assert bar.yaxis.get_offset_text().get_text() == ""
    labels = [float(label.get_text()) for label in bar.get_yticklabels() if label.get_text()]
    assert labels and min(labels) > 1.1


def make_curves(pose: str, factor: float, spacing: str = "log") -> ResponseCurves:
    channels = (("tcp", "x"),)
    frequencies = np.geomspace(20.0, 200.0, 30)
    values = (factor * 1e-7 / (1.0 - (frequencies / 90.0) ** 2 + 0.1j))[:, None, None]
    return ResponseCurves(pose, channels, channels, frequencies, values, "receptance", spacing)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (20.0, 200.0, [20.0, 50.0, 100.0, 200.0]),
        (0.5, 2000.0, [1.0, 10.0, 100.0, 1000.0]),
        (110.0, 190.0, []),
        (31.0, 62.0, [40.0, 50.0, 60.0]),
    ],
)
def test_a_logarithmic_axis_has_at_least_three_round_numbers_where_there_are_any(
    low: float, high: float, ticks: list[float]
) -> None:
    assert round_ticks(low, high) == approx(ticks)


@pytest.mark.parametrize("ends", [(90e3, 900e3), (130e3, 700e3), (2.0, 30.0), (40.0, 60e6)])
def test_labels_of_a_logarithmic_axis_do_not_touch(ends: tuple[float, float]) -> None:
    figure = new_figure(12.0, 5.0)
    for axes in figure.subplots(1, 3):
        axes.set_xscale("log")
        axes.set_xlim(*ends)
        label_decades(axes)
    figure.draw_without_rendering()
    boxes = [[label.get_window_extent() for label in a.get_xticklabels()] for a in figure.axes]
    assert min(map(len, boxes)) >= 2
    pairs = itertools.chain(*map(itertools.pairwise, boxes))
    assert all(before.x1 + 4.0 < after.x0 for before, after in pairs)


def test_the_responses_of_all_poses_are_drawn_over_each_other(figures: list[Figure]) -> None:
    curves = [make_curves("b", 1.0), make_curves("a", 2.0)]
    assert list(_draw_responses(curves)) == ["frf_b", "frf_a", "frf_all_poses"]
    words = [[text.get_text() for text in figure.axes[0].texts] for figure in figures]
    assert words[2][-2:] == ["pose a", "pose b"]
    assert words[0][-4:] == ["20", "50", "100", "200 Hz"]
    drawn = str(draw_overlay(curves, "all"))
    assert drawn.count("<path") == 2 * 2
    assert "pose a" in drawn and "pose b" in drawn and ">50<" in drawn
    assert "frf_all_poses" not in _draw_responses(curves[:1])


def test_compliances_are_shown_in_one_unit_everywhere() -> None:
    assert response_unit("receptance", ("tcp", "x"), ("tcp", "y")) == ("µm/kN", 1e9)


def make_rows(factor: float) -> list[ValidationRow]:
    models = itertools.product(VARIANTS, FIDELITIES, MEASURED_COMPLIANCE.items())
    rows = []
    for variant, fidelity, (axis, right) in models:
        target = Target(right, "um/kN", float("nan"), "shown only")
        row = compare_value(compliance_name(variant, fidelity, axis), factor * right, target)
        rows.append(dataclasses.replace(row, case=CASE))
    return rows


def test_the_figure_shows_the_deviations_of_the_rows() -> None:
    twice, thrice = (draw_axis_kit(make_rows(factor))[FIGURE_NAME] for factor in (2.0, 3.0))
    assert twice.startswith(b"\x89PNG") and thrice.startswith(b"\x89PNG")
    assert twice != thrice


def test_other_cases_have_no_such_figure() -> None:
    assert draw_axis_kit([]) == {}
