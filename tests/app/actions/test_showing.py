"""``show`` and ``new``: a newcomer's first five minutes with a part of their own."""

import functools
import os
import shutil
import tomllib
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
import pyvista

from built_parts import built_part
from common import Shell, approx
from fixture_machines import stored_scene
from headstock.app.actions import showing
from headstock.app.pictures import numbered, renderer
from headstock.app.pictures.numbered import LabelledSurface, draw_numbered
from headstock.app.pictures.picture import Picture
from headstock.geometry.machine.machine import Machine
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
THREE_AXIS = MACHINES / "three_axis.toml"
SUPPORT = Path(__file__).resolve().parents[2] / "data" / "support.step"


@pytest.fixture(autouse=True)
def _small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numbered, "PIXELS", (450, 360))  # a quarter of the arithmetic


def is_png(path: str) -> bool:
    return Path(path).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[LabelledSurface]:
    """What was drawn; the first is made a picture of."""
    found: list[LabelledSurface] = []

    @functools.cache
    def picture() -> tuple[bytes, set[int]]:
        return draw_numbered(found[0])

    def draw(surface: LabelledSurface) -> tuple[bytes, set[int]]:
        found.append(surface)
        return picture()

    monkeypatch.setattr(showing, "draw_numbered", draw)
    return found


def pasted(printed: str, name: str) -> Any:
    """The interfaces of a component in the table that is printed to be pasted."""
    table = printed[printed.index(f"[components.{name}.interfaces]") : printed.index("picture:")]
    return tomllib.loads(table)["components"][name]["interfaces"]


def test_a_part_is_drawn_into_a_new_folder_and_listed_with_a_table_that_can_be_pasted(
    shell: Shell,
) -> None:
    printed = shell(f"show {SUPPORT} -o pictures/faces.png --json faces.json --all").out
    assert is_png("pictures/faces.png")
    listed = shell.json("faces.json")
    assert len(listed["faces"]) == 83
    assert (listed["unit"], listed["warnings"]) == ("mm", [])
    interfaces = pasted(printed, "support")
    assert interfaces["bottom"] == {"face": "z-"}
    assert interfaces["bore"]["patches"] == [{"face": "face:12"}, {"face": "face:22"}]
    assert {round(1000 * hole["radius"], 2) for hole in listed["holes"]} == {1.5, 3.0, 12.5}


def test_every_side_of_a_box_gets_its_number() -> None:
    skin = box_skin(np.zeros(3), np.array([0.1, 0.2, 0.3]))
    owners, names = np.repeat(np.arange(1, 7), 2), {n: str(n) for n in range(1, 7)}
    surface = LabelledSurface(skin.points, skin.triangles, owners, names, "box")
    image, labelled = draw_numbered(surface)
    assert labelled == set(range(1, 7))
    assert image[:4] == b"\x89PNG"


def test_a_machine_is_drawn_before_anything_is_computed(
    shell: Shell, drawn: list[LabelledSurface]
) -> None:
    printed = shell(f"show {THREE_AXIS} --json machine.json").out
    assert is_png("three_axis_machine.png")
    files = {name for name in shell.files() if name[0] != "."}
    assert files == {"machine.json", "three_axis_machine.png"}
    listed = shell.json("machine.json")
    assert listed["joints"]["y_drive"] == {
        "kind": "ball_screw",
        "between": ["y_slider.back", "y_base.screw"],
        "apart_m": approx(0.0265),
        "at_m": approx([0.064, 0.0, 0.47]),
        "axes": [approx([0.0, 1.0, 0.0])],
    }
    assert "x_slider" in printed and "linear_guide" in printed and "tcp" in printed
    at_x = """--set 'poses.measured.X="40 mm"'"""
    shell(f"show {THREE_AXIS} {at_x} --pose measured --variant R")
    first, second = ({note.text: note.place for note in surface.notes} for surface in drawn)
    # the slider's pads move with it, and so does the tool's work, not the base's mounts
    np.testing.assert_allclose(second["x_pad_1"] - first["x_pad_1"], [0.04, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(second["air_spring_1"], first["air_spring_1"], atol=1e-12)
    assert set(first) == {*listed["joints"], *listed["points"]}


SUPPORTED = stored_scene("showing_supported")


def test_supports_are_drawn_where_they_are_with_a_cone_per_fixed_direction(
    shell: Shell, drawn: list[LabelledSurface]
) -> None:
    shutil.copy(SUPPORT, shell.folder)
    shell.write(SUPPORTED)
    shell("show scene.toml --json m.json")
    supports = shell.json("m.json")["supports"]
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
    scene = load_scene(THREE_AXIS, variant="R")
    pose, parts = scene.poses["measured"], scene.machine.components
    view = view_rigid(scene, pose)[0].poses["measured"]
    rigid = {name: reduce_rigid(part, describe_component(part)) for name, part in parts.items()}
    springs = couple(rigid, scene.machine, pose).joint_springs
    assert springs
    for spring in springs:
        frame = view.joints[spring.name].frame
        np.testing.assert_array_equal(frame.origin, spring.frame.origin)
        np.testing.assert_array_equal(frame.rotation, spring.frame.rotation)


@pytest.mark.parametrize(
    ("machine", "bodies"), [("tripteor", 10), pytest.param("guideway", 2, marks=pytest.mark.trials)]
)
def test_mechanisms_and_rails_are_drawn_too(shell: Shell, machine: str, bodies: int) -> None:
    shell(f"show {MACHINES / machine}.toml -o m.png --json m.json")
    assert is_png("m.png")
    assert len(shell.json("m.json")["components"]) == bodies


STEP = MACHINES / "step_column.step"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (f"{THREE_AXIS} --pose nowhere", "no pose 'nowhere'; poses: reference, measured"),
        (f"{THREE_AXIS} --window", "--window needs a display, and DISPLAY is not set"),
        (f"{THREE_AXIS} --variant Z", "variant 'Z'"),
        (f"{THREE_AXIS} --set components.base.fidelity=soft", "components.base.fidelity"),
        (f"{STEP} --pose x", "--pose goes with a scene"),
        (f"{SUPPORT} --unit '1 mm'", "--unit goes with a mesh file"),
        ("missing.step", "no file"),
        ("pipe.step", "no regular file"),
        ("missing.toml", "missing.toml"),
        ("part.step --component x", "--component goes with a scene"),
        ("odd.step", "odd.step:3 holds -NaN in place of a number"),
        ("part.med --solid 2", "part.med"),
        ("part.med --unit '1 kg'", "1 kg"),
    ],
)
def test_a_bad_request_ends_with_code_2_and_no_picture(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, line: str, words: str
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    write_odd_files(shell)
    assert words in shell.refuses(f"show {line}")
    assert list(shell.folder.glob("*.png")) == []


def write_odd_files(shell: Shell) -> None:
    os.mkfifo("pipe.step")
    Path("part.med").write_bytes(b"")
    Path("broken.step").write_text("ISO-10303-21;\nnonsense")
    odd = "ISO-10303-21;\n#1=X('(NAN,',0.);\n#2=CARTESIAN_POINT('',(0.,-NaN,0.));\n"
    Path("odd.step").write_text(odd)
    (shell.folder / "mine").mkdir()
    (shell.folder / "mine" / "notes.txt").write_text("precious")


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("mine", 2, "choose another name"),
        ("other --part odd.step", 2, "odd.step:3 holds -NaN in place of a number"),
        ("other --part broken.step", 1, "broken.step"),
        ("other --part missing.step", 2, "missing.step"),
        ("other --part part.stl", 2, "part.stl"),
    ],
)
def test_a_start_that_fails_leaves_no_folder_and_overwrites_nothing(
    shell: Shell, line: str, code: int, words: str
) -> None:
    write_odd_files(shell)
    assert words in shell.refuses(f"new {line}", code=code)
    assert shell.files("mine") == {"notes.txt"} and "other" not in shell.files()


def test_a_window_shows_the_machine_with_all_names(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[Picture] = []
    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(numbered, "open_window", shown.extend)
    shell(f"show {MACHINES / 'cantilever.toml'} --window")
    assert {note.text for note in shown[0].notes} >= {"column", "clamp"}
    assert list(shell.folder.glob("*.png")) == []

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


def test_a_new_box_scene_loads_and_names_what_it_computes(shell: Shell) -> None:
    shell("new first")
    scene = load_scene(shell.folder / "first" / "first.toml")
    assert ModalRequest in scene.analyses and StaticRequest in scene.analyses
    assert scene.warnings == ()


def new_part(shell: Shell, options: str = f"--part {SUPPORT}") -> str:
    """What is printed of a new scene of a part."""
    return shell(f"new mine {options}").out


def load_mine(shell: Shell, variant: str | None = None) -> Machine:
    return load_scene(shell.folder / "mine" / "mine.toml", variant=variant).machine


def test_a_new_scene_of_a_part_checks_and_holds_a_copy_of_it(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_COMMAND", "my clone/headstock")
    said = new_part(shell)
    assert (shell.folder / "mine" / "support.step").read_bytes() == SUPPORT.read_bytes()
    shell("check mine/mine.toml")
    scene = load_scene(shell.folder / "mine" / "mine.toml")
    assert scene.accuracy is not None and scene.accuracy.to == 0.02
    assert set(scene.machine.components["part"].interfaces) == {"bottom", "top"}
    assert "fixed at bottom: plane, 7.662 cm^2: 34.45 × 27.01 mm at (-8, 0, -10) mm\n" in said
    assert "loaded at top: plane, 3.534 cm^2" in said
    assert "next: 'my clone/headstock' run mine/mine.toml" in said


@pytest.mark.trials
def test_suggestions_left_as_comments_are_valid_when_the_comment_signs_go(shell: Shell) -> None:
    new_part(shell)
    path = shell.folder / "mine" / "mine.toml"
    lines = path.read_text().splitlines()
    start = lines.index("[components.part.interfaces]")
    end = lines.index("", start)
    lines[start:end] = [
        line if line.startswith("# others") else line.removeprefix("# ")
        for line in lines[start:end]
    ]
    path.write_text("\n".join(lines))
    interfaces = set(load_mine(shell).components["part"].interfaces)
    assert interfaces >= {"bottom", "top", "holes_1", "holes_2", "bore", "face_19", "face_17"}


def test_the_scene_of_a_plate_with_screw_holes_has_a_variant_that_is_fixed_at_them_alone(
    shell: Shell,
) -> None:
    with built_part(shell.folder / "plate.step"):
        occ = gmsh.model.occ
        plate = occ.addBox(0, 0, 0, 80, 60, 20)
        holes = [(3, occ.addCylinder(x, y, 0, 0, 0, 20, 4)) for x in (15, 65) for y in (15, 45)]
        occ.cut([(3, plate)], holes)
    assert "--variant screws: fixed at 4 holes of 8 mm" in new_part(shell, "--part plate.step")
    machine = load_mine(shell, "screws")
    assert "screws" in str(machine.joints["clamp"].ends)
    interfaces = machine.components["part"].interfaces
    assert len(interfaces["screws"].patches) == 4
    couplings = {name: one.coupling for name, one in interfaces.items()}
    assert couplings == {"bottom": "average", "top": "average", "screws": "rigid"}


def test_a_part_that_cannot_be_meshed_is_not_called_ready(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(component: Component, **_: object) -> None:
        raise MeshError(f"{component.name}: face 7 crosses face 9")

    monkeypatch.setattr("headstock.app.actions.starting.mesh_component", refuse)
    said = shell(f"new mine --part {SUPPORT}", code=1)
    assert "part: face 7 crosses face 9" in said.err
    assert "ready" not in said.out
    assert "mine.toml" in shell.files("mine")


def test_a_part_that_is_slow_to_mesh_is_ready_without_a_trial(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    def take_long(component: Component, *, time_limit: float) -> None:
        raise MeshTimeError(f"{component.name}: stopped after {time_limit} s")

    monkeypatch.setattr("headstock.app.actions.starting.mesh_component", take_long)
    said = shell.prints(f"new mine --part {SUPPORT}")
    assert "meshing takes more than 8 s of processor time" in said
    assert "mine.toml is ready" in said


def test_a_solid_of_an_assembly_is_chosen_by_name_and_number(shell: Shell) -> None:
    with built_part(shell.folder / "pair.step"):
        for place in (0, 50):
            gmsh.model.occ.addBox(place, 0, 0, 10 + place, 10, 10)
    said = shell("show pair.step", code=2).err
    assert said.startswith("error: pair.step holds 2 solids; choose one: --solid 1")
    assert said.count("pair.step") == 2, "once as the file, once in what to write"
    assert "60 × 10 × 10 mm" in shell("show pair.step --solid 2").out
    new_part(shell, "--part pair.step --solid 2")
    part = tomllib.loads(shell.text("mine/mine.toml"))["components"]["part"]
    assert part["solid"] == {"step": "pair.step", "solid": 2}


@pytest.mark.trials
def test_a_part_from_a_mesh_takes_the_three_commands_of_a_step_part(shell: Shell) -> None:
    # fillets of 10 mm and holes of 3 mm in facets that are coarse against them
    size = "--set 'components.part.mesh.size=6 mm'"
    shell(f"new cad --part {SUPPORT}")
    shell(f"export cad/cad.toml {size} --mesh part.xdmf")
    printed = shell("show part.xdmf -o mesh.png --json mesh.json").out
    assert is_png("mesh.png") and "lengths are taken as m" in printed
    listed = shell.json("mesh.json")
    assert {one["name"] for one in listed["sets"]} == {"top", "bottom"}
    # the holes that the STEP file has, found in facets
    assert {round(1000 * hole["radius"], 2) for hole in listed["holes"]} == {1.5, 12.5}
    interfaces = pasted(printed, "part")
    assert interfaces["bottom"] == {"face": "set:bottom"}
    assert set(interfaces) >= {"holes_1", "bore"}
    new_part(shell, "--part part.xdmf --unit '1 m'")
    assert "part_mesh.h5" in shell.files("mine")
    assert load_mine(shell).components["part"].interfaces.keys() == {"bottom", "top"}
    quick = "--no-figures --set analyses.modal.count=1 --set components.part.reduction.modes=2"
    shell(f"run cad/cad.toml -o a {size} {quick}")
    shell(f"run mine/mine.toml -o b {quick}")
    cad, mesh = (shell.json(f"{name}/summary.json")["modal"][0] for name in "ab")
    assert mesh["frequencies_hz"][0] == approx(cad["frequencies_hz"][0], rel=1e-9)


def test_areas_of_interfaces_and_rails_lie_on_their_faces_and_look_outward(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[LabelledSurface] = []

    def draw(surface: LabelledSurface) -> tuple[bytes, set[int]]:
        drawn.append(surface)
        return b"", set()

    monkeypatch.setattr(showing, "draw_numbered", draw)
    shell(f"show {MACHINES / 'mill.toml'} --pose low")
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
