"""The report is one file that loads nothing, escapes everything, and shows no number that is not in
the summary.
"""

import base64
import dataclasses
import io
import json
import math
import re
import zlib
from collections.abc import Iterator, Mapping
from html.parser import HTMLParser
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_results import make_modes
from scipy.spatial import cKDTree
from summary_shapes import list_strangers

from common import Shell, approx, present, run_once
from headstock.app.drawings.markup import draw_rows, format_number, script_json
from headstock.app.report.report import render_report
from headstock.app.report.viewer_data import (
    RIGID_SHARE,
    Caption,
    _pack_columns,
    _pose_shapes,
    encode_machine,
)
from headstock.app.tables.table import Column
from headstock.app.terminal.console import Screen
from headstock.app.terminal.summary import _format_rows
from headstock.geometry.frames import FloatArray, Frame, rigid_map
from headstock.geometry.parts.skins import Skin, box_skin
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.probes import ProbeAnswer, ProbeResponse, probe_keys
from headstock.pipeline.answers.static import StaticAnswer
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.results.files import open_results, read_view
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.pipeline.results.views import JointView, MachineView, PointView, PoseView

MACHINES = Path(__file__).resolve().parents[3] / "machines"
HOSTILE = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "</script><b>",
    "{{ 7 * 7 }}",
    "a\u2028b\u2029c",
    "&lt;",
)
SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


class Page(HTMLParser):
    """Tags, numbers with their values, and the words outside numbers, scripts and styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.numbers: list[tuple[float, str]] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self.stack: list[str] = []
        self.value: str | None = None
        self.is_bound = False
        self.bounds: list[tuple[float, str]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.tags.append((tag, found))
        if tag not in ("meta", "img", "input", "br", "link"):
            self.stack.append(tag)
        self.value = found.get("value") if tag == "data" else found.get("data-value")
        self.is_bound = found.get("class") == "bound"

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        while self.stack and self.stack.pop() != tag:
            pass
        self.value = None

    def handle_data(self, data: str) -> None:
        if self.stack and self.stack[-1] in ("script", "style"):
            self.scripts.append(data)
        elif self.value is not None:
            (self.bounds if self.is_bound else self.numbers).append((float(self.value), data))
        else:
            self.words.append(data)

    def count(self, *wanted: str) -> int:
        return sum(tag in wanted for tag, _ in self.tags)

    def values(self) -> set[float]:
        return {value for value, _ in self.numbers}


def leaves(content: object) -> Iterator[object]:
    """Keys and values of nested tables and lists."""
    if isinstance(content, dict):
        yield from content
        content = list(content.values())
    if isinstance(content, list):
        for item in content:
            yield from leaves(item)
    else:
        yield content


def family_sums(content: object) -> Iterator[float]:
    """Shares of parts whose names differ by a number, added up in every nested table of shares."""
    inner = list(content.values()) if isinstance(content, dict) else content
    for item in inner if isinstance(inner, list) else ():
        yield from family_sums(item)
    if isinstance(content, dict) and all(isinstance(share, float) for share in content.values()):
        for _, names in groupby(sorted(content), lambda name: re.sub(r"_\d+$", "", name)):
            yield sum(content[name] for name in names)


def values_in(content: object) -> set[float]:
    numbers = (leaf for leaf in leaves(content) if isinstance(leaf, int | float))
    exact = {float(number) for number in numbers if not isinstance(number, bool)}
    return exact | set(family_sums(content))


def texts_in(content: object) -> set[str]:
    return {leaf for leaf in leaves(content) if isinstance(leaf, str)}


def read_shown(text: str) -> tuple[float, float]:
    """A number as shown, and half a unit of its last digit."""
    plain = text.replace("−", "-").replace("\u202f", "")
    number, _, unit_name = plain.partition(" ")
    mantissa, _, exponent = number.partition("·10")
    factor = {"%": 0.01, "mm": 1e-3, "deg": math.pi / 180.0, "": 1.0}[unit_name]
    unit = 10.0 ** int(exponent.translate(SUPERSCRIPTS) or 0) * factor
    return float(mantissa) * unit, 0.5001 * unit * 10.0 ** -len(mantissa.partition(".")[2])


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    text = (MACHINES / "three_axis.toml").read_text()
    return run_once(tmp_path_factory.mktemp("report"), text, "--variant", "YE")


@pytest.fixture(scope="module")
def html(run_folder: Path) -> str:
    return (run_folder / "report.html").read_text()


@pytest.fixture
def summary(run_folder: Path) -> Mapping[str, Any]:
    return read_summary(run_folder)


@pytest.fixture
def run(run_folder: Path) -> Results:
    return open_results(run_folder)


def test_every_number_in_the_report_is_in_the_summary_and_rounded_from_it(
    summary: Mapping[str, Any], html: str
) -> None:
    page = Page(html)
    assert list(list_strangers(summary)) == []
    assert len(page.numbers) > 200
    assert page.values() <= values_in(summary)
    for value, text in page.numbers:
        shown, half = read_shown(text)
        assert shown == approx(value, abs=half, rel=0.0), text


def test_every_error_in_the_report_is_rounded_up(html: str) -> None:
    page = Page(html)
    assert len(page.bounds) > 20
    for value, text in page.bounds:
        shown, half = read_shown(text.removeprefix("<"))
        assert value * (1 - 1e-9) <= shown, text
        assert text.startswith("<") or shown <= value + 2.0 * half, text


def test_no_decimal_number_stands_outside_the_numbered_elements(
    summary: Mapping[str, Any], html: str
) -> None:
    words = " ".join(Page(html).words)
    for text in sorted(texts_in(summary), key=len, reverse=True):
        words = words.replace(text, "") if re.search(r"\d", text) else words
    assert re.findall(r"\d+[.,]\d+", words) == []


def test_the_report_of_the_three_axis_machine_is_below_3_mb(html: str) -> None:
    assert 0.5e6 < len(html.encode()) < 2.5e6


def test_the_report_loads_nothing(html: str) -> None:
    page = Page(html)
    for tag, attributes in page.tags:
        assert tag not in ("link", "iframe", "object", "embed", "base", "form")
        for name in ("src", "href", "srcset", "action", "poster", "background"):
            target = attributes.get(name)
            assert target is None or target.startswith(("#", "data:")), (tag, target)
    styles = "".join(text for text in page.scripts if "prefers-color-scheme" in text)
    assert "url(" not in styles and "@import" not in styles
    named = {attributes.get("http-equiv"): attributes.get("content") for _, attributes in page.tags}
    policy = present(named["Content-Security-Policy"])
    assert "default-src 'none'" in policy and "http" not in policy


def test_the_same_report_is_written_again_from_the_files_alone(run: Results, html: str) -> None:
    # no comparison by pytest: listing the differences of two pages takes minutes
    mark = html.partition('name="headstock-content" content="')[2].partition('"')[0]
    same = render_report(run, mark=mark) == html
    assert same


def replace_modes(run: Results, *modes: PoseModes) -> Results:
    """Return results with other modes, or without."""
    others = tuple(answer for answer in run.answers if not isinstance(answer, PoseModes))
    return dataclasses.replace(run, answers=(*others, *modes), view=MachineView())


def test_a_report_says_so_when_errors_were_not_estimated(run: Results) -> None:
    assert "The column “± Hz”" in render_report(run)
    bare = [dataclasses.replace(modes, errors={}) for modes in run.modal]
    assert "was not estimated" in render_report(replace_modes(run, *bare))
    quarter = Estimate({"discretisation": 0.25})
    count = len(bare[0].frequencies_hz)
    bare[0] = dataclasses.replace(
        bare[0], errors={bare[0].key("frequency", index): quarter for index in range(count)}
    )
    changed = render_report(replace_modes(run, *bare))
    assert '<data class="bound" value="0.25">0.25</data>' in changed


def test_the_report_of_a_lumped_mechanism_shows_its_compliance_without_errors(
    shell: Shell,
) -> None:
    shell(f"run {MACHINES / 'tripteor.toml'} --analysis static --no-figures -o out")
    page = Page(shell.text("out/report.html"))
    compliance = shell.json("out/summary.json")["static"]["tcp"]["compliance_um_per_kN"]
    assert page.bounds == []
    assert {compliance[place][place] for place in range(3)} <= page.values()


def test_the_first_structural_mode_is_neither_free_nor_a_motion_of_the_whole_machine(
    run: Results,
) -> None:
    names = ["free X translation of a", "whole machine moves Y on m", "a bends X"]
    modes = make_modes([0.0, 2.0, 87.5], names, rigid_count=1)
    html = render_report(replace_modes(run, modes))
    tile = html[html.index("First structural mode") :][:250]
    assert '<data value="87.5">' in tile and "no. 3" in tile and "a bends X" in tile


def test_the_navigation_names_sections_of_the_page_in_their_order(run: Results) -> None:
    html = render_report(run)
    links = re.findall('href="#([a-z]+)"', html[: html.index("</nav>")])
    sections = re.findall('<section id="([a-z]+)"', html)
    assert {"stiffness", "modes", "components", "cost"} <= {*links}
    assert links == [name for name in sections if name in links]


def test_warnings_and_failures_come_before_everything_else(run: Results) -> None:
    run = dataclasses.replace(run, warnings=("the bed is soft",), failures=("it floats",))
    html = render_report(run)
    assert html.index("it floats") < html.index("the bed is soft") < html.index('class="keys"')


@pytest.mark.parametrize(
    ("kinds", "components"),
    [((StaticAnswer,), True), ((PoseModes,), True), ((), True), ((), False)],
    ids=["static only", "modal only", "neither", "nothing"],
)
def test_a_report_of_part_of_the_analyses_holds_what_there_is(
    run: Results, kinds: tuple[type[Answer], ...], components: bool
) -> None:
    answers = tuple(answer for answer in run.answers if isinstance(answer, kinds))
    run = dataclasses.replace(run, answers=answers, view=MachineView())
    if not components:
        run = dataclasses.replace(run, components={}, stages=())
    html = render_report(run)
    assert ('id="modes"' in html) == (PoseModes in kinds)
    assert ('id="stiffness"' in html) == (StaticAnswer in kinds)
    assert 'id="machine"' not in html
    assert Page(html).values() <= values_in(summarise(run))


def test_probes_are_shown_with_their_stress(run: Results) -> None:
    probe = ProbeResponse("bed", np.array([1.5e-6, 2.5e-6, 3.5e-6]), 1e6 * np.arange(6.0))
    keys = probe_keys("reference", "corner")
    answer = ProbeAnswer("reference", {"corner": probe}, errors={keys[0]: Estimate({"m": 2.5e-7})})
    page = Page(render_report(dataclasses.replace(run, answers=(answer,))))
    assert {1.5, 5.0} <= {round(value, 9) for value in page.values()}
    assert any("± ?" in words for words in page.words)


def hostile_view() -> MachineView:
    skins = {name: box_skin(np.zeros(3), np.ones(3)) for name in HOSTILE}
    joints = {name: JointView("spring", name, name, Frame()) for name in HOSTILE}
    points = {name: PointView(name, name, np.zeros(3)) for name in HOSTILE}
    pose = PoseView(
        {name: Frame() for name in HOSTILE},
        joints,
        points,
        {name: np.ones((2, 8, 3)) for name in HOSTILE},
    )
    return MachineView(skins, {}, {HOSTILE[0]: pose})


def hostile_run(run: Results) -> Results:
    facts = dataclasses.replace(next(iter(run.components.values())), fidelity=HOSTILE[2])
    shares = dict.fromkeys(HOSTILE, 0.125)
    point = dataclasses.replace(
        next(iter(run.static["reference"].values())),
        budget=dict.fromkeys("xyz", shares),
        text=HOSTILE[2],
    )
    modes = run.modal[0]
    count = len(modes.mode_names)
    modes = dataclasses.replace(
        modes,
        pose=dataclasses.replace(modes.pose, name=HOSTILE[0]),
        mode_names=(HOSTILE[1],) * count,
        energy_share=(shares,) * count,
    )
    stages = [
        dataclasses.replace(
            row,
            stage=dataclasses.replace(
                row.stage, component=HOSTILE[0], pose=HOSTILE[1], reason=HOSTILE[2]
            ),
        )
        for row in run.stages
    ]
    return dataclasses.replace(
        run,
        name=HOSTILE[0],
        warnings=HOSTILE,
        failures=HOSTILE,
        components=dict.fromkeys(HOSTILE, facts),
        versions={HOSTILE[1]: HOSTILE[0]},
        answers=(StaticAnswer("reference", {HOSTILE[1]: point}), modes),
        stages=tuple(stages),
        view=hostile_view(),
    )


def test_text_from_a_scene_stays_text_wherever_it_stands(run: Results) -> None:
    html = render_report(hostile_run(run))
    page = Page(html)
    assert (page.count("script"), page.count("img")) == (2, 0)
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)
    shown = "".join(page.words)
    assert all(text in shown for text in (*HOSTILE[:4], HOSTILE[5]))


def test_data_for_the_viewer_survives_hostile_names_unchanged() -> None:
    view = hostile_view()
    captions = {HOSTILE[0]: [Caption("mode:0", HOSTILE[0], HOSTILE[4])]}
    machine = present(encode_machine(view, captions))
    assert not set("<>&\u2028\u2029") & set(machine.text)
    data = json.loads(machine.text)
    assert [part["name"] for part in data["components"]] == list(HOSTILE)
    assert data["poses"][0]["shapes"][0]["text"] == HOSTILE[4]
    assert json.loads(script_json({"words": HOSTILE})) == {"words": list(HOSTILE)}


def test_the_viewer_gets_points_within_a_ten_thousandth_and_shapes_within_what_is_seen(
    run_folder: Path,
) -> None:
    view = read_view(run_folder)
    name, pose = next(iter(view.poses.items()))
    force, low = Caption("push:tcp x", kind="force"), Caption("mode:0")
    captions = {name: [force, low, Caption("mode:8", frequency_hz=126.0)]}
    machine = present(encode_machine(view, captions))
    assert (machine.left_out, machine.thinned) == (0, {})
    data = json.loads(machine.text)
    block = zlib.decompress(base64.b64decode(data["blob"]))
    start = 0

    def take(kind: str, rows: int, columns: int) -> FloatArray:
        """Columns of differences, lowest bytes first."""
        nonlocal start
        width = np.dtype(kind).itemsize
        raw = np.frombuffer(block, np.uint8, rows * columns * width, start).reshape(width, -1)
        start += raw.size
        steps = np.ascontiguousarray(raw.T).view(f"<u{width}").reshape(columns, rows)
        return np.cumsum(steps, axis=1, dtype=f"u{width}").T.copy().view(kind)

    kept = []
    for about, skin in zip(data["components"], view.skins.values(), strict=True):
        points = np.array(about["low"]) + take("<u2", about["points"], 3) * np.array(about["step"])
        # the page has them in another order
        distances, nearest = cKDTree(points).query(skin.points)
        assert distances.max() < 1e-4 * data["size"]
        kept.append(np.argsort(nearest))
        for simplices, corners in ((skin.triangles, 3), (skin.edges, 2)):
            found = take("<u4", about[("", "", "edges", "triangles")[corners]], corners)
            kept_simplices, shown_simplices = (
                np.unique(np.sort(each, axis=1), axis=0) for each in (nearest[simplices], found)
            )
            np.testing.assert_array_equal(kept_simplices, shown_simplices)
    assert data["bytes"] == 2
    for shape, newtons in zip(data["poses"][0]["shapes"], (1000.0, 1.0, 1.0), strict=True):
        parts = _pose_shapes(pose)[shape["id"]]
        largest = max(np.linalg.norm(part, axis=1).max() for part in parts.values())
        assert shape["largest"] == approx(newtons * largest, rel=1e-4)
        for (part_name, part), rigid, order in zip(
            parts.items(), shape["rigid"], kept, strict=True
        ):
            if rigid is None:
                shown = take("<i2", len(part), 3) / 32767.0
                np.testing.assert_allclose(shown, part[order] / largest, atol=1.0 / 30000.0)
                continue
            frame = pose.placements[part_name]
            places = view.skins[part_name].points @ frame.rotation.T + frame.origin
            moved = rigid_map(places, np.zeros(3)) @ rigid
            np.testing.assert_allclose(moved.reshape(-1, 3), part / largest, atol=RIGID_SHARE)
        for resolved, order in zip(shape["resolved"], kept, strict=True):
            assert not resolved or take("u1", len(order), 1).max() <= 255
    assert start == len(block)
    components = read_summary(run_folder)["components"]
    is_rigid = {
        (components[name]["fidelity"] == "rigid", rigid is not None)
        for shape in data["poses"][0]["shapes"]
        for name, rigid in zip(view.skins, shape["rigid"], strict=True)
    }
    # a part that is not rigid may still move as if it were
    assert (
        {(True, True), (False, False)} <= is_rigid <= {(True, True), (False, False), (False, True)}
    )


def test_packed_columns_wrap_round_and_hold_every_number() -> None:
    values = np.array([[-32768, 5], [32767, -1], [0, 0]], dtype=np.int16)
    raw = np.frombuffer(_pack_columns(values), np.uint8).reshape(2, -1)
    steps = np.ascontiguousarray(raw.T).view("<u2").reshape(2, 3)
    found = np.cumsum(steps, axis=1, dtype=np.uint16).T.view(np.int16)
    np.testing.assert_array_equal(found, values)


def test_the_viewer_is_told_what_colours_and_arrows_mean_and_shows_what_deforms_first(
    run_folder: Path, summary: Mapping[str, Any], html: str
) -> None:
    start = html.index('id="machine-data">') + len('id="machine-data">')
    data = json.loads(html[start : html.index("</script>", start)])
    modes, shapes = summary["modal"][0], data["poses"][0]["shapes"]
    kinds = [shape["kind"] for shape in shapes]
    assert kinds == sorted(kinds, key=["force", "mode", "whole"].index)
    # six motions on soft mounts come first by frequency and last in the list
    assert (kinds.count("force"), kinds.count("whole")) == (3, 6)
    assert (shapes[3]["id"], shapes[-1]["id"]) == ("mode:6", "mode:5")
    shares = {part: round(share, 4) for part, share in modes["energy_share"][6].items()}
    assert shapes[3]["shares"] == {part: share for part, share in shares.items() if share >= 0.002}
    compliance = np.array(summary["static"]["tcp"]["compliance_um_per_kN"])
    for column, shape in enumerate(shapes[:3]):
        assert "1 kN at tcp" in shape["text"]
        # the tool gives way by most of what is between tool and work
        assert 0.3 < 1e6 * shape["largest"] / compliance[column, column] < 3.0
        assert shape["peak"] > 0.0
    point = next(point for point in data["poses"][0]["points"] if point["name"] == "tcp")
    names = [part["name"] for part in data["components"]]
    assert point["tool"].startswith(f"{names[point['body']]}.")
    assert point["work"].startswith(f"{names[point['back_body']]}.")
    pose = read_view(run_folder).poses[data["poses"][0]["name"]].points["tcp"]
    wanted = [present(pose.tool_place), present(pose.work_place)]
    np.testing.assert_allclose([point["at"], point["back"]], wanted, rtol=1e-6)


VIEWER = Path(__file__).resolve().parents[3] / "app" / "report" / "viewer"


def test_every_element_that_the_viewer_asks_for_is_in_the_page_and_the_bundle_is_built_from_the_source(
    html: str,
) -> None:
    source, bundle = ((VIEWER / name).read_text() for name in ("viewer.js", "viewer.bundle.js"))
    wanted = set(re.findall(r'byId\("([a-z-]+)"\)', source))
    identifiers = {attributes["id"] for _, attributes in Page(html).tags if "id" in attributes}
    assert len(wanted) > 15 and wanted <= identifiers
    for text in [*wanted, *re.findall(r'"((?:\w+ ){2}[\w ]*)"', source)]:
        assert text in bundle, text


def ball(count: int) -> Skin:
    """A sphere of ``2 count^2`` triangles."""
    u, v = np.meshgrid(
        np.linspace(0.0, 2 * np.pi, count, endpoint=False),
        np.linspace(1e-3, np.pi - 1e-3, count + 1),
    )
    points = np.column_stack(
        [(np.cos(u) * np.sin(v)).ravel(), (np.sin(u) * np.sin(v)).ravel(), np.cos(v).ravel()]
    )
    k = np.arange(count * count)
    after = k - k % count + (k + 1) % count
    triangles = np.vstack(
        [np.column_stack([k, k + count, after]), np.column_stack([after, k + count, after + count])]
    )
    return Skin(points, triangles, np.zeros((0, 2), dtype=np.int64), "mesh")


@pytest.mark.trials
def test_a_huge_machine_is_drawn_with_fewer_shapes_and_the_page_says_that_and_how_coarse_it_is(
    run: Results,
) -> None:
    skins = {
        "big 0": dataclasses.replace(ball(90), thinned_from=28800),
        "big 1": dataclasses.replace(ball(120), kept_whole="fewer would show another shape"),
        "big 2": ball(90),
    }
    rng, count = np.random.default_rng(2), 40
    shifts = {
        name: rng.random((count, len(skin.points), 3), dtype=np.float32)
        for name, skin in skins.items()
    }
    poses = {name: PoseView(dict.fromkeys(skins, Frame()), {}, {}, shifts) for name in ("p", "q")}
    view = MachineView(skins, {}, poses)
    captions = {name: [Caption(f"mode:{i}") for i in range(count)] for name in poses}
    machine = present(encode_machine(view, captions))
    data = json.loads(machine.text)
    shown = [len(pose["shapes"]) for pose in data["poses"]]
    assert data["bytes"] == 1
    assert 2 * count - machine.left_out == sum(shown)
    assert min(shown) >= 1 and max(shown) - min(shown) <= 1
    assert machine.left_out > 0
    assert machine.thinned == {"big 0": (16200, 28800)}
    assert len(machine.text) < 2.9e6
    modes = make_modes([1.0] * count, ["m"] * count, "p")
    page = render_report(dataclasses.replace(replace_modes(run, modes), view=view))
    for text in (
        "To keep this page small",
        "Thinned out for drawing, not for computing: big 0 with 16\u202f200 of 28\u202f800",
        "big 1 is drawn with all of its 28\u202f800 faces: fewer would show",
    ):
        assert text in page


def test_a_part_that_moves_rigidly_takes_six_numbers_however_fine_it_is() -> None:
    skin, frame = ball(100), Frame(np.array([1.0, 2.0, 3.0]))
    motion = np.array([0.1, -0.2, 0.3, 0.05, 0.02, -0.04])
    shift = (rigid_map(skin.points + frame.origin, np.zeros(3)) @ motion).reshape(1, -1, 3)
    pose = PoseView({"part": frame}, {}, {}, {"part": shift})
    view = MachineView({"part": skin}, {}, {"p": pose})
    machine = present(encode_machine(view, {"p": [Caption("mode:0")]}))
    (rigid,) = json.loads(machine.text)["poses"][0]["shapes"][0]["rigid"]
    np.testing.assert_allclose(rigid, motion / np.linalg.norm(shift[0], axis=1).max(), rtol=1e-6)


def test_the_displacement_under_a_push_is_the_compliance_at_the_tool(
    run_folder: Path, summary: Mapping[str, Any]
) -> None:
    view = read_view(run_folder)
    assert view.poses
    for name, pose in view.poses.items():
        place = pose.points["tcp"].tool_place
        matrix = np.array(summary["static_poses"][name]["tcp"]["compliance_6x6"])
        for column, direction in enumerate("xyz"):
            moved = {}
            for part in ("z_slider", "x_slider"):
                frame, skin = pose.placements[part], view.skins[part]
                corners = skin.points @ frame.rotation.T + frame.origin
                # rigid bodies: the motion is linear in the place
                ansatz = np.column_stack([np.ones(len(corners)), corners])
                fit, *_ = np.linalg.lstsq(ansatz, pose.pushes[f"tcp {direction}"][part], rcond=None)
                moved[part] = np.array([1.0, *place]) @ fit
            apart, limit = moved["z_slider"] - moved["x_slider"], 1e-4 * matrix[column, column]
            np.testing.assert_allclose(apart, matrix[:3, column], atol=limit)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (48.594123, "48.59"),
        (-1.5, "−1.500"),
        (12345, "12\u202f345"),
        (1.23456e-9, "1.23·10⁻⁹"),
        (2.5e12, "2.50·10¹²"),
    ],
)
def test_numbers_are_written_for_readers(value: float, text: str) -> None:
    assert format_number(value) == text


def test_roundoff_beside_numbers_in_the_same_unit_is_shown_as_zero() -> None:
    rows = [(1, 12.5, 3e-20), (2, 11.0, -4e-19), (3, 2e-7, 0.5)]
    columns: tuple[Column[tuple[int, float, float]], ...] = (
        Column(lambda row: row[0], "face", screen="face", report="Face"),
        Column(lambda row: row[1], "gap x [um]", screen=">x", report="x"),
        Column(lambda row: row[2], "gap y [um]", screen=">y", report="y"),
    )
    shown = re.sub("<[^>]*>", " ", str(draw_rows(columns, rows, "gaps")))
    assert " ".join(shown.split()) == "Face x y 1 12.50 0 2 11.00 0 3 2.00·10⁻⁷ 0.5000"
    screen = io.StringIO()
    Screen(file=screen, width=60).print(_format_rows(columns, rows[:2]))
    cells = [word for word in screen.getvalue().split() if word[0].isdigit()]
    assert cells == ["1", "12.5", "0", "2", "11", "0"]


def test_the_bundle_holds_no_end_of_a_script_element_and_its_lock_file_names_no_host() -> None:
    bundle = (VIEWER / "viewer.bundle.js").read_text().lower()
    assert "</script" not in bundle and "<!--" not in bundle
    assert "resolved" not in (VIEWER / "package-lock.json").read_text()
    assert "three.js authors" in (VIEWER / "LICENSES.txt").read_text()
