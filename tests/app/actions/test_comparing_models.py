"""``headstock compare`` of a scene without variants: the same machine rigid, segmented and of finite
elements, in every answer that they have.
"""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from common import approx
from fixture_machines import machine, write_scene
from headstock.app.command_line import main
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.solids import Box
from headstock.scene.building.loader import load_scene
from headstock.studies.variants import choose_variants

MACHINES = Path(__file__).parents[3] / "machines"
SCENE = machine("""
machine = "block"
names = { block = "bar" }
name = "A bar on springs"
components.bar.solid = { box = ["40 mm", "60 mm", "500 mm"] }
components.bar.fidelity = "elastic"
components.bar.mesh = { size = "20 mm", cells = "hex" }
joints.mount.kind = "mount"
joints.mount.stiffness = { vertical = "200 N/um", horizontal = "60 N/um", tilt = "4 kN m/mrad", torsion = "4 kN m/mrad" }
analyses.frf = { inputs = ["tcp"], up_to = "900 Hz", points = 181, adaptive = false }
effects.damping = { modal = 0.02 }
""")


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    monkeypatch.setenv("COLUMNS", "120")
    path = write_scene(tmp_path, SCENE, name="bar")
    return path


def compare(path: Path, *arguments: str) -> dict[str, Any]:
    """Content of ``compare.json``."""
    out = path.parent / "out"
    assert main(["compare", str(path), "-o", str(out), *arguments]) == 0
    content: dict[str, Any] = json.loads((out / "compare.json").read_text())
    return content


def read_lines(path: Path) -> tuple[list[str], FloatArray]:
    """Headings and numbers of a CSV file of responses."""
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    return rows[0], np.array(rows[1:], dtype=float)


def test_a_scene_without_variants_compares_its_fidelities_and_says_what_each_is_good_for(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = compare(scene)
    printed = " ".join(capsys.readouterr().out.split())
    assert summary["columns"] == ["rigid", "segmented", "elastic"] == list(summary["variants"])
    assert summary["reference"] == "elastic" and set(summary["verdicts"]) == {"rigid", "segmented"}
    for text in (
        "f1 bar bends X",
        "Compliance at tcp",
        "bar 0 %",
        "largest dynamic compliance",
        "largest difference from elastic",
        "processor seconds",
        "peak memory [MB]",
        "at best",
        "rigid: agrees for f5 within",
        "segmented: agrees for compliance within",
        "; lacks f6 (",
        "Hz, bar bends X, MAC",
    ):
        assert text in printed, text
    rigid = summary["verdicts"]["rigid"]
    (missed,) = rigid["missing"]
    assert missed["part"] == "bar" and missed["part_share"] > 0.3 and missed["mac"] < 0.5
    wanted = summary["variants"]["elastic"]["static"]["tcp"]["compliance_um_per_kN"]
    found = summary["variants"]["rigid"]["static"]["tcp"]["compliance_um_per_kN"]
    for place, direction in enumerate("xyz"):
        assert rigid["compliance"][f"tcp {direction}"] == approx(
            found[place][place] / wanted[place][place] - 1.0, abs=1e-12
        )
    page = (scene.parent / "out" / "compare.html").read_text()
    assert "rigid: agrees for f5 within" in page and "Shapes (MAC)" in page
    assert "Frequency responses" in page and "peak memory" in page


def test_the_elastic_column_has_the_numbers_of_a_run(scene: Path) -> None:
    variant = compare(scene)["variants"]["elastic"]
    run = scene.parent / "run"
    assert main(["run", str(scene), "-o", str(run), "--no-figures"]) == 0
    alone = json.loads((run / "summary.json").read_text())
    (modes,), (response,) = alone["modal"], alone["frf"].values()
    assert variant["frequencies_hz"] == approx(modes["frequencies_hz"], rel=1e-12)
    point = alone["static"]["tcp"]
    for key in ("compliance_6x6", "compliance_um_per_kN"):
        scale = np.abs(point[key]).max()
        assert np.abs(np.subtract(variant["static"]["tcp"][key], point[key])).max() < 1e-12 * scale
    direct = [entry for entry in variant["frf"] if entry["output"] == entry["input"]]
    assert len(direct) == len(response["drive_points"]) == 3
    for entry, channel in zip(direct, response["drive_points"], strict=True):
        assert entry["most_negative_real"] * 1e9 == approx(
            channel["most_negative_real_um_per_kN"], rel=1e-12
        )
        assert 1e-6 / entry["peak"] == approx(
            channel["minimum_dynamic_stiffness_N_per_um"], rel=1e-12
        )
        assert entry["peak_mode"] == channel["minimum_dynamic_stiffness_mode"]


def test_the_difference_of_responses_is_that_of_the_files_of_two_runs(scene: Path) -> None:
    entries = compare(scene)["variants"]["rigid"]["frf"]
    curves = {}
    for fidelity in ("rigid", "elastic"):
        run = scene.parent / fidelity
        chosen = f"components.bar.fidelity={fidelity}"
        assert main(["run", str(scene), "-o", str(run), "--no-figures", "--set", chosen]) == 0
        (file,) = (run / "tables").glob("frf_*.csv")
        curves[fidelity] = read_lines(file)
    for entry in entries:
        if entry["output"] != entry["input"]:
            assert entry["negligible"], "a bar of two planes of symmetry"
            continue
        name = " ".join(entry["output"])
        values = {}
        for fidelity, (heads, numbers) in curves.items():
            columns = [heads.index(f"{part} {name} / {name} [m per N]") for part in ("Re", "Im")]
            values[fidelity] = numbers[:, columns[0]] + 1j * numbers[:, columns[1]]
        lines = curves["elastic"][1][:, 0]
        away = np.abs(values["rigid"] - values["elastic"])
        found, sizes = entry["difference"], np.abs(values["elastic"])
        assert found["size"] == approx(away.max(), rel=1e-10)
        assert found["at_hz"] == approx(lines[np.argmax(away)])
        assert found["share_of_peak"] == approx(away.max() / sizes.max(), rel=1e-10)
        assert found["agrees_to_hz"] is None and away[0] > 0.1 * sizes[0]
    # the same lines in the comparison's own file
    heads, numbers = read_lines(scene.parent / "out" / "responses.csv")
    mine = numbers[:, heads.index("rigid Re tcp x / tcp x [m per N]")]
    other = curves["rigid"][1][:, curves["rigid"][0].index("Re tcp x / tcp x [m per N]")]
    assert np.allclose(mine, other, rtol=1e-10, atol=0.0)


def test_a_response_agrees_up_to_the_line_before_the_first_that_is_off(scene: Path) -> None:
    compared = compare(scene, "--fidelity", "segmented,elastic")
    heads, numbers = read_lines(scene.parent / "out" / "responses.csv")
    values = {
        name: numbers[:, heads.index(f"{name} Re tcp y / tcp y [m per N]")]
        + 1j * numbers[:, heads.index(f"{name} Im tcp y / tcp y [m per N]")]
        for name in ("segmented", "elastic")
    }
    off = np.abs(values["segmented"] - values["elastic"]) > 0.1 * np.abs(values["elastic"])
    (entry,) = (
        each
        for each in compared["variants"]["segmented"]["frf"]
        if each["output"] == each["input"] == ["tcp", "y"]
    )
    first = int(np.argmax(off))
    assert off.any() and first > 0
    assert entry["difference"]["agrees_to_hz"] == numbers[first - 1, 0]


def hand_assembled(path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mass, stiffness and rows of the tool against the work ``(3, n)`` of a machine of rigid boxes,
    written out about their centres of mass in machine axes.
    """
    machine = load_scene(path).machine
    names, centers, masses = list(machine.components), {}, []
    for name, component in machine.components.items():
        assert isinstance(component.solid, Box)
        sizes = np.array(component.solid.size)
        mass = component.mass or component.material.density * sizes.prod()
        centers[name] = component.placement.origin + np.array([0.0, 0.0, 0.5 * sizes[2]])
        moments = mass / 12.0 * ((sizes**2).sum() - sizes**2)
        masses += [mass] * 3 + list(moments)

    def motion_at(name: str | None, place: FloatArray) -> FloatArray:
        """Motion ``(6, n)`` of a place on a body."""
        rows = np.zeros((6, 6 * len(names)))
        if name is not None:
            x, y, z = place - centers[name]
            lever = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
            first = 6 * names.index(name)
            rows[:, first : first + 6] = np.block(
                [[np.eye(3), lever], [np.zeros((3, 3)), np.eye(3)]]
            )
        return rows

    stiffness, fixed = np.zeros((6 * len(names), 6 * len(names))), []
    for joint in machine.joints.values():
        one, other = joint.ends
        point = joint.point
        if point is None:
            assert joint.fixed == tuple(range(6)), "rigid wherever its point is"
            point = centers[str(one.component)]
        apart = motion_at(other.component, point) - motion_at(one.component, point)
        own = np.kron(np.eye(2), joint.rotation.T) @ apart
        stiffness += own.T @ joint.stiffness @ own
        fixed += [own[row] for row in joint.fixed]
    free = scipy.linalg.null_space(np.array(fixed))
    tool = machine.components["z_slider"].placement.origin
    # the work is carried to where the tool is: the forces on both are in one line
    rows = motion_at("z_slider", tool)[:3] - motion_at("x_slider", tool)[:3]
    return free.T @ np.diag(masses) @ free, free.T @ stiffness @ free, rows @ free


def test_the_rigid_column_of_a_shipped_machine_is_the_lumped_model_assembled_by_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    path, out = MACHINES / "three_axis.toml", tmp_path / "out"
    arguments = ["--variants", "as written", "--fidelity", "rigid,segmented", "--pose", "reference"]
    assert main(["compare", str(path), "-o", str(out), *arguments]) == 0
    summary = json.loads((out / "compare.json").read_text())
    assert summary["reference"] == "segmented"
    rigid = summary["variants"]["rigid"]
    mass, stiffness, rows = hand_assembled(path)
    eigenvalues = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    frequencies = np.sqrt(eigenvalues) / (2.0 * np.pi)
    count = len(rigid["frequencies_hz"])
    assert count > 6
    assert rigid["frequencies_hz"] == approx(frequencies[:count], rel=1e-8)
    compliance = 1e9 * rows @ np.linalg.solve(stiffness, rows.T)
    assert np.allclose(
        rigid["static"]["tcp"]["compliance_um_per_kN"], compliance, rtol=1e-7, atol=1e-6
    )


def test_what_a_fidelity_cannot_have_says_why_beside_those_that_can(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # fixed at its foot, a rigid bar has no dof left
    mount = SCENE[SCENE.index('kind = "mount"') : SCENE.index("[points.tcp]")]
    scene.write_text(SCENE.replace(mount, 'kind = "rigid"\n'))
    summary = compare(scene)
    printed = capsys.readouterr().out
    assert list(summary["variants"]) == ["segmented", "elastic"]
    assert summary["columns"] == ["rigid", "segmented", "elastic"]
    assert "no dof is left" in summary["not_computed"]["rigid"]
    assert "rigid: cannot: no dof is left" in printed
    assert "cannot" in (scene.parent / "out" / "compare.html").read_text()


def test_a_part_from_step_cannot_be_segmented_and_the_other_fidelities_stay() -> None:
    rigid, segmented, elastic = choose_variants(
        MACHINES / "step_column.toml", ("as written",), fidelities=("rigid", "segmented", "elastic")
    )
    assert (rigid.cannot, elastic.cannot) == ("", "")
    assert segmented.cannot.startswith("components.column.fidelity: cannot be segmented")
    # one model is none to compare: then it is an error of the scene
    with pytest.raises(Exception, match="cannot be segmented"):
        choose_variants(
            MACHINES / "step_column.toml", ("as written",), fidelities=("segmented", "elastic")
        )


def test_a_response_without_damping_says_that_its_peaks_have_no_top(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.write_text(SCENE.replace("[effects]\ndamping = { modal = 0.02 }\n", ""))
    summary = compare(scene, "--fidelity", "rigid,segmented")
    printed = " ".join(capsys.readouterr().out.split())
    for variant in summary["variants"].values():
        assert all(entry["peak"] is None and entry["reason"] for entry in variant["frf"])
    assert "rigid, segmented: cannot: response" in printed
    assert "dynamic compliance cannot cannot" in printed


def test_where_there_is_nothing_to_compare_the_remedy_is_named(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, rigid = scene.parent / "none", "components.bar.fidelity=rigid"
    assert main(["compare", str(scene), "-o", str(out), "--set", rigid]) == 2
    reported, message = capsys.readouterr().err, "components.bar.fidelity=elastic"
    assert "nothing to compare" in reported and message in reported and not out.exists()


def test_a_lumped_mechanism_is_its_components_in_all_answers(tmp_path: Path) -> None:
    settings = (
        "analyses.map=false",
        "analyses.contouring.on_request=true",
        'analyses.path={from={X="-5 mm",Z="200 mm"},to={X="5 mm",Z="205 mm"},feeds=["5 m/min"],time_constant="50 ms"}',
        'analyses.frf={inputs=[["tcp","x"]],outputs=[["tcp","x"]],from="10 Hz",up_to="200 Hz"}',
    )
    given = [word for setting in settings for word in ("--set", setting)]
    scene, out = str(MACHINES / "tripteor.toml"), tmp_path / "out"
    assert main(["compare", scene, "--variants", "lumped,components", "-o", str(out), *given]) == 0
    summary = json.loads((out / "compare.json").read_text())
    lumped, legs = (summary["variants"][name] for name in ("lumped", "components"))
    assert lumped["frequencies_hz"] == approx(legs["frequencies_hz"], rel=1e-6)
    mac = np.array((lumped if lumped["mac"] else legs)["mac"])
    assert np.diag(mac) == approx(np.ones(6), abs=1e-6)
    one, other = (np.array(each["static"]["tcp"]["compliance_6x6"]) for each in (lumped, legs))
    assert np.abs(one - other).max() < 1e-6 * np.abs(other).max()
    assert sum(lumped["static"]["tcp"]["budget"]["x"].values()) == approx(1.0)
    assert lumped["frf"][0]["peak"] == approx(legs["frf"][0]["peak"], rel=1e-6)
    assert {*lumped["others"]} == {*legs["others"]} >= {"path deviation"}
    deviations = legs["others"]["path deviation"]
    assert deviations
    for name, number in deviations.items():
        value = lumped["others"]["path deviation"][name]["value"]
        assert value == approx(number["value"], rel=1e-4, abs=1e-9)


def test_a_scene_with_variants_compares_them_until_fidelities_are_asked_for(scene: Path) -> None:
    scene.write_text(
        SCENE + '[variants.thick]\n"components.bar.solid.box" = ["50 mm", "60 mm", "500 mm"]\n'
    )
    scene.write_text(scene.read_text().replace("[analyses.frf]", '[variants.thick."analyses.frf"]'))
    plain = compare(scene, "--set", "components.bar.fidelity=segmented")
    assert plain["columns"] == ["as written", "thick"] and plain["verdicts"] == {}
    asked = compare(scene, "--variants", "thick", "--fidelity", "rigid,segmented")
    assert asked["columns"] == ["thick rigid", "thick segmented"]
    assert set(asked["verdicts"]) == {"thick rigid"}
    # what is missing is what these columns lack, not the scene as written
    assert asked["not_compared"] == [] and asked["variants"]["thick rigid"]["frf"]
    (reported,) = compare(scene, "--variants", "as written", "--fidelity", "rigid,segmented")[
        "not_compared"
    ]
    assert 'inputs = ["tcp"]' in reported


@pytest.mark.trials
def test_seconds_say_whether_the_components_came_from_the_store(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = compare(scene)["variants"]["elastic"]["effort"]
    second = compare(scene)["variants"]["elastic"]["effort"]
    assert (first["from_store"], second["from_store"]) == (0, 1)
    assert first["seconds"]["total"] > second["seconds"]["total"]
    capsys.readouterr()
    cold = compare(scene, "--effort")["variants"]["elastic"]["effort"]
    assert cold["from_store"] == 0 and "(cold)" in capsys.readouterr().out
