"""``headstock catalogue``: what it prints, and that what it prints can be pasted."""

import json
import tomllib
from pathlib import Path

import pytest

from common import approx, call
from fixture_machines import machine
from headstock.app.actions.cataloguing import _paste_text
from headstock.app.command_line import main
from headstock.scene.expansion.catalogue import CATALOGUE, FROM, read_catalogue

ENTRIES = read_catalogue()
KEYS = {
    "name",
    "title",
    "kind",
    "size",
    "stiffness",
    "screw",
    "stiffness_factor",
    "rotation_factor",
}


def test_all_elements_are_listed_with_range_and_source(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = call(capsys, ["catalogue", "--json", str(tmp_path / "all.json")]).out
    assert all(f" {name} " in text for name in ENTRIES)
    assert text.count("range: stiffness within a factor of") == text.count("preload: ") == 9
    assert max(map(len, text.splitlines())) <= 100
    listed = json.loads((tmp_path / "all.json").read_text())
    assert [entry["name"] for entry in listed] == list(ENTRIES)
    assert all(entry.keys() > KEYS and entry["source"] for entry in listed)


def test_a_family_or_one_element_is_shown_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    family = call(capsys, ["catalogue", "guide"]).out
    assert "guide_15" in family and "roller_guide_15" not in family
    for name in ("guide_35", "catalogue:guide_35"):
        shown = call(capsys, ["catalogue", name]).out
        # 490 N/um divided and multiplied by 1.6, 240 kN m/rad by 2.5
        assert "normal: 490 N/um, from 310 N/um to 780 N/um" in shown
        assert "pitch: 240 kN m/rad, from 96 kN m/rad to 600 kN m/rad" in shown


@pytest.mark.parametrize("name", ENTRIES)
def test_what_is_printed_to_be_pasted_is_the_element(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["catalogue", name]) == 0
    named, _, full = (
        capsys.readouterr().out.partition("By its name:")[2].partition("With its values:")
    )
    assert full.strip() == _paste_text(ENTRIES[name])
    joint = tomllib.loads(full)["joints"]["NAME"]
    assert ENTRIES[name].joint.items() <= joint.items()
    assert tomllib.loads(named)["joints"]["NAME"][FROM] == f"{CATALOGUE}{name}"


SLIDE = machine("""
machine = "block"
names = { block = "slide", mount = "feet", foot = "bottom" }
without = ["joints.feet.kind", "joints.feet.stiffness", "analyses.modal"]
components.slide.solid = { box = ["300 mm", "200 mm", "100 mm"] }
components.slide.interfaces = { bottom = { face = "z-" } }
joints.feet.between = ["slide.bottom", "ground"]
joints.feet.from = "catalogue:rubber_mount_2kN"
joints.feet.places = [["100 mm", "80 mm", "0 mm"], ["100 mm", "-80 mm", "0 mm"], ["-100 mm", "0 mm", "0 mm"]]
points.tcp.tool = "slide.bottom"
""")


def test_check_run_and_report_say_what_comes_from_the_catalogue(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, checked, out = tmp_path / "feet.toml", tmp_path / "check.json", tmp_path / "out"
    scene.write_text(SLIDE)
    assert main(["check", str(scene), "--json", str(checked)]) == 0
    (assumed,) = json.loads(checked.read_text())["assumptions"]
    assert assumed.startswith("joints.feet: catalogue:rubber_mount_2kN, stiffness within a factor")
    assert "assumed: joints.feet: catalogue:rubber_mount_2kN" in capsys.readouterr().out
    assert main(["run", str(scene), "--no-figures", "-o", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["assumptions"] == [assumed]
    # in the middle between two mounts and one: half of the mean of their deflections
    softness = summary["static"]["tcp"]["compliance_um_per_kN"][2][2]
    assert softness == approx(1e3 * (1 / (2 * 1.8) + 1 / 1.8) / 4.0)
    assert "assumed: joints.feet" in capsys.readouterr().out
    assert "From the catalogue" in (out / "report.html").read_text()
    plain = SLIDE.replace(
        'from = "catalogue:rubber_mount_2kN"',
        'kind = "mount"\nstiffness = { vertical = "1 N/um", horizontal = "1 N/um" }',
    )
    scene.write_text(plain)
    assert main(["run", str(scene), "--no-figures", "-o", str(out)]) == 0
    assert "assumptions" not in json.loads((out / "summary.json").read_text())
    assert "From the catalogue" not in (out / "report.html").read_text()


def test_an_unknown_element_is_refused_with_the_nearest_names(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert "ball_screw_40x10" in call(capsys, ["catalogue", "ball_screw_40x12"], 2).err


def test_warnings_come_first_and_several_assumptions_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "feet.toml"
    scene.write_text(
        SLIDE.replace("rubber_mount_2kN", "air_spring_2kN")
        + '[joints.drive]\nfrom = "catalogue:wedge_mount_5kN"\nbetween = ["slide.bottom", "ground"]\n'
    )
    assert main(["check", str(scene)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.count("assumed:") == 1
    assert "2 entries of the catalogue, stiffness within a factor of 2 to 3" in said
    assert said.endswith("joints.feet, joints.drive")
    assert "warning: " not in said.partition("assumed:")[2]
