"""Ways from files: read as a scene would read them, and refused with the line and what to write."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from cases import cases
from headstock.meshing.process.strangers import WAYPOINTS
from headstock.scene.building.loader import load_scene
from headstock.scene.reading import csv_files
from headstock.scene.reading.csv_files import CsvError, read_waypoints
from headstock.scene.reading.findings import SceneError
from headstock.scene.reading.units import ANGLE, LENGTH, parse_quantity
from headstock.scene.studies import Sweep

SLIDE = (Path(__file__).parents[2] / "data" / "slide.toml").read_text()
WAY = (
    '[sweeps.way]\npath = [{ X = "-100 mm" }, { X = "200 mm" }, { X = "150 mm" }]\nstep = "40 mm"\n'
)


def write(folder: Path, text: str) -> Path:
    path = folder / "way.csv"
    path.write_bytes(text.encode())
    return path


def load_way(folder: Path, way: str) -> Sweep:
    assert SLIDE.count(WAY) == 1
    (folder / "scene.toml").write_text(SLIDE.replace(WAY, f"[sweeps.way]\n{way}\n"))
    return load_scene(folder / "scene.toml").sweeps["way"]


def test_positions_are_the_numbers_that_a_scene_with_the_same_digits_has(tmp_path: Path) -> None:
    digits = ["0.1", "-37.123456789", "1e-7", "359.99", "0", "-0.0", "123456.7"]
    rows = "".join(f"{a}, {b}\r\n" for a, b in zip(digits, reversed(digits), strict=True))
    path = read_waypoints(write(tmp_path, f"\ufeffX [mm] ,B[deg]\r\n{rows}\r\n"))
    assert path.axes == ("X", "B") and path.units == ("m", "rad")
    for column, unit, written in ((0, "mm", digits), (1, "deg", digits[::-1])):
        expected = [parse_quantity(f"{text} {unit}", LENGTH, ANGLE).value + 0.0 for text in written]
        assert path.positions[:, column].tolist() == expected
    assert not np.signbit(path.positions[5, 0])
    assert path.lines.tolist() == list(range(2, 9))


def test_a_sweep_along_a_file_has_the_poses_of_the_same_way_written_in_the_scene(
    tmp_path: Path,
) -> None:
    write(tmp_path, "X [mm]\n-100\n200\n150\n")
    from_file = load_way(tmp_path, 'path = "way.csv"\nstep = "40 mm"')
    (tmp_path / "scene.toml").write_text(SLIDE)
    written = load_scene(tmp_path / "scene.toml").sweeps["way"]
    assert (from_file.kind, from_file.axes, from_file.units) == ("path", ("X",), ("m",))
    assert from_file.positions.tobytes() == written.positions.tobytes()


def test_without_a_step_every_row_is_a_pose(tmp_path: Path) -> None:
    write(tmp_path, "X [mm]\n-100\n200\n150\n150\n")
    assert load_way(tmp_path, 'path = "way.csv"').positions.tolist() == [
        [-0.1],
        [0.2],
        [0.15],
        [0.15],
    ]


def test_a_step_without_a_path_and_a_list_without_a_step_are_refused(tmp_path: Path) -> None:
    for way in (
        'axes = { X = ["0 mm", "1 mm", 2] }\nstep = "1 mm"',
        'path = [{ X = "1 mm" }, { X = "2 mm" }]',
    ):
        with pytest.raises(SceneError, match="path and step"):
            load_way(tmp_path, way)


@cases
def test_a_file_that_is_no_way_is_refused_with_its_line(
    tmp_path: Path, text: str, message: str
) -> None:
    plain = ".*".join(re.escape(part) for part in message.split(".*"))
    with pytest.raises(CsvError, match=plain):
        read_waypoints(write(tmp_path, text.replace("LONG", "1" * 200_000)))


def test_bytes_that_are_no_text_and_files_that_are_too_long_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "way.csv"
    path.write_bytes(b"X [mm]\n1\n\xff\n")
    with pytest.raises(CsvError, match=r"way.csv cannot be read: .*utf-8"):
        read_waypoints(path)
    with pytest.raises(CsvError, match=r"gone.csv cannot be read"):
        read_waypoints(tmp_path / "gone.csv")
    monkeypatch.setattr(csv_files, "MOST_WAYPOINTS", 3)
    with pytest.raises(CsvError, match=r"way.csv:5: .* 3 waypoints"):
        read_waypoints(write(tmp_path, "X [mm]\n1\n2\n3\n4\n"))
    monkeypatch.setattr(csv_files, "WAYPOINTS", dataclasses.replace(WAYPOINTS, most_bytes=10))
    with pytest.raises(CsvError, match=r"way.csv has 1.5e-05 MB; a path may have 1e-05 MB"):
        read_waypoints(path)


def test_huge_positions_are_no_trouble_where_an_axis_has_no_limits(tmp_path: Path) -> None:
    write(tmp_path, "X [mm]\n-1e300\n1e300\n")
    scene = SLIDE.replace('limits = ["-260 mm", "260 mm"]\n', "").replace(
        WAY, '[sweeps.way]\npath = "way.csv"\nstep = "1 mm"\n'
    )
    (tmp_path / "scene.toml").write_text(scene)
    with pytest.raises(SceneError, match="100000"):
        load_scene(tmp_path / "scene.toml")
