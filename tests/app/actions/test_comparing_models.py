"""``headstock compare`` of a scene without variants: the same machine rigid, segmented and of finite
elements, in every answer that they have.
"""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from common import Shell, approx
from fixture_machines import machine
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Fidelity
from headstock.geometry.parts.solids import Box
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.solvers.second_order import ComplexArray
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


COMPARE = "compare scene.toml -o out"


@pytest.fixture
def bar(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> Shell:
    monkeypatch.setenv("COLUMNS", "120")
    shell.write(SCENE)
    return shell


def compare(bar: Shell, options: str = "") -> Any:
    """Content of ``compare.json``."""
    bar(f"{COMPARE} {options}")
    return bar.json("out/compare.json")


def read_response(path: Path, before: str, point: str) -> tuple[FloatArray, ComplexArray]:
    """Lines [Hz] and values of a direct response in a CSV file."""
    with path.open(newline="") as file:
        heads, *rows = list(csv.reader(file))
    numbers = np.array(rows, dtype=float)
    real, imaginary = (
        numbers[:, heads.index(f"{before}{part} {point} / {point} [m per N]")]
        for part in ("Re", "Im")
    )
    return numbers[:, 0], real + 1j * imaginary


def test_a_scene_without_variants_compares_its_fidelities_and_says_what_each_is_good_for(
    bar: Shell,
) -> None:
    printed = bar.prints(COMPARE)
    summary = bar.json("out/compare.json")
    assert summary["columns"] == ["rigid", "segmented", "elastic"] == list(summary["variants"])
    assert summary["reference"] == "elastic" and set(summary["verdicts"]) == {"rigid", "segmented"}
    for text in (
        *("f1 bar bends X", "Compliance at tcp", "bar 0 %", "largest dynamic compliance"),
        *("largest difference from elastic", "processor seconds", "peak memory [MB]", "at best"),
        *("rigid: agrees for f5 within", "segmented: agrees for compliance within"),
        *("; lacks f6 (", "Hz, bar bends X, MAC"),
    ):
        assert text in printed, text
    rigid = summary["verdicts"]["rigid"]
    (missed,) = rigid["missing"]
    assert missed["part"] == "bar" and missed["part_share"] > 0.3 and missed["mac"] < 0.5
    found, wanted = (
        np.diag(summary["variants"][name]["static"]["tcp"]["compliance_um_per_kN"])
        for name in ("rigid", "elastic")
    )
    deviations = [rigid["compliance"][f"tcp {direction}"] for direction in "xyz"]
    assert deviations == approx(found / wanted - 1.0, abs=1e-12)
    page = bar.text("out/compare.html")
    for text in ("rigid: agrees for f5 within", "Shapes (MAC)", "Frequency responses"):
        assert text in page
    assert "peak memory" in page


def test_the_columns_have_the_numbers_of_runs_and_responses_differ_as_their_files_do(
    bar: Shell,
) -> None:
    variants = compare(bar)["variants"]
    runs = {}
    for name in ("rigid", "elastic"):
        bar(f"run scene.toml -o {name} --no-figures --set components.bar.fidelity={name}")
        (runs[name],) = (bar.folder / name / "tables").glob("frf_*.csv")
    variant, alone = variants["elastic"], bar.json("elastic/summary.json")
    (modes,), (response,) = alone["modal"], alone["frf"].values()
    assert variant["frequencies_hz"] == approx(modes["frequencies_hz"], rel=1e-12)
    point = alone["static"]["tcp"]
    for key in ("compliance_6x6", "compliance_um_per_kN"):
        scale = np.abs(point[key]).max()
        assert np.abs(np.subtract(variant["static"]["tcp"][key], point[key])).max() < 1e-12 * scale
    direct = [entry for entry in variant["frf"] if entry["output"] == entry["input"]]
    assert len(direct) == len(response["drive_points"]) == 3
    for entry, channel in zip(direct, response["drive_points"], strict=True):
        found = [1e9 * entry["most_negative_real"], 1e-6 / entry["peak"]]
        keys = ("most_negative_real_um_per_kN", "minimum_dynamic_stiffness_N_per_um")
        assert found == approx([channel[key] for key in keys], rel=1e-12)
        assert entry["peak_mode"] == channel["minimum_dynamic_stiffness_mode"]
    crossed = 0
    for entry in variants["rigid"]["frf"]:
        if entry["output"] != entry["input"]:
            assert entry["negligible"], "a bar of two planes of symmetry"
            crossed += 1
            continue
        name = " ".join(entry["output"])
        lines, right = read_response(runs["elastic"], "", name)
        away, found = np.abs(read_response(runs["rigid"], "", name)[1] - right), entry["difference"]
        assert found["size"] == approx(away.max(), rel=1e-10)
        assert found["at_hz"] == approx(lines[np.argmax(away)])
        assert found["share_of_peak"] == approx(away.max() / np.abs(right).max(), rel=1e-10)
        assert found["agrees_to_hz"] is None and away[0] > 0.1 * abs(right[0])
    assert crossed < len(variants["rigid"]["frf"])
    # the same lines in the comparison's own file
    mine = read_response(bar.folder / "out" / "responses.csv", "rigid ", "tcp x")[1]
    other = read_response(runs["rigid"], "", "tcp x")[1]
    assert np.allclose(mine, other, rtol=1e-10, atol=0.0)


def test_a_response_agrees_up_to_the_line_before_the_first_that_is_off(bar: Shell) -> None:
    entries = compare(bar, "--fidelity segmented,elastic")["variants"]["segmented"]["frf"]
    responses = bar.folder / "out" / "responses.csv"
    lines, wanted = read_response(responses, "elastic ", "tcp y")
    off = np.abs(read_response(responses, "segmented ", "tcp y")[1] - wanted) > 0.1 * np.abs(wanted)
    (entry,) = (each for each in entries if each["output"] == each["input"] == ["tcp", "y"])
    first = int(np.argmax(off))
    assert off.any() and first > 0
    assert entry["difference"]["agrees_to_hz"] == lines[first - 1]


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
    shell: Shell,
) -> None:
    path = MACHINES / "three_axis.toml"
    options = "--variants 'as written' --fidelity rigid,segmented --pose reference"
    shell(f"compare {path} -o out {options}")
    summary = shell.json("out/compare.json")
    assert summary["reference"] == "segmented"
    rigid = summary["variants"]["rigid"]
    mass, stiffness, rows = hand_assembled(path)
    eigenvalues = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    count = len(rigid["frequencies_hz"])
    assert count > 6
    frequencies = np.sqrt(eigenvalues[:count]) / (2.0 * np.pi)
    assert rigid["frequencies_hz"] == approx(frequencies, rel=1e-8)
    compliance = 1e9 * rows @ np.linalg.solve(stiffness, rows.T)
    found = rigid["static"]["tcp"]["compliance_um_per_kN"]
    assert np.allclose(found, compliance, rtol=1e-7, atol=1e-6)


def test_what_a_fidelity_cannot_have_says_why_beside_those_that_can(bar: Shell) -> None:
    # fixed at its foot, a rigid bar has no dof left
    mount = SCENE[SCENE.index('kind = "mount"') : SCENE.index("[points.tcp]")]
    bar.change((mount, 'kind = "rigid"\n'))
    printed = bar(COMPARE).out
    summary = bar.json("out/compare.json")
    assert list(summary["variants"]) == ["segmented", "elastic"]
    assert summary["columns"] == ["rigid", "segmented", "elastic"]
    assert "no dof is left" in summary["not_computed"]["rigid"]
    assert "rigid: cannot: no dof is left" in printed
    assert "cannot" in bar.text("out/compare.html")


def test_a_part_from_step_cannot_be_segmented_and_the_other_fidelities_stay() -> None:
    scene = MACHINES / "step_column.toml"
    fidelities: tuple[Fidelity, ...] = ("rigid", "segmented", "elastic")
    rigid, segmented, elastic = choose_variants(scene, ("as written",), fidelities=fidelities)
    assert (rigid.cannot, elastic.cannot) == ("", "")
    assert segmented.cannot.startswith("components.column.fidelity: cannot be segmented")
    # one model is none to compare: then it is an error of the scene
    with pytest.raises(SceneError, match="cannot be segmented"):
        choose_variants(scene, ("as written",), fidelities=fidelities[1:])


def test_a_response_without_damping_says_that_its_peaks_have_no_top(bar: Shell) -> None:
    bar.change(("[effects]\ndamping = { modal = 0.02 }\n", ""))
    printed = bar.prints(f"{COMPARE} --fidelity rigid,segmented")
    variants = bar.json("out/compare.json")["variants"]
    assert all(variant["frf"] for variant in variants.values())
    for variant in variants.values():
        assert all(entry["peak"] is None and entry["reason"] for entry in variant["frf"])
    assert "rigid, segmented: cannot: response" in printed
    assert "dynamic compliance cannot cannot" in printed


def test_where_there_is_nothing_to_compare_the_remedy_is_named(bar: Shell) -> None:
    said = bar.refuses(f"{COMPARE} --set components.bar.fidelity=rigid")
    assert "nothing to compare" in said and "components.bar.fidelity=elastic" in said
    assert "out" not in bar.files()


LUMPED = (
    "analyses.map=false",
    "analyses.contouring.on_request=true",
    'analyses.path={from={X="-5 mm",Z="200 mm"},to={X="5 mm",Z="205 mm"},feeds=["5 m/min"],time_constant="50 ms"}',
    'analyses.frf={inputs=[["tcp","x"]],outputs=[["tcp","x"]],from="10 Hz",up_to="200 Hz"}',
)


def test_a_lumped_mechanism_is_its_components_in_all_answers(shell: Shell) -> None:
    line = f"compare {MACHINES / 'tripteor.toml'} --variants lumped,components -o out"
    shell(line, *(word for setting in LUMPED for word in ("--set", setting)))
    variants = shell.json("out/compare.json")["variants"]
    lumped, legs = (variants[name] for name in ("lumped", "components"))
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


def test_a_scene_with_variants_compares_them_until_fidelities_are_asked_for(bar: Shell) -> None:
    thick = '[variants.thick]\n"components.bar.solid.box" = ["50 mm", "60 mm", "500 mm"]\n'
    bar.change(("[analyses.frf]", '[variants.thick."analyses.frf"]'), add=thick)
    plain = compare(bar, "--set components.bar.fidelity=segmented")
    assert plain["columns"] == ["as written", "thick"] and plain["verdicts"] == {}
    asked = compare(bar, "--variants thick --fidelity rigid,segmented")
    assert asked["columns"] == ["thick rigid", "thick segmented"]
    assert set(asked["verdicts"]) == {"thick rigid"}
    # what is missing is what these columns lack, not the scene as written
    assert asked["not_compared"] == [] and asked["variants"]["thick rigid"]["frf"]
    written = compare(bar, "--variants 'as written' --fidelity rigid,segmented")
    (reported,) = written["not_compared"]
    assert 'inputs = ["tcp"]' in reported


@pytest.mark.trials
def test_seconds_say_whether_the_components_came_from_the_store(bar: Shell) -> None:
    first, second = (compare(bar)["variants"]["elastic"]["effort"] for _ in range(2))
    assert (first["from_store"], second["from_store"]) == (0, 1)
    assert first["seconds"]["total"] > second["seconds"]["total"]
    assert "(cold)" in bar(f"{COMPARE} --effort").out
    assert bar.json("out/compare.json")["variants"]["elastic"]["effort"]["from_store"] == 0
