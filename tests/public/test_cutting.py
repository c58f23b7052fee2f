"""Cutting coefficients of one's own, materials by name, up and down milling, and limits of mills."""

import tomllib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

import headstock as hs
from common import Shell, approx, read_json
from fixture_machines import stored_scene, write_scene

STEEL = 'Ktc = "1800 N/mm^2"\nKrc = "540 N/mm^2"\nKac = "0 N/mm^2"\nKte = "30 N/mm"\nKre = "9 N/mm"'
SCENE = stored_scene("cutting")


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    return write_scene(folder, SCENE, *changes, *([("STEEL", STEEL)] if not changes else []))


def run(folder: Path, analysis: str, settings: dict[str, str] | None = None) -> dict[str, Any]:
    """``summary.json`` of a run with settings."""
    if not (folder / "scene.toml").exists():
        write(folder)
    machine = hs.load(folder / "scene.toml", set=settings or {})
    hs.run(machine, analyses=[analysis], output=folder / "out")
    found: dict[str, Any] = read_json(folder / "out" / "summary.json")
    return found


def mill(folder: Path, **settings: str) -> dict[str, dict[str, Any]]:
    """Of a path with keys of its cut, what is told of the tool point in x, y, z."""
    own = {f"analyses.path.cut.{key}": value for key, value in settings.items()}
    outputs = run(folder, "path", own)["path"]["feeds"][0]["outputs"]
    return {each["dof"][1]: each for each in outputs}


def cruise(folder: Path, **settings: str) -> NDArray[np.float64]:
    """Mean deviation along x, y, z at constant feed over whole turns of the spindle [m]."""
    mill(folder, **settings)
    with h5py.File(folder / "out" / "results.h5") as file:
        (feed,) = file["path"].values()
        total, times = np.array(feed["total"]), np.array(feed["times"])
    begin = int(np.searchsorted(times, 0.1))
    return np.asarray(total[begin : begin + 100].mean(axis=0))


def lowest(folder: Path, settings: dict[str, str] | None = None) -> float:
    """Lowest limit depth of cut [mm]."""
    (pose,) = run(folder, "lobes", settings)["lobes"].values()
    return float(pose["directions"][0]["lowest"]["limit_depth_mm"])


def test_a_slot_deflects_the_tool_by_the_mean_forces_of_altintas(tmp_path: Path) -> None:
    """Manufacturing Automation (2012), chapter 2: average forces of two teeth at 0.2 mm each."""
    found = cruise(tmp_path, radial_depth="10 mm")
    depth, teeth, per_tooth = 1.0, 2.0, 0.2
    along = -teeth * depth * (540.0 * per_tooth / 4.0 + 9.0 / np.pi)
    away = teeth * depth * (1800.0 * per_tooth / 4.0 + 30.0 / np.pi)
    assert found == approx([along / 40e6, away / 60e6, 0.0], rel=3e-3, abs=1e-12)


def test_in_a_slot_both_senses_push_alike(tmp_path: Path) -> None:
    down, up = (cruise(tmp_path, radial_depth="10 mm", sense=sense) for sense in ("down", "up"))
    assert up == approx(down, rel=1e-6, abs=1e-12)
    assert np.abs(down[:2]).min() > 1e-6


def test_the_part_on_the_other_side_with_the_spindle_reversed_is_the_mirror_image(
    tmp_path: Path,
) -> None:
    for sense in ("down", "up"):
        right, left = (cruise(tmp_path, sense=sense, part_side=side) for side in ("right", "left"))
        assert left == approx(right * [1.0, -1.0, 1.0], rel=1e-6, abs=1e-12)
    # without a side the tool turns clockwise: it mills up with the part on its left
    assert cruise(tmp_path, sense="up") == approx(left, rel=1e-9, abs=1e-15)


def test_up_milling_pulls_the_tool_into_the_part_and_down_milling_pushes_it_away(
    tmp_path: Path,
) -> None:
    down, up = (
        cruise(tmp_path, sense=sense, part_side="right", radial_depth="5 mm")
        for sense in ("down", "up")
    )
    # half immersion, both in the axes of the part: its side is that of -y
    chip, edge, ratio = 1800.0 * 0.2, 30.0, 0.3
    square, mixed = np.pi / 4.0, 0.5
    sign = np.array([1.0, -1.0])
    away = 2.0 / (2.0 * np.pi) * (sign * (chip * square + edge) + ratio * (chip * mixed + edge))
    assert np.array([down[1], up[1]]) == approx(away / 60e6, rel=6e-3)
    assert down[1] > 0.0 > up[1]


def test_coefficients_of_the_catalogue_are_those_written_out(tmp_path: Path) -> None:
    own = {
        "cutting.my_steel": '{ Ktc = "767.01 MPa", Krc = "168.8 MPa", Kac = "222 MPa", Kte = "27.7 N/mm", Kre = "26.6 N/mm", Kae = "0.7 kN/m" }'
    }
    written = {key: tomllib.loads(f"v = {value}")["v"] for key, value in own.items()}
    named = {"analyses.path.cut.material": "al7075-t6-dry"}
    outputs = [run(tmp_path, "path", each)["path"]["feeds"] for each in (written, named)]
    assert outputs[0] == outputs[1]


def test_limits_fall_as_coefficients_grow(tmp_path: Path) -> None:
    once = lowest(tmp_path)
    double = {"cutting.my_steel.Ktc": "3600 MPa", "cutting.my_steel.Krc": "1080 MPa"}
    twice = lowest(tmp_path, double)
    assert twice == approx(0.5 * once, rel=1e-3)


def test_kienzle_is_its_tangent_at_the_mean_chip_and_says_where(tmp_path: Path) -> None:
    kienzle = tmp_path / "kienzle"
    kienzle.mkdir()
    text = 'kc11 = "1700 N/mm^2"\nmc = 0.25\nradial_ratio = 0.3\naxial_ratio = 0.0'
    write(kienzle, ("STEEL", text))
    # mean over the arc of a chip of 0.2 mm per tooth at 30 % immersion
    chip = 0.2 * 2.0 * 0.3 / np.arccos(1.0 - 2.0 * 0.3)
    slope, edge = 0.75 * 1700.0 * chip**-0.25, 0.25 * 1700.0 * chip**0.75
    own = {"Ktc": slope, "Krc": 0.3 * slope, "Kac": 0.0}
    lines = [f'{name} = "{value} MPa"' for name, value in own.items()]
    lines += [f'Kte = "{edge} N/mm"', f'Kre = "{0.3 * edge} N/mm"']
    write(tmp_path, ("STEEL", "\n".join(lines)))
    assert cruise(kienzle) == approx(cruise(tmp_path), rel=1e-9, abs=1e-15)
    (line,) = [own for own in run(kienzle, "path")["assumptions"] if "path.cut.material" in own]
    mean = "mean of a chip at 0.2 mm per tooth and 30 % immersion"
    assert f"chip thickness of 0.104 mm ({mean})" in line
    (line,) = [own for own in run(kienzle, "lobes")["assumptions"] if "lobes.material" in own]
    assert "chip thickness of 0.1 mm (assumed" in line and "chip_thickness ± 50 %" in line


def test_the_range_of_a_coefficient_is_a_share_of_the_error(tmp_path: Path) -> None:
    """A machine of one body deviates in proportion to the only coefficient that is not zero."""
    ranged = 'Ktc = "1800 MPa"\nKrc = "0 MPa"\nKac = "0 MPa"\nranges = { Ktc = "10 %" }'
    write(tmp_path, ("STEEL", ranged))
    across = mill(tmp_path)["y"]
    for zone in ("accelerating", "decelerating"):
        share = across["error_share"][zone]["cutting coefficients"]
        assert share == approx(0.1 * abs(across[zone]["peak_um"]), rel=1e-6)
        assert across["errors"][zone]["peak_um"] == approx(share)
    write(tmp_path)
    assert mill(tmp_path)["y"]["errors"]["accelerating"]["peak_um"] is None


def test_a_dozen_materials_are_listed_with_source_and_range(shell: Shell) -> None:
    printed = shell("catalogue cutting --json all.json").out
    listed = shell.json("all.json")
    assert len(listed) >= 12 and all(own["source"] for own in listed)
    assert all(own["name"] in printed for own in listed)
    kienzle = [own["toml"] for own in listed if "kc11" in own["toml"]]
    assert len(kienzle) >= 11 and all("ranges" in own for own in kienzle)


@pytest.mark.parametrize(("setting", "key", "words"), [
    ({"analyses.path.cut.mill.helix": "90 deg"}, "analyses.path.cut.mill.helix", "between -75 and 75 deg"),
    ({"analyses.lobes.mill.helix": "-1.5 rad"}, "analyses.lobes.mill.helix", "between -75 and 75 deg"),
    ({"analyses.lobes.mill.teeth": 41}, "analyses.lobes.mill.teeth", "between 1 and 40"),
    ({"analyses.lobes.mill.diameter": "20 m"}, "analyses.lobes.mill.diameter", "check the unit"),
    ({"analyses.path.cut.mill.runout": "5 mm"}, "analyses.path.cut.mill", "10 % of its diameter"),
    ({"analyses.path.cut.radial_depth": "11 mm"}, "analyses.path.cut.radial_depth", "at most its diameter"),
    ({"analyses.path.cut.sense": "climb"}, "analyses.path.cut.sense", "'down' or 'up'"),
    ({"analyses.lobes.material": "stel"}, "analyses.lobes.material", "[cutting.stel]"),
    ({"analyses.path.cut.up": [1, 0, 0.1]}, "analyses.path.cut.up", "lead angle"),
    ({"analyses.lobes.directions": [[1, 0, 2]]}, "analyses.lobes.directions[0]", "lead angle"),
    ({"cutting.my_steel": {"kc11": "1500 MPa"}}, "cutting.my_steel", "mc = 0.25"),
    ({"cutting.my_steel": {"Ktc": "1500 MPa", "kc11": "1500 MPa"}}, "cutting.my_steel", "keep one"),
    ({"cutting.my_steel": {"Krc": "1500 MPa"}}, "cutting.my_steel", "no tangential force"),
    ({"cutting.my_steel.mc": 0.2}, "cutting.my_steel", "belongs to kc11"),
    ({"cutting.my_steel.ranges": {"Kae": "10 %"}}, "cutting.my_steel", "write Kae as well"),
    ({"cutting.my_steel.Kte": "30 N"}, "cutting.my_steel.Kte", "20 N/mm"),
])  # fmt: skip
def test_what_nobody_can_mill_is_refused_by_key(
    tmp_path: Path, setting: dict[str, Any], key: str, words: str
) -> None:
    with pytest.raises(hs.SceneError) as caught:
        hs.load(write(tmp_path), set=setting)
    found = [own for own in caught.value.problems if own.key == key]
    assert found and any(words in own.message for own in found), str(caught.value)


@pytest.mark.parametrize(("setting", "words"), [
    ({"cutting.my_steel.Ktc": "1800 Pa"}, "cutting.my_steel.Ktc"),
    ({"cutting.my_steel.Krc": "5400 MPa"}, "cutting.my_steel.Krc"),
    ({"cutting.my_steel.Krc": "-540 MPa"}, "into the part"),
    ({"cutting.my_steel.Kre": "-9 N/mm"}, "into the part"),
    ({"cutting.my_steel": {"kc11": "15 GPa", "mc": 0.25}}, "cutting.my_steel.kc11"),
    ({"cutting.my_steel": {"kc11": "1.5 GPa", "mc": 0.9}}, "cutting.my_steel.mc"),
    ({"analyses.path.cut.spindle": "30 rpm"}, "feed per tooth"),
])  # fmt: skip
def test_coefficients_that_look_like_slips_bring_a_warning(
    tmp_path: Path, setting: dict[str, Any], words: str
) -> None:
    path = write(tmp_path)
    assert hs.check(hs.load(path)) == ()
    assert any(words in line for line in hs.check(hs.load(path, set=setting)))
