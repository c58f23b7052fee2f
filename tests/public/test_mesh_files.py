"""Meshes of other programs: every legal form gives the mass and the frequency of the part, and what is no
one part is refused by name, never counted twice and never fatal.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import headstock as hs
from common import approx
from fixture_machines import machine

RHO = 7850.0
LENGTH, WIDTH, CELLS = 200.0, 20.0, 5  # of a bar in millimetres, and its cells
MASS = RHO * LENGTH * WIDTH**2 * 1e-9
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
WEDGES = [(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)]
# middles as Abaqus lists them
HEX_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
HEX_EDGES += [(0, 4), (1, 5), (2, 6), (3, 7)]
WEDGE_EDGES = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
SCENE = machine("""
machine = "bar"
names = { tip = "head", tcp = "head" }
without = ["joints.clamp.kind"]
components.bar.solid = { mesh = "FILE", unit = "1 mm", MORE = "MORE" }
components.bar.fidelity = "FIDELITY"
components.bar.mesh = { allow_locking = true }
components.bar.interfaces = { foot = { face = "FOOT" }, head = { face = "HEAD" } }
joints.clamp.JOINT = "JOINT"
analyses.modal = { count = 2 }
""")
SPRING = """kind = "spring"
stiffness = { x = "1 N/um", y = "1 N/um", z = "1 N/um", rx = "1 N m/mrad", ry = "1 N m/mrad", rz = "1 N m/mrad" }
"""
STEEL = "*Material, name=Steel\n*Density\n 7.85e-09,\n*Elastic\n210000., 0.3\n"


def write_scene(
    path: Path, mesh: str, *, fidelity: str, ends: Sequence[str], more: str = ""
) -> Path:
    joint = 'kind = "rigid"' if fidelity == "elastic" else SPRING
    text = SCENE.replace(', MORE = "MORE"', more).replace('JOINT = "JOINT"', joint)
    words = {"FILE": mesh, "FIDELITY": fidelity, "FOOT": ends[0], "HEAD": ends[1]}
    for key, value in words.items():
        text = text.replace(key, value)
    path.write_text(text)
    return path


class Bar:
    """A bar along z, in cells one upon the other, as Abaqus numbers them."""

    def __init__(self, *, wedges: bool = False, cells: int = CELLS) -> None:
        self.points: list[tuple[float, ...]] = []
        self.rows: dict[tuple[float, ...], int] = {}
        edges, families = (WEDGE_EDGES, WEDGES) if wedges else (HEX_EDGES, [tuple(range(8))])
        self.cells = []
        for layer, family in itertools.product(range(cells), families):
            corners = [self.place(layer, corner) for corner in family]
            middles = [tuple(np.mean([corners[a], corners[b]], axis=0)) for a, b in edges]
            self.cells.append([self.row(place) for place in [*corners, *middles]])

    def place(self, layer: int, corner: int) -> tuple[float, ...]:
        x, y, z = CORNERS[corner]
        return x * WIDTH, y * WIDTH, (layer + z) * LENGTH / CELLS

    def row(self, place: tuple[float, ...]) -> int:
        if place not in self.rows:
            self.rows[place] = len(self.points) + 1
            self.points.append(place)
        return self.rows[place]

    def nodes(self) -> str:
        return "".join(f"{n}, {x}, {y}, {z}\n" for n, (x, y, z) in enumerate(self.points, 1))

    def elements(self, first: int = 1) -> str:
        return "".join(
            f"{number}, {', '.join(map(str, cell[:9]))},\n {', '.join(map(str, cell[9:]))}\n"
            for number, cell in enumerate(self.cells, first)
        )

    def at(self, height: float) -> str:
        return ", ".join(str(n) for n, place in enumerate(self.points, 1) if place[2] == height)

    def sets(self) -> str:
        foot, head = (self.at(height).split(", ") for height in (0.0, LENGTH))
        text = ""
        for name, members in (("FOOT", foot), ("HEAD", head)):
            text += f"*NSET, NSET={name}\n{', '.join(members[:8])}\n{', '.join(members[8:])}\n"
        return text


def flat(bar: Bar, kind: str) -> str:
    return f"*NODE\n{bar.nodes()}*ELEMENT, TYPE={kind}, ELSET=BAR\n{bar.elements()}{bar.sets()}"


def run(
    folder: Path,
    name: str,
    text: str,
    *,
    fidelity: str = "elastic",
    more: str = "",
    ends: Sequence[str] = ("set:FOOT", "set:HEAD"),
) -> hs.Results:
    (folder / name).write_text(text)
    return hs.run(write_scene(folder / "bar.toml", name, fidelity=fidelity, ends=ends, more=more))


def refuse(folder: Path, name: str, text: str, *, more: str = "") -> str:
    with pytest.raises(hs.HeadstockError) as error:
        run(folder, name, text, fidelity="rigid", more=more, ends=("z-", "z+"))
    return " ".join(str(error.value).split())


def first_hz(result: hs.Results) -> float:
    return float(result.modal[0].frequencies_hz[0])


@pytest.fixture(scope="module")
def straight_hz(tmp_path_factory: pytest.TempPathFactory) -> float:
    return first_hz(run(tmp_path_factory.mktemp("flat"), "bar.inp", flat(Bar(), "C3D20R")))


def cae(bar: Bar, kind: str, *, moves: str = "", extra: str = "", independent: bool = False) -> str:
    """A deck as Abaqus/CAE writes it, of one part in one instance."""
    mesh = f"*Node\n{bar.nodes()}*Element, type={kind}\n{bar.elements()}"
    mesh += f"*Elset, elset=all, internal, generate\n 1, {len(bar.cells)}, 1\n"
    mesh += "*Solid Section, elset=all, material=Steel\n,\n"
    part, instance = ("", mesh) if independent else (mesh, "")
    sets = bar.sets().replace("NSET=", "nset=").replace("FOOT", "Foot, instance=Bar-1")
    sets = sets.replace("HEAD", "Head, instance=Bar-1")
    return (
        f"*Heading\n** Job name: Job-1 Model name: Model-1\n*Part, name=Bar\n{part}*End Part\n"
        f"**\n*Assembly, name=Assembly\n**\n*Instance, name=Bar-1, part=Bar\n{moves}{instance}*End Instance\n"
        f"**\n{extra}{sets}*End Assembly\n{STEEL}*Step, name=Step-1\n*Frequency\n10,\n*End Step\n"
    )


@pytest.mark.parametrize("independent", [False, True])
def test_a_deck_of_cae_moved_and_turned_is_the_same_bar(
    tmp_path: Path, straight_hz: float, independent: bool
) -> None:
    moves = " 300., -40., 7.\n 300., -40., 7., 301., -40., 8., 90.\n"
    extra = (
        "*Node\n 1, 0., 0., 500.\n*Element, type=MASS, elset=m\n1, 1\n*Mass, elset=m\n2.,\n"
        "*Element, type=CONN3D2\n 2, 1, Bar-1.5\n*Element, type=B31\n3, Bar-1.5, Bar-1.6\n4, 1, Bar-1.7\n"
    )
    text = cae(Bar(), "C3D20", moves=moves, extra=extra, independent=independent)
    result = run(tmp_path, "bar.inp", text)
    assert result.components["bar"].mass_kg == approx(MASS, rel=1e-9)
    assert first_hz(result) == approx(straight_hz, rel=1e-6)
    said = [warning for warning in result.warnings if "left out" in warning]
    assert len(said) == 1
    assert "1 MASS, 1 CONN3D2, 2 B31; taken are 5 solid cells" in said[0]


@pytest.mark.parametrize(
    ("kind", "section", "off_solid", "on_solid"),
    [
        ("CPS4", "*SOLID SECTION, ELSET=RIB, MATERIAL=M\n5.,\n", "1 CPS4;", "1 CPS4;"),
        ("CPS4", "*SOLID SECTION, ELSET=BAR, MATERIAL=M\n", "1 CPS4;", ""),
        ("S4R", "", "1 S4R;", ""),
        ("M3D4", "*MEMBRANE SECTION, ELSET=RIB, MATERIAL=M\n5.,\n", "1 M3D4;", "1 M3D4;"),
        ("SFM3D4", "", "", ""),
    ],
)
def test_surface_elements_are_counted_where_they_are_more_than_faces(
    tmp_path: Path, kind: str, section: str, off_solid: str, on_solid: str
) -> None:
    more = f"*NODE\n901, 60., 0., 40.\n902, 60., 20., 40.\n*ELEMENT, TYPE={kind}, ELSET=RIB\n"

    def count_left_out(nodes: str) -> list[str]:
        text = f"{flat(Bar(), 'C3D20')}{more}900, {nodes}\n{section}"
        warnings = run(tmp_path, "bar.inp", text, fidelity="rigid").warnings
        return [warning for warning in warnings if "left out" in warning]

    off, on = count_left_out("2, 901, 902, 3"), count_left_out("1, 2, 3, 4")
    assert (len(off), len(on)) == (bool(off_solid), bool(on_solid))
    assert off_solid in "".join(off)
    assert on_solid in "".join(on)


GENERATED = """*NODE
1, 0., 0., 0.
3, 20., 0., 0.
7, 0., 20., 0.
9, 20., 20., 0.
19, 0., 0., 20.
21, 20., 0., 20.
25, 0., 20., 20.
27, 20., 20., 20.
*NGEN, NSET=EDGE
1, 3, 1
7, 9
*NGEN
19, 21, 1
25, 27, 1
1, 7, 3
2, 8, 3
3, 9, 3
19, 25, 3
20, 26, 3
21, 27, 3
*ELEMENT, TYPE=C3D8, ELSET=E
1, 1, 2, 5, 4, 19, 20, 23, 22
*ELGEN, ELSET=ALL
1, 2, 1, 1, 2, 3, 2
"""
REPEATED = """BEGIN BULK
GRID,1,,0.,0.,0.
=,*(1),=,*(10.),==
=(1)
GRID,11,,0.,20.,0.
=,*1,=,*1.+1,==
=1
GRID,21,,0.,0.,2.D1
=       *1      =       *10.    ==
=(1)
GRID,31,,0.,20.,20.
=,*1,=,*10.,==
=(1)
CHEXA,1,1,1,2,12,11,21,22,+
+,32,31
CHEXA,2,1,2,3,13,12,22,23,+
+,33,32
ENDDATA
"""


@pytest.mark.parametrize(("name", "text"), [("bar.inp", GENERATED), ("bar.bdf", REPEATED)])
def test_nodes_and_elements_made_of_others_are_read(tmp_path: Path, name: str, text: str) -> None:
    result = run(tmp_path, name, text, fidelity="rigid", ends=("z-", "z+"))
    assert result.components["bar"].mass_kg == approx(7850.0 * 0.02**3, rel=1e-12)
    said = refuse(tmp_path, "arc.inp", GENERATED.replace("NSET=EDGE", "LINE=C"))
    assert "arc.inp:10: *NGEN is read along straight lines only" in said


@pytest.mark.parametrize("curved", [False, True])
def test_only_meshes_of_curved_parts_leave_curved_faces_out_of_their_errors(
    tmp_path: Path, curved: bool
) -> None:
    bar = Bar(wedges=True)
    if curved:
        # a tenth of a degree would be flat; this is an arc of 9 degrees from end to end
        bar.points = [(x + 1e-3 * z**2, y, z) for x, y, z in bar.points]
    result = run(tmp_path, "bar.inp", flat(bar, "C3D15"))
    said = str([number.error for number in result.modal[0].list_numbers()])
    assert ("curved faces of bar" in said) == curved


def test_wedges_are_cut_into_tets_of_the_same_part(tmp_path: Path, straight_hz: float) -> None:
    result = run(tmp_path, "bar.inp", flat(Bar(wedges=True), "C3D15"))
    assert result.components["bar"].mass_kg == approx(MASS, rel=1e-9)
    # single tets through the section are stiffer than the hexes
    assert first_hz(result) == approx(straight_hz, rel=0.02)
    assert "10 wedges cut into 30 second-order tets" in " ".join(result.warnings)


def test_short_lines_numbers_with_d_and_continued_keywords_are_read(tmp_path: Path) -> None:
    bar = Bar()
    short = "".join(
        f"{n}" + (f", {x / 10:.4f}D1" if x or y or z else ",")
        + (f", {y / 10:.4f}d+01" if y or z else "") + (f", {z}" if z else "") + "\n"
        for n, (x, y, z) in enumerate(bar.points, 1)
    )  # fmt: skip
    head = "** a comment\n*Heading\n bar, with a comma,\n*nOde,\n nset = All\n"
    text = f"{head}{short}*Element,\n Type=c3d20rh,\n elset=bar\n{bar.elements()}{bar.sets()}"
    result = run(tmp_path, "bar.inp", text, fidelity="rigid")
    assert result.components["bar"].mass_kg == approx(MASS, rel=1e-9)


def test_a_nastran_deck_in_a_turned_cylindrical_system_is_the_same_bar(
    tmp_path: Path, straight_hz: float
) -> None:
    bar = Bar()
    # the third axis of the system is x of the bar, the first its z
    lines = ["sol 103", "cend", "begin bulk"]
    lines += ["cord2c,3,,0.,0.,0.,1.,0.,0.", ",0.,0.,1.", "grdset,,3"]
    for number, (x, y, z) in enumerate(bar.points, 1):
        # x, y, z of the system are z, -y and x of the bar
        radius, angle = np.hypot(z, y), np.degrees(np.arctan2(-y, z))
        lines.append(f"grid,{number},,{radius:.12g},{angle:.14g},{x:.12g} $ node")
    order = [*range(12), 16, 17, 18, 19, 12, 13, 14, 15]
    for number, cell in enumerate(bar.cells, 1):
        words = [f"{cell[place]:>8}" for place in order]
        lines += [f"chexa   {number:>8}{1:>8}" + "".join(words[:6])]
        lines += [f"{'':8}" + "".join(part) for part in (words[6:14], words[14:])]
    for number, height in ((1, 0.0), (2, LENGTH)):
        lines += [f"spc1,{number},123456," + ",".join(bar.at(height).split(", ")[:6]) + ",+"]
        lines += ["+," + ",".join(bar.at(height).split(", ")[6:])]
    lines += ["conm2,90,1,,3.", "pshell,2,1,1.", "cquad4,91,2,1,2,3,4", "rbe2,92,1,123456,2,3"]
    ends = ("set:spc_1", "set:spc_2")
    result = run(tmp_path, "bar.bdf", "\n".join(lines) + "\n", ends=ends)
    assert result.components["bar"].mass_kg == approx(MASS, rel=1e-9)
    assert first_hz(result) == approx(straight_hz, rel=1e-6)
    said = " ".join(result.warnings)
    assert "1 CONM2, 1 RBE2, 1 CQUAD4; taken are 5 solid cells" in said


def two_sections(bar: Bar, stiffness: str) -> str:
    return (
        flat(bar, "C3D20R")
        + "*ELSET, ELSET=LOW, GENERATE\n1, 2\n*ELSET, ELSET=UP\n3, 4, 5\n"
        + "*SOLID SECTION, ELSET=LOW, MATERIAL=Steel\n\n*SOLID SECTION, ELSET=UP, MATERIAL=Other\n\n"
        + STEEL
        + f"*MATERIAL, NAME=OTHER\n*ELASTIC\n{stiffness}, 0.3\n*DENSITY\n7.85D-9\n"
    )


def test_two_materials_of_a_file_are_named_and_taken_apart(tmp_path: Path) -> None:
    said = refuse(tmp_path, "bar.inp", two_sections(Bar(), "70000."))
    assert "2 materials: LOW (Steel, E = 210000" in said and "UP (Other, E = 70000" in said
    assert 'solid = "NAME"' in said and 'solid = "*"' in said
    for chosen, share in (("LOW", 0.4), ("up", 0.6), ("*", 1.0)):
        chosen, text = f', solid = "{chosen}"', two_sections(Bar(), "70000.")
        ends = ("z-", "set:cut" if share < 1.0 else "z+")
        result = run(tmp_path, "bar.inp", text, fidelity="rigid", more=chosen, ends=ends)
        assert result.components["bar"].mass_kg == approx(share * MASS, rel=1e-9)
    equal = run(tmp_path, "bar.inp", two_sections(Bar(), "2.1E5"), fidelity="rigid")
    assert equal.components["bar"].mass_kg == approx(MASS, rel=1e-9)
    assert "LOW" not in " ".join(equal.warnings)
    missing = refuse(tmp_path, "bar.inp", two_sections(Bar(), "1."), more=', solid = "MIDDLE"')
    assert "no set of solid cells called 'MIDDLE'; available: BAR, LOW, UP" in missing


def test_layers_of_several_materials_are_refused_by_name(tmp_path: Path) -> None:
    layers = "LOW, COMPOSITE\n1., 3, Steel\n1., 3, {}\n"
    text = two_sections(Bar(), "70000.").replace("LOW, MATERIAL=Steel\n\n", layers)
    said = refuse(tmp_path, "bar.inp", text.format("Other"))
    assert "*SOLID SECTION, ELSET=LOW is a composite section: materials Steel, Other" in said
    assert "give the section one with MATERIAL=" in said
    # layers of one material are a section like any other
    said = refuse(tmp_path, "bar.inp", text.format("STEEL"))
    assert "2 materials: LOW (STEEL, E = 210000" in said


def test_a_rotation_axis_of_two_equal_points_is_named(tmp_path: Path) -> None:
    text = cae(Bar(), "C3D20", moves=" 0., 0., 5.\n 1., 2., 3., 1., 2., 3., 90.\n")
    said = refuse(tmp_path, "bar.inp", text)
    place = text[: text.index("*Instance, ")].count("\n") + 1
    assert f"bar.inp:{place}: *INSTANCE, NAME=Bar-1: both points of its rotation axis" in said
    assert "(1, 2, 3)" in said and '"1., 2., 3., 1., 2., 3., 90."' in said


def instances(*, apart: bool, tie: bool) -> str:
    """Two instances of one part, the second one upon the first."""
    bar = Bar(cells=1)
    height = LENGTH / CELLS
    part = f"*Part, name=P\n*Node\n{bar.nodes()}*Element, type=C3D20\n{bar.elements()}*End Part\n"
    face = "*Elset, elset=_{0}, internal, instance={1}\n1,\n*Surface, type=ELEMENT, name={0}\n_{0}, {2}\n"
    faces = face.format("up", "A", "S2") + face.format("on", "B", "S1")
    return (
        part + "*Assembly, name=All\n*Instance, name=A, part=P\n*End Instance\n"
        f"*Instance, name=B, part=P\n{5.0 if apart else 0.0}, 0., {height}\n*End Instance\n{faces}"
        + ("*Tie, name=T, adjust=yes\non, up\n" if tie else "")
        + "*End Assembly\n"
    )


def test_instances_are_one_part_where_they_are_tied_node_to_node(tmp_path: Path) -> None:
    ends = ("z-", "z+")
    both = run(tmp_path, "a.inp", instances(apart=False, tie=True), fidelity="rigid", ends=ends)
    assert both.components["bar"].mass_kg == approx(2 * MASS / CELLS, rel=1e-9)
    for apart, tie in ((True, True), (False, False)):
        said = refuse(tmp_path, "a.inp", instances(apart=apart, tie=tie))
        assert "falls into 2 parts that share no node" in said and '"A", "B"' in said
    text = instances(apart=True, tie=True)
    one = run(tmp_path, "a.inp", text, fidelity="rigid", more=', solid = "B"', ends=ends)
    assert one.components["bar"].mass_kg == approx(MASS / CELLS, rel=1e-9)


@pytest.mark.parametrize(
    ("added", "words"),
    [
        ("6, 5, 6, 7, 8, 1, 2, 3, 4\n", "holds 1 of its 6 solid cells twice"),
        ("6, 5, 6, 7, 8, 91, 92, 93, 94\n", "faces belong to more than two cells"),
        ("6, 107, 2, 3, 4, 108, 6, 7, 8\n", "a pair of cells overlaps (elements 2 and 6)"),
        ("6, 91, 92, 93, 94, 95, 96, 97, 98\n", "falls into 2 parts that share no node"),
        ("6, 3, 101, 102, 103, 7, 104, 105, 106\n", "meet in single nodes or edges only"),
    ],
)
def test_cells_that_are_no_one_solid_are_dropped_or_named(
    tmp_path: Path, added: str, words: str
) -> None:
    bar = Bar()
    eight = [cell[:8] for cell in bar.cells]
    lines = [f"{n}, {', '.join(map(str, cell))}\n" for n, cell in enumerate(eight, 1)]
    # by the numbers of the corners of the second cell
    names = dict(zip("12345678", map(str, eight[1]), strict=True))
    row = ", ".join(names.get(word, word) for word in added.strip().split(", ")[1:])
    new = [(2.0, 2.0), (18.0, 2.0), (18.0, 18.0), (2.0, 18.0)]
    nodes = [f"{91 + n}, {x}, {y}, 60.0\n" for n, (x, y) in enumerate(new)]
    nodes += [f"{95 + n}, {x}, {y}, 300.0\n" for n, (x, y) in enumerate(new)]
    nodes += ["107, 4.0, 4.0, 40.0\n", "108, 4.0, 4.0, 80.0\n"]
    far = [(40.0, 20.0), (40.0, 40.0), (20.0, 40.0)]
    for height, first in ((40.0, 101), (80.0, 104)):
        nodes += [f"{first + n}, {x}, {y}, {height}\n" for n, (x, y) in enumerate(far)]
    text = f"*NODE\n{bar.nodes()}{''.join(nodes)}*ELEMENT, TYPE=C3D8\n{''.join(lines)}6, {row}\n"
    if "twice" in words:
        result = run(tmp_path, "bar.inp", text, fidelity="rigid", ends=("z-", "z+"))
        assert result.components["bar"].mass_kg == approx(MASS, rel=1e-9)
        assert words in " ".join(result.warnings)
        return
    said = refuse(tmp_path, "bar.inp", text)
    assert words in said


TETS = [(0, 1, 3, 4), (1, 2, 3, 6), (4, 6, 5, 1), (4, 7, 6, 3), (1, 3, 4, 6)]
CUBE = [tuple(WIDTH * value for value in corner) for corner in CORNERS]


# what meshio needs to know of a format: words of its writer, and whether parts are blocks or tags
FORMATS: dict[str, dict[str, Any]] = {
    ".msh": {"file_format": "gmsh22", "binary": False},
    ".xdmf": {"data_format": "XML"},
    ".exo": {},
    ".med": {},
}
PARTS = {".exo": [range(3), range(3, 7)]}
HALVES = [np.array([1, 1, 1, 2, 2, 2, 2])]
TAGS = {
    ".msh": {"gmsh:physical": HALVES, "gmsh:geometrical": HALVES},
    ".med": {"cell_tags": [np.array([-1, -1, -1, -2, -2, -1, -2])]},
}


def write_tets(path: Path, cells: Sequence[Sequence[int]]) -> None:
    blocks = [
        ("tetra", np.array([cells[number] for number in part]))
        for part in PARTS.get(path.suffix, [range(len(cells))])
    ]
    mesh = meshio.Mesh(np.array(CUBE), blocks, cell_data=TAGS.get(path.suffix))
    mesh.cell_tags = {-1: ["low"], -2: ["up"]}
    mesh.write(path, **FORMATS[path.suffix])


@pytest.mark.parametrize("suffix", FORMATS)
def test_repeated_cells_are_counted_once_in_every_format(tmp_path: Path, suffix: str) -> None:
    cells = [*TETS, TETS[0], TETS[3]]
    path = tmp_path / f"cube{suffix}"
    write_tets(path, cells)
    scene = tmp_path / "cube.toml"
    result = hs.run(write_scene(scene, path.name, fidelity="rigid", ends=("z-", "z+")))
    assert result.components["bar"].mass_kg == approx(RHO * (WIDTH * 1e-3) ** 3, rel=1e-9)
    said = " ".join(result.warnings)
    assert "holds 2 of its 7 solid cells twice" in said
    # groups and blocks may be of different materials, which these formats do not tell
    groups = {".exo": "block_0 (3 cells), block_1 (4 cells)", ".med": "low (4 cells), up (3 cells)"}
    assert groups.get(suffix, "") in said


def test_inverted_curved_tets_of_a_file_are_straightened_and_counted(tmp_path: Path) -> None:
    points, cells = [*CUBE], []
    rows: dict[frozenset[int], int] = {}
    for tet in TETS:
        own = list(tet)
        for a, b in [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]:
            key = frozenset((tet[a], tet[b]))
            if key not in rows:
                rows[key] = len(points)
                points.append(tuple(np.mean([points[tet[a]], points[tet[b]]], axis=0)))
            own.append(rows[key])
        cells.append(own)
    bent = np.array(points)
    bent[rows[frozenset((0, 1))]] += [0.0, 0.6 * WIDTH, 0.6 * WIDTH]
    meshio.Mesh(bent, [("tetra10", np.array(cells))]).write(tmp_path / "cube.med")
    scene = tmp_path / "cube.toml"
    result = hs.run(write_scene(scene, "cube.med", fidelity="elastic", ends=("z+", "x+")))
    assert "of the 5 curved tets of cube.med were inverted" in " ".join(result.warnings)
    quality = result.components["bar"].quality
    assert quality is not None and quality.repaired == 1


def test_the_face_of_one_hex_is_an_area(tmp_path: Path) -> None:
    result = run(tmp_path, "bar.inp", flat(Bar(), "C3D20"))
    assert not any("singular" in warning for warning in result.warnings)
    (tmp_path / "part.inp").write_text(flat(Bar(), "C3D20") + "*NSET, NSET=SIDE\n1, 2, 5, 6\n")
    ends = ("set:SIDE", "z+")
    scene = write_scene(tmp_path / "part.toml", "part.inp", fidelity="elastic", ends=ends)
    with pytest.raises(hs.HeadstockError, match="single facet of a larger face"):
        hs.run(scene)
