"""Patches on curved faces of STEP parts: where the middle of an interface is, a spring there tells."""

from pathlib import Path

import gmsh
import numpy as np
import pytest

import headstock as hs
from built_parts import built_part
from common import approx

pytestmark = pytest.mark.process

RADIUS = 50.0  # [mm]
STIFFNESS, TORSION = 100e6, 1e6  # [N/m], [N m/rad]
SCENE = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"

[components.shaft]
fidelity = "rigid"
solid = {{ step = "shaft.step" }}
material = "steel"
interfaces.end = {{ face = "z+" }}
interfaces.seat = {{ face = "face:1", {patch} }}

[joints.seat]
kind = "spring"
between = ["ground", "shaft.seat"]
axis = "x"
normal = "z"
stiffness = {{ x = "100 N/um", y = "100 N/um", z = "100 N/um", rx = "1e6 N m/rad", ry = "1e6 N m/rad", rz = "1e6 N m/rad" }}

[points]
tcp = {{ tool = "shaft.end", work = "ground" }}

[analyses.static]
at = "tcp"
"""


def write_shaft(path: Path, *, in_halves: bool, as_splines: bool = False) -> None:
    with built_part(path):
        occ = gmsh.model.occ
        if in_halves:
            arcs = [
                occ.addCircle(0, 0, 0, RADIUS, angle1=start, angle2=start + np.pi)
                for start in (0.0, np.pi)
            ]
            occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(arcs)]))], 0, 0, 100)
        else:
            occ.addCylinder(0, 0, 0, 0, 0, 100, RADIUS)
        if as_splines:
            occ.convertToNURBS(occ.getEntities(3))


def compliance(folder: Path, patch: str) -> float:
    """Of the end of the shaft along z, in the middle [m/N]."""
    (folder / "scene.toml").write_text(SCENE.format(patch=patch))
    result = hs.run(folder / "scene.toml")
    return float(result.static["reference"]["tcp"].compliance[2, 2])


def test_a_strip_around_a_shaft_is_a_band_and_one_around_a_half_of_it_half_a_band(
    tmp_path: Path,
) -> None:
    write_shaft(tmp_path / "shaft.step", in_halves=False)
    band = 'strip = { along = "y", width = "20 mm", center = ["50 mm", "0 mm", "50 mm"] }'
    assert compliance(tmp_path, band) == approx(1.0 / STIFFNESS, rel=1e-6)
    write_shaft(tmp_path / "shaft.step", in_halves=True)
    half = 'strip = { along = "x", width = "20 mm", center = ["0 mm", "50 mm", "50 mm"] }'
    middle = 2e-3 * RADIUS / np.pi
    assert compliance(tmp_path, half) == approx(1.0 / STIFFNESS + middle**2 / TORSION, rel=1e-6)


def test_a_disk_that_wraps_around_a_shaft_is_refused_by_name(tmp_path: Path) -> None:
    write_shaft(tmp_path / "shaft.step", in_halves=False)
    with pytest.raises(hs.HeadstockError, match=r"seat: the disk of 120 mm.*wraps around"):
        compliance(tmp_path, 'disk = { diameter = "120 mm", center = ["50 mm", "0 mm", "50 mm"] }')


def test_a_shaft_of_two_spline_faces_has_the_volume_of_its_mesh_and_the_gaps(
    tmp_path: Path,
) -> None:
    """The CAD kernel integrates over such faces to 0.2 %, more than a mesh may be off."""
    write_shaft(tmp_path / "shaft.step", in_halves=True, as_splines=True)
    text = SCENE.format(patch="").replace(",  }", " }")
    text = text.replace('fidelity = "rigid"', 'mesh = { size = "30 mm" }')
    text = text.replace('"face:1"', '"face:3"').replace('"z+"', '"face:4"')
    (tmp_path / "scene.toml").write_text(text)
    result = hs.run(tmp_path / "scene.toml")
    mass = 7850.0 * np.pi * (1e-3 * RADIUS) ** 2 * 0.1
    assert result.components["shaft"].mass_kg == approx(mass, rel=2e-4)


def test_a_band_on_a_tube_acts_in_its_middle(tmp_path: Path) -> None:
    band = 'band = { width = "20 mm", center = ["30 mm", "0 mm", "40 mm"] }'
    text = SCENE.replace('step = "shaft.step"', 'tube = {{ outer = "100 mm", length = "100 mm" }}')
    text = text.replace('"face:1"', '"outer"').format(patch=band)
    (tmp_path / "scene.toml").write_text(text)
    static = hs.run(tmp_path / "scene.toml").static["reference"]["tcp"]
    expected = 1.0 / STIFFNESS + 0.06**2 / TORSION
    assert static.compliance[0, 0] == approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("patch", "words"),
    [
        (
            'face = "z+", ring = { diameter = "30 mm", inner = "30 mm" }',
            "not smaller than the outer",
        ),
        (
            'face = "z+", band = { width = "20 mm" }',
            r"band goes around a cylinder, and z\+ is plane",
        ),
        ('face = "outer", disk = { diameter = "20 mm" }', "disk needs a flat face.*write a band"),
        ('face = "outer", band = { width = "120 mm" }', "band reaches beyond the face"),
        (
            'face = "z+", rect = { size = ["57 mm", "57 mm"], angle = "20 deg" }',
            "reaches beyond the round face of 80 mm",
        ),
        (
            'face = "z+", ring = { diameter = "60 mm", inner = "30 mm" }, disk = { diameter = "9 mm" }',
            "gives disk and ring, but a patch is one of disk, rect, strip, band, ring, outline",
        ),
        (
            'face = "z+", outline = { corners = [["0 m", "0 m", "0 m"], ["9 mm", "9 mm", "0 m"], '
            '["9 mm", "0 m", "0 m"], ["0 m", "9 mm", "0 m"]] }',
            "its sides to corners 2 and 4 cross",
        ),
    ],
)
def test_a_shape_that_cannot_be_laid_on_a_tube_is_named(
    tmp_path: Path, patch: str, words: str
) -> None:
    text = SCENE.replace('step = "shaft.step"', 'tube = {{ outer = "80 mm", length = "100 mm" }}')
    text = text.replace('face = "face:1", {patch}', patch.replace("{", "{{").replace("}", "}}"))
    (tmp_path / "scene.toml").write_text(text.format())
    with pytest.raises(hs.SceneError, match=words):
        hs.load(tmp_path / "scene.toml")


def test_an_outline_in_a_file_is_that_of_its_corners(tmp_path: Path) -> None:
    text = SCENE.replace('step = "shaft.step"', 'box = ["60 mm", "60 mm", "40 mm"]')
    text = text.replace('"face:1", {patch}', '"z+", {patch}')
    (tmp_path / "corners.csv").write_text("x,y,z\n0,0,0.04\n0.03,0,0.04\n0,0.03,0.04\n")
    corners = '[["0 m", "0 m", "40 mm"], ["30 mm", "0 m", "40 mm"], ["0 m", "30 mm", "40 mm"]]'
    for outline in ('file = "corners.csv"', f"corners = {corners}"):
        (tmp_path / "scene.toml").write_text(text.format(patch=f"outline = {{ {outline} }}"))
        (patch,) = (
            hs.load(tmp_path / "scene.toml")
            .scene.machine.components["shaft"]
            .interfaces["seat"]
            .patches
        )
        assert patch.center == approx((0.01, 0.01, 0.04)) and len(patch.corners) == 3
    (tmp_path / "corners.csv").write_text("x,y\n0,0\n")
    (tmp_path / "scene.toml").write_text(text.format(patch='outline = { file = "corners.csv" }'))
    with pytest.raises(hs.SceneError, match=r"seat.outline.file(.|\n)*corners.csv"):
        hs.load(tmp_path / "scene.toml")
