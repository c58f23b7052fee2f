"""``show`` and ``new``: a newcomer's first five minutes with a part of their own."""

import functools
import json
import os
import shutil
import tomllib
from pathlib import Path

import gmsh
import numpy as np
import pytest
import pyvista

from built_parts import built_part
from common import approx, call
from fixture_machines import machine
from headstock.app.actions import showing
from headstock.app.command_line import main
from headstock.app.pictures import numbered, renderer
from headstock.app.pictures.numbered import LabelledSurface, draw_numbered
from headstock.app.pictures.picture import Picture
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.skins import box_skin
from headstock.meshing.components.meshing import describe_component
from headstock.meshing.errors import MeshError, MeshTimeError
from headstock.pipeline.preview.rigid_view import view_rigid
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.coupling.coupling import couple
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.building.loader import load_scene

MACHINES = Path(__file__).resolve().parents[3] / "machines"
SUPPORT = Path(__file__).parent.parent.parent / "data" / "support.step"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    monkeypatch.setattr(numbered, "PIXELS", (450, 360))  # a quarter of the arithmetic
    monkeypatch.chdir(tmp_path)
    return tmp_path


def is_png(path: Path) -> bool:
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_a_part_is_drawn_into_a_new_folder_and_listed_with_a_table_that_can_be_pasted(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["show", str(SUPPORT), "-o", "pictures/faces.png", "--json", "faces.json", "--all"]
    printed = call(capsys, words).out
    assert is_png(folder / "pictures" / "faces.png")
    listed = json.loads((folder / "faces.json").read_text())
    assert len(listed["faces"]) == 83
    assert (listed["unit"], listed["warnings"]) == ("mm", [])
    table = printed[printed.index("[components.support.interfaces]") : printed.index("picture:")]
    pasted = tomllib.loads(table)["components"]["support"]["interfaces"]
    assert pasted["bottom"] == {"face": "z-"}
    assert pasted["bore"]["patches"] == [{"face": "face:12"}, {"face": "face:22"}]
    assert {round(1000 * hole["radius"], 2) for hole in listed["holes"]} == {1.5, 3.0, 12.5}


def test_every_side_of_a_box_gets_its_number() -> None:
    skin = box_skin(np.zeros(3), np.array([0.1, 0.2, 0.3]))
    owners = np.repeat(np.arange(1, 7), 2)
    image, labelled = draw_numbered(
        LabelledSurface(
            skin.points, skin.triangles, owners, {n: str(n) for n in range(1, 7)}, "box"
        )
    )
    assert labelled == set(range(1, 7))
    assert image[:4] == b"\x89PNG"


def test_a_machine_is_drawn_before_anything_is_computed(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[LabelledSurface] = []

    @functools.cache
    def picture() -> tuple[bytes, set[int]]:
        return draw_numbered(drawn[0])

    def draw(surface: LabelledSurface) -> tuple[bytes, set[int]]:
        drawn.append(surface)
        return picture()

    monkeypatch.setattr(showing, "draw_numbered", draw)
    scene, at_x = str(MACHINES / "three_axis.toml"), ["--set", 'poses.measured.X="40 mm"']
    printed = call(capsys, ["show", scene, "--json", "machine.json"]).out
    assert is_png(folder / "three_axis_machine.png")
    assert sorted(path.name for path in folder.iterdir() if path.name[0] != ".") == [
        "machine.json",
        "three_axis_machine.png",
    ]
    listed = json.loads((folder / "machine.json").read_text())
    assert listed["joints"]["y_drive"] == {
        "kind": "ball_screw",
        "between": ["y_slider.back", "y_base.screw"],
        "at_m": approx([0.064, 0.0, 0.47]),
        "axes": [approx([0.0, 1.0, 0.0])],
    }
    assert "x_slider" in printed and "linear_guide" in printed and "tcp" in printed
    assert main(["show", scene, *at_x, "--pose", "measured", "--variant", "R"]) == 0
    first, second = ({note.text: note.place for note in surface.notes} for surface in drawn)
    # the slider's pads move with it, and so does the tool's work, not the base's mounts
    np.testing.assert_allclose(second["x_pad_1"] - first["x_pad_1"], [0.04, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(second["air_spring_1"], first["air_spring_1"], atol=1e-12)
    assert set(first) == {*listed["joints"], *listed["points"]}


SUPPORTED = machine("""
machine = "bar"
names = { bar = "plate" }
name = "supported"
without = ["joints"]
components.plate.solid = { box = ["400 mm", "200 mm", "20 mm"] }
components.plate.at = ["1 m", "0 mm", "0 mm"]
components.plate.rotate = { axis = "z", angle = "90 deg" }
components.plate.interfaces = { tip = { face = "x+", coupling = "average" } }
components.holder.material = "steel"
components.holder.solid = { step = "support.step" }
components.holder.interfaces.holes.patches = [{ face = "face:6" }, { face = "face:39" }]
supports.foot = { face = "plate.x-", fix = ["x", "z"] }
supports.holes = { at = "holder.holes", fix = ["y"] }
analyses.static = { at = "tcp" }
""")


def test_supports_are_drawn_where_they_are_with_a_cone_per_fixed_direction(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[LabelledSurface] = []

    def draw(surface: LabelledSurface) -> tuple[bytes, set[int]]:
        drawn.append(surface)
        return b"", set()

    monkeypatch.setattr(showing, "draw_numbered", draw)
    shutil.copy(SUPPORT, folder / "support.step")
    (folder / "supported.toml").write_text(SUPPORTED)
    assert main(["show", "supported.toml", "--json", "m.json"]) == 0
    supports = json.loads((folder / "m.json").read_text())["supports"]
    # the plate's x is the machine's y, its foot the lower end of that
    assert supports["foot"] == {
        "component": "plate",
        "fixed": ["x", "z"],
        "at_m": [approx([1.0, -0.2, 0.01])],
    }
    assert len(supports["holes"]["at_m"]) == 2
    cones = [marks for marks in drawn[0].marks if marks.shape == "cone"]
    assert [len(marks.places) for marks in cones] == [2, 2]
    assert cones[0].directions is not None
    np.testing.assert_allclose(cones[0].directions, [[0, -1, 0], [0, 0, -1]], atol=1e-12)
    assert any("support" in text for text, _ in drawn[0].legend)


def test_what_is_drawn_of_a_machine_is_what_its_results_show() -> None:
    scene = load_scene(MACHINES / "three_axis.toml", variant="R")
    pose = scene.poses["measured"]
    view = view_rigid(scene, pose)[0].poses["measured"]
    coupled = couple(
        {
            name: reduce_rigid(part, describe_component(part))
            for name, part in scene.machine.components.items()
        },
        scene.machine,
        pose,
    )
    for spring in coupled.joint_springs:
        np.testing.assert_array_equal(view.joints[spring.name].frame.origin, spring.frame.origin)
        np.testing.assert_array_equal(
            view.joints[spring.name].frame.rotation, spring.frame.rotation
        )


@pytest.mark.parametrize(
    ("machine", "bodies"), [("tripteor", 10), pytest.param("guideway", 2, marks=pytest.mark.trials)]
)
def test_mechanisms_and_rails_are_drawn_too(folder: Path, machine: str, bodies: int) -> None:
    assert main(["show", str(MACHINES / f"{machine}.toml"), "-o", "m.png", "--json", "m.json"]) == 0
    assert is_png(folder / "m.png")
    assert len(json.loads((folder / "m.json").read_text())["components"]) == bodies


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["three_axis.toml", "--pose", "nowhere"], "no pose 'nowhere'; poses: reference, measured"),
        (["three_axis.toml", "--window"], "--window needs a display, and DISPLAY is not set"),
        (["three_axis.toml", "--variant", "Z"], "variant 'Z'"),
        (
            ["three_axis.toml", "--set", 'components.base.fidelity="soft"'],
            "components.base.fidelity",
        ),
        (["step_column.step", "--pose", "x"], "--pose goes with a scene"),
    ],
)
def test_a_bad_request_ends_with_code_2_and_no_picture(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    assert main(["show", str(MACHINES / arguments[0]), *arguments[1:]]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert list(folder.glob("*.png")) == []


def test_a_window_shows_the_machine_with_all_names(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[Picture] = []

    def keep(pictures: list[Picture]) -> None:
        shown.extend(pictures)

    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(numbered, "open_window", keep)
    assert main(["show", str(MACHINES / "cantilever.toml"), "--window"]) == 0
    assert {note.text for note in shown[0].notes} >= {"column", "clamp"}
    assert list(folder.glob("*.png")) == []

    made = pyvista.Plotter(off_screen=True)
    monkeypatch.setattr(made, "show", lambda: None)
    monkeypatch.setattr(pyvista, "Plotter", lambda **given: made)
    renderer.open_window(shown)
    assert made.renderer.bounds[1] > 0.0
    made.close()


def test_numbers_of_hidden_faces_are_not_drawn_through_a_part() -> None:
    inner, outer = (box_skin(np.full(3, -size), np.full(3, size)) for size in (0.1, 0.3))
    points = np.vstack([inner.points, outer.points])
    triangles = np.vstack([inner.triangles, outer.triangles + len(inner.points)])
    owners = np.repeat(np.arange(1, 13), 2)
    labels = {n: str(n) for n in range(1, 13)}
    _, labelled = draw_numbered(LabelledSurface(points, triangles, owners, labels, "boxes"))
    assert labelled == set(range(7, 13))


def test_a_new_box_scene_loads_and_names_what_it_computes(folder: Path) -> None:
    assert main(["new", "first"]) == 0
    scene = load_scene(folder / "first" / "first.toml")
    assert ModalRequest in scene.analyses
    assert StaticRequest in scene.analyses
    assert scene.warnings == ()


def test_a_new_scene_of_a_part_checks_and_holds_a_copy_of_it(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_COMMAND", "my clone/headstock")
    assert main(["new", "mine", "--part", str(SUPPORT)]) == 0
    assert (folder / "mine" / "support.step").read_bytes() == SUPPORT.read_bytes()
    assert main(["check", "mine/mine.toml"]) == 0
    scene = load_scene(folder / "mine" / "mine.toml")
    assert scene.accuracy is not None and scene.accuracy.to == 0.02
    assert set(scene.machine.components["part"].interfaces) == {"bottom", "top"}
    said = capsys.readouterr().out
    assert "fixed at bottom: plane, 7.662 cm^2: 34.45 × 27.01 mm at (-8, 0, -10) mm\n" in said
    assert "loaded at top: plane, 3.534 cm^2" in said
    assert "next: 'my clone/headstock' run mine/mine.toml" in said


@pytest.mark.trials
def test_suggestions_left_as_comments_are_valid_when_the_comment_signs_go(folder: Path) -> None:
    assert main(["new", "mine", "--part", str(SUPPORT)]) == 0
    path = folder / "mine" / "mine.toml"
    lines = path.read_text().splitlines()
    start = lines.index("[components.part.interfaces]")
    end = lines.index("", start)
    lines[start:end] = [
        line if line.startswith("# others") else line.removeprefix("# ")
        for line in lines[start:end]
    ]
    path.write_text("\n".join(lines))
    interfaces = set(load_scene(path).machine.components["part"].interfaces)
    assert interfaces >= {"bottom", "top", "holes_1", "holes_2", "bore", "face_19", "face_17"}


def test_the_scene_of_a_plate_with_screw_holes_has_a_variant_that_is_fixed_at_them_alone(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with built_part(folder / "plate.step"):
        occ = gmsh.model.occ
        plate = occ.addBox(0, 0, 0, 80, 60, 20)
        holes = [(3, occ.addCylinder(x, y, 0, 0, 0, 20, 4)) for x in (15, 65) for y in (15, 45)]
        occ.cut([(3, plate)], holes)
    assert main(["new", "mine", "--part", "plate.step"]) == 0
    assert "--variant screws: fixed at 4 holes of 8 mm" in capsys.readouterr().out
    scene = load_scene(folder / "mine" / "mine.toml", variant="screws")
    assert "screws" in str(scene.machine.joints["clamp"].ends)
    interfaces = scene.machine.components["part"].interfaces
    assert len(interfaces["screws"].patches) == 4
    assert {name: one.coupling for name, one in interfaces.items()} == {
        "bottom": "average", "top": "average", "screws": "rigid",
    }  # fmt: skip


def test_a_part_that_cannot_be_meshed_is_not_called_ready(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(component: Component, **_: object) -> None:
        raise MeshError(f"{component.name}: face 7 crosses face 9")

    monkeypatch.setattr("headstock.app.actions.starting.mesh_component", refuse)
    said = call(capsys, ["new", "mine", "--part", str(SUPPORT)], 1)
    assert "part: face 7 crosses face 9" in said.err
    assert "ready" not in said.out
    assert (folder / "mine" / "mine.toml").is_file()


def test_a_part_that_is_slow_to_mesh_is_ready_without_a_trial(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def take_long(component: Component, *, time_limit: float) -> None:
        raise MeshTimeError(f"{component.name}: stopped after {time_limit} s")

    monkeypatch.setattr("headstock.app.actions.starting.mesh_component", take_long)
    said = call(capsys, ["new", "mine", "--part", str(SUPPORT)], 0)
    assert "meshing takes more than 8 s of processor time" in said.out
    assert "mine.toml is ready" in " ".join(said.out.split())


def test_nothing_is_overwritten_by_a_new_scene(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "mine").mkdir()
    (folder / "mine" / "notes.txt").write_text("precious")
    assert main(["new", "mine"]) == 2
    assert [path.name for path in (folder / "mine").iterdir()] == ["notes.txt"]
    assert "choose another name" in capsys.readouterr().err


def test_a_failed_start_leaves_no_folder(folder: Path) -> None:
    (folder / "broken.step").write_text("ISO-10303-21;\nnonsense")
    assert main(["new", "mine", "--part", "broken.step"]) == 1
    assert main(["new", "other", "--part", "missing.step"]) == 2
    assert main(["new", "third", "--part", "part.stl"]) == 2
    assert [path.name for path in folder.iterdir() if path.is_dir() and path.name != "store"] == []


def test_a_solid_of_an_assembly_is_chosen_by_name_and_number(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with built_part(folder / "pair.step"):
        for place in (0, 50):
            gmsh.model.occ.addBox(place, 0, 0, 10 + place, 10, 10)
    said = call(capsys, ["show", "pair.step"], 2).err
    assert said.startswith("error: pair.step holds 2 solids; choose one: --solid 1")
    assert said.count("pair.step") == 2, "once as the file, once in what to write"
    assert "60 × 10 × 10 mm" in call(capsys, ["show", "pair.step", "--solid", "2"]).out
    assert main(["new", "mine", "--part", "pair.step", "--solid", "2"]) == 0
    assert tomllib.loads((folder / "mine" / "mine.toml").read_text())["components"]["part"][
        "solid"
    ] == {"step": "pair.step", "solid": 2}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["show", "missing.step"], "no file"),
        (["show", "pipe.step"], "no regular file"),
        (["show", "missing.toml"], "missing.toml"),
        (["show", "part.step", "--component", "x"], "--component goes with a scene"),
        (["show", "odd.step"], "odd.step:3 holds -NaN in place of a number"),
        (["new", "odd", "--part", "odd.step"], "odd.step:3 holds -NaN in place of a number"),
    ],
)
def test_what_cannot_be_shown_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    os.mkfifo(folder / "pipe.step")
    (folder / "odd.step").write_text(
        "ISO-10303-21;\n#1=X('(NAN,',0.);\n#2=CARTESIAN_POINT('',(0.,-NaN,0.));\n"
    )
    assert words in call(capsys, arguments, 2).err


def write_support_mesh(folder: Path, name: str) -> Path:
    assert main(["new", "cad", "--part", str(SUPPORT)]) == 0
    scene = str(folder / "cad" / "cad.toml")
    # fillets of 10 mm and holes of 3 mm in facets that are coarse against them
    size = 'components.part.mesh.size="6 mm"'
    assert main(["export", scene, "--set", size, "--mesh", str(folder / name)]) == 0
    return folder / name


@pytest.mark.trials
def test_a_part_from_a_mesh_takes_the_three_commands_of_a_step_part(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_support_mesh(folder, "part.xdmf")
    capsys.readouterr()
    printed = call(capsys, ["show", "part.xdmf", "-o", "mesh.png", "--json", "mesh.json"]).out
    assert is_png(folder / "mesh.png") and "lengths are taken as m" in printed
    listed = json.loads((folder / "mesh.json").read_text())
    assert {one["name"] for one in listed["sets"]} == {"top", "bottom"}
    # the holes that the STEP file has, found in facets
    assert {round(1000 * hole["radius"], 2) for hole in listed["holes"]} == {1.5, 12.5}
    table = printed[printed.index("[components.part.interfaces]") : printed.index("picture:")]
    pasted = tomllib.loads(table)["components"]["part"]["interfaces"]
    assert pasted["bottom"] == {"face": "set:bottom"} and set(pasted) >= {"holes_1", "bore"}
    assert main(["new", "mine", "--part", "part.xdmf", "--unit", "1 m"]) == 0
    assert (folder / "mine" / "part_mesh.h5").is_file()
    scene = load_scene(folder / "mine" / "mine.toml")
    assert scene.machine.components["part"].interfaces.keys() == {"bottom", "top"}
    cad = ["run", "cad/cad.toml", "-o", "a", "--set", 'components.part.mesh.size="6 mm"']
    own = ["run", str(scene.path), "-o", "b"]
    quick = [
        "--no-figures",
        "--set",
        "analyses.modal.count=1",
        "--set",
        "components.part.reduction.modes=2",
    ]
    found = []
    for command in (cad, own):
        assert main([*command, *quick]) == 0
        summary = json.loads((folder / command[3] / "summary.json").read_text())
        found.append(summary["modal"][0]["frequencies_hz"][0])
    assert found[1] == approx(found[0], rel=1e-9)


def test_options_of_one_kind_of_file_are_refused_with_the_other(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "part.med").write_bytes(b"")
    assert main(["show", str(SUPPORT), "--unit", "1 mm"]) == 2
    assert main(["show", "part.med", "--solid", "2"]) == 2
    assert main(["show", "part.med", "--unit", "1 kg"]) == 2
    assert main(["new", "mine", "--part", "part.stl"]) == 2
    assert "--unit goes with a mesh file" in capsys.readouterr().err


def test_areas_of_interfaces_and_rails_lie_on_their_faces_and_look_outward(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[LabelledSurface] = []

    def draw(surface: LabelledSurface) -> tuple[bytes, set[int]]:
        drawn.append(surface)
        return b"", set()

    monkeypatch.setattr(showing, "draw_numbered", draw)
    mill = Path(__file__).parents[3] / "machines" / "mill.toml"
    assert main(["show", str(mill), "--pose", "low"]) == 0
    (surface,) = drawn
    assert ("rail: 4", (0.25, 0.27, 0.3)) in surface.legend
    rails = surface.triangles[surface.owners == len(surface.labels) + 2]
    a, b, c = surface.points[rails].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a) / 2.0
    up, front = normals[:, 2] > 0.0, normals[:, 1] > 0.0
    assert (up ^ front).all()  # on the saddle upwards, on the column to the operator
    assert normals[up, 2].sum() == approx(2 * 0.64 * 0.028)
    assert normals[front, 1].sum() == approx(2 * 0.68 * 0.034)
    np.testing.assert_allclose(surface.points[rails[front], 1], -0.43, atol=2e-3)
