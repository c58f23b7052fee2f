"""``headstock catalogue``: what it prints, and that what it prints can be pasted."""

import tomllib

import pytest

from common import Shell, approx
from fixture_machines import machine
from headstock.app.actions.cataloguing import _paste_text
from headstock.scene.expansion.catalogue import CATALOGUE, FROM, read_catalogue

ENTRIES = read_catalogue()
KEYS = {"name", "title", "kind", "size", "stiffness", "screw", "stiffness_factor"}


def test_all_elements_are_listed_with_range_and_source(shell: Shell) -> None:
    text = shell("catalogue --json all.json").out
    assert [name for name in ENTRIES if f" {name} " not in text] == []
    assert text.count("range: stiffness within a factor of") == text.count("preload: ") == 9
    assert max(map(len, text.splitlines())) <= 100
    listed = shell.json("all.json")
    assert [entry["name"] for entry in listed] == list(ENTRIES)
    assert all(entry.keys() > KEYS | {"rotation_factor"} and entry["source"] for entry in listed)


@pytest.mark.parametrize("name", ["guide_35", "catalogue:guide_35"])
def test_a_family_or_one_element_is_shown_by_name(shell: Shell, name: str) -> None:
    family, shown = shell("catalogue guide").out, shell(f"catalogue {name}").out
    assert "guide_15" in family and "roller_guide_15" not in family
    # 490 N/um divided and multiplied by 1.6, 240 kN m/rad by 2.5
    assert "normal: 490 N/um, from 310 N/um to 780 N/um" in shown
    assert "pitch: 240 kN m/rad, from 96 kN m/rad to 600 kN m/rad" in shown


@pytest.mark.parametrize("name", ENTRIES)
def test_what_is_printed_to_be_pasted_is_the_element(name: str, shell: Shell) -> None:
    pasted = shell(f"catalogue {name}").out.partition("By its name:")[2]
    named, _, full = pasted.partition("With its values:")
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


PLAIN = 'kind = "mount"\nstiffness = { vertical = "1 N/um", horizontal = "1 N/um" }'


def test_check_run_and_report_say_what_comes_from_the_catalogue(shell: Shell) -> None:
    shell.write(SLIDE)
    printed = shell("check scene.toml --json check.json").out
    (assumed,) = shell.json("check.json")["assumptions"]
    assert assumed.startswith("joints.feet: catalogue:rubber_mount_2kN, stiffness within a factor")
    assert "assumed: joints.feet: catalogue:rubber_mount_2kN" in printed
    printed = shell("run scene.toml --no-figures -o out").out
    summary = shell.json("out/summary.json")
    assert summary["assumptions"] == [assumed]
    # in the middle between two mounts and one: half of the mean of their deflections
    softness = summary["static"]["tcp"]["compliance_um_per_kN"][2][2]
    assert softness == approx(1e3 * (1 / (2 * 1.8) + 1 / 1.8) / 4.0)
    assert "assumed: joints.feet" in printed
    assert "From the catalogue" in shell.text("out/report.html")
    shell.change(('from = "catalogue:rubber_mount_2kN"', PLAIN))
    shell("run scene.toml --no-figures -o out")
    assert "assumptions" not in shell.json("out/summary.json")
    assert "From the catalogue" not in shell.text("out/report.html")


def test_an_unknown_element_is_refused_with_the_nearest_names(shell: Shell) -> None:
    assert "ball_screw_40x10" in shell.refuses("catalogue ball_screw_40x12")


DRIVE = '[joints.drive]\nfrom = "catalogue:wedge_mount_5kN"\nbetween = ["slide.bottom", "ground"]\n'


def test_warnings_come_first_and_several_assumptions_are_one_line(shell: Shell) -> None:
    shell.write(SLIDE + DRIVE, ("rubber_mount_2kN", "air_spring_2kN"))
    said = shell.prints("check scene.toml")
    assert said.count("assumed:") == 1
    assert "2 entries of the catalogue, stiffness within a factor of 2 to 3" in said
    assert said.endswith("joints.feet, joints.drive")
    assert "warning: " not in said.partition("assumed:")[2]
