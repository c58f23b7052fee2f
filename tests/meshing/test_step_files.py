import re
from pathlib import Path

import gmsh
import numpy as np
import pytest

from built_parts import built_part
from cases import cases
from common import approx
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.components.finishing import patch_moments
from headstock.meshing.components.meshing import (
    _estimate_cells,
    describe_component,
    mesh_component,
)
from headstock.meshing.components.survey import survey_step
from headstock.meshing.elements.quality import scaled_jacobians
from headstock.meshing.errors import MeshError
from headstock.meshing.length_units import doubt_size, read_length_unit
from meshed_parts import make_part, mesh_part

pytestmark = pytest.mark.process

HOLE_AREA = 3 * np.pi * 6.0**2
BLOCK_VOLUME = (60 * 40 - HOLE_AREA) * 20 * 1e-9


def add_drilled_block() -> None:
    """A block of 60 x 40 x 20 with holes that leave walls of 0.3: coarse curved elements invert
    there.
    """
    occ = gmsh.model.occ
    block = occ.addBox(0, 0, 0, 60, 40, 20)
    holes = [(3, occ.addCylinder(15, y, -1, 0, 0, 22, 6)) for y in (6.3, 20, 33.7)]
    occ.cut([(3, block)], holes)


@pytest.fixture
def drilled(tmp_path: Path) -> Path:
    with built_part(tmp_path / "drilled.step"):
        add_drilled_block()
    return tmp_path / "drilled.step"


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    with built_part(tmp_path / "pair.step"):
        left = gmsh.model.occ.addBox(0, 0, 0, 10, 10, 10)
        right = gmsh.model.occ.addBox(50, 0, 0, 20, 10, 10)
        gmsh.model.occ.synchronize()
        gmsh.model.setEntityName(3, left, "left")
        gmsh.model.setEntityName(3, right, "right")
    return tmp_path / "pair.step"


def test_inverted_curved_elements_are_repaired_and_counted(drilled: Path) -> None:
    mesh = mesh_part(StepFile(drilled), {"foot": Patch("z-"), "bore": Patch("face:7")}, size=0.01)
    assert mesh.quality.repaired > 5
    assert mesh.quality.minimum_scaled_jacobian >= 1e-3
    assert not mesh.straight
    assert mesh.quality.volume == approx(BLOCK_VOLUME, rel=1e-3)
    areas, centroids = patch_moments(mesh.points, mesh.patches)
    assert areas["foot"] == approx((60 * 40 - HOLE_AREA) * 1e-6, rel=1e-3)
    assert areas["bore"] == approx(mesh.quality.cad_areas["bore"], rel=1e-3)
    assert centroids["foot"][2] == approx(0.0, abs=1e-9)


def test_every_inverted_element_is_found_as_by_gmsh_itself(kernel: None) -> None:
    add_drilled_block()
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", 6.0)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    elements, nodes = gmsh.model.mesh.getElementsByType(11)
    row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    quality = scaled_jacobians(coordinates.reshape(-1, 3), row[nodes].reshape(-1, 10), "tet10")
    theirs = np.array(gmsh.model.mesh.getElementQualities(elements, "minDetJac"))
    assert (theirs <= 0.0).sum() > 5
    assert np.array_equal(quality <= 0.0, theirs <= 0.0)


def test_step_file_is_described_in_metres(drilled: Path) -> None:
    found = describe_component(make_part(StepFile(drilled), {"foot": Patch("z-")}))
    assert found.volume == approx(BLOCK_VOLUME, rel=1e-8)
    assert found.patch_areas["foot"] == approx((60 * 40 - HOLE_AREA) * 1e-6, rel=1e-8)
    assert found.center[1] == approx(0.02, rel=1e-9)


def test_file_in_inches_is_read_in_inches(drilled: Path, tmp_path: Path) -> None:
    text = drilled.read_text()
    assert text.count("SI_UNIT(.MILLI.,.METRE.)") == 1
    number = text[: text.index("SI_UNIT(.MILLI.,.METRE.)")].rsplit("#", 1)[1].split("=")[0].strip()
    start = text.rindex(f"#{number}", 0, text.index("SI_UNIT(.MILLI.,.METRE.)"))
    end = text.index(";", start) + 1
    inch = (
        f"#{number} = ( CONVERSION_BASED_UNIT('INCH',#90001) LENGTH_UNIT() NAMED_UNIT(#90002) );\n"
        "#90001 = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#90003);\n"
        "#90002 = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\n"
        "#90003 = ( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) );"
    )
    (tmp_path / "inch.step").write_text(text[:start] + inch + text[end:])
    found = describe_component(make_part(StepFile(tmp_path / "inch.step")))
    assert found.volume == approx(BLOCK_VOLUME * 25.4**3, rel=1e-6)


def test_solid_is_chosen_by_number(pair: Path) -> None:
    assert describe_component(make_part(StepFile(pair, 1))).volume == approx(1e-6, rel=1e-9)
    assert describe_component(make_part(StepFile(pair, 2))).volume == approx(2e-6, rel=1e-9)


def test_solid_is_chosen_by_name(pair: Path) -> None:
    with pytest.raises(MeshError) as caught:
        describe_component(make_part(StepFile(pair)))
    assert "2 solids" in str(caught.value)
    assert "1 to 2, without names" in str(caught.value)
    # the translator numbers the products that nobody named
    pair.write_text(
        re.sub(r"'Open CASCADE STEP translator [\d.]+ [\d.]*2'", "'right half'", pair.read_text())
    )
    with pytest.raises(MeshError, match="2: right half"):
        describe_component(make_part(StepFile(pair)))
    assert describe_component(make_part(StepFile(pair, "right half"))).volume == approx(
        2e-6, rel=1e-9
    )
    with pytest.raises(MeshError, match=r"0 .*'middle'"):
        describe_component(make_part(StepFile(pair, "middle")))
    with pytest.raises(MeshError, match="number 3"):
        describe_component(make_part(StepFile(pair, 3)))


def test_imprints_work_on_step_faces(drilled: Path) -> None:
    disk = Patch("x+", "disk", (0.06, 0.02, 0.01), (0.008,))
    mesh = mesh_part(StepFile(drilled), {"pad": disk, "end": Patch("x+")}, size=0.01)
    areas, centroids = patch_moments(mesh.points, mesh.patches)
    assert areas["pad"] == approx(np.pi * 0.004**2, rel=1e-3)
    assert np.allclose(centroids["pad"], [0.06, 0.02, 0.01], atol=1e-6)
    assert areas["end"] == approx(0.04 * 0.02, rel=1e-9)


def test_estimate_for_a_step_file_is_right_within_a_factor_of_two(drilled: Path) -> None:
    component = make_part(StepFile(drilled), {"foot": Patch("z-")}, size=0.004)
    assert 0.5 < _estimate_cells(component) / len(mesh_component(component).cells) < 2.0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no file"),
        (b"solid x", "not a STEP file"),
        (b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n", ""),
    ],
)
def test_files_that_are_no_solid_are_refused(
    tmp_path: Path, content: bytes | None, words: str
) -> None:
    path = tmp_path / "part.step"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MeshError, match=words):
        describe_component(make_part(StepFile(path)))


def test_file_of_surfaces_only_is_refused(tmp_path: Path) -> None:
    with built_part(tmp_path / "sheet.step"):
        gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    with pytest.raises(MeshError, match=r"sheet.step.*no solid"):
        describe_component(make_part(StepFile(tmp_path / "sheet.step")))


SUPPORT = Path(__file__).parent.parent / "data" / "support.step"


def test_a_part_from_solidworks_is_meshed_with_its_inverted_elements_repaired_and_counted() -> None:
    bounding_box = 0.0685  # the mesh of a 25th of it has inverted elements as gmsh leaves it
    component = make_part(
        StepFile(SUPPORT), {"foot": Patch("z-"), "top": Patch("z+")}, size=bounding_box / 25
    )
    mesh = mesh_component(component)
    assert mesh.quality.repaired > 0
    assert mesh.quality.minimum_scaled_jacobian >= 1e-3
    assert mesh.quality.volume == approx(1.741e-5, rel=1e-3)
    assert mesh.quality.volume == approx(mesh.quality.cad_volume, rel=1e-3)
    areas, _ = patch_moments(mesh.points, mesh.patches)
    assert areas == approx(mesh.quality.cad_areas, rel=1e-3)


def test_a_survey_lists_every_face_with_area_and_outward_normal(drilled: Path) -> None:
    survey = survey_step(StepFile(drilled))
    assert survey.size == approx((0.06, 0.04, 0.02), rel=1e-6)
    assert survey.unit == "mm"
    planes = [face for face in survey.faces if face.kind == "plane"]
    assert len(planes) == 6
    for face in planes:
        outward = np.array(face.center) - [0.03, 0.02, 0.01]
        assert outward @ np.array(face.normal) == approx(np.abs(outward).max(), rel=1e-6)
    bores = [face for face in survey.faces if face.kind == "cylinder"]
    assert [face.radius for face in bores] == approx([0.006] * 3, rel=1e-6)
    assert all(face.hollow for face in bores)
    assert sorted(face.axis_point[1] for face in bores) == approx([0.0063, 0.02, 0.0337], rel=1e-6)
    assert sum(face.area for face in bores) == approx(3 * 2 * np.pi * 0.006 * 0.02, rel=1e-6)


def test_triangles_of_a_survey_close_the_part(drilled: Path) -> None:
    survey = survey_step(StepFile(drilled))
    a, b, c = (survey.points[survey.triangles[:, i]] for i in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
    # what an inscribed 12-gon leaves of a hole's circle
    polygon = 1.0 - 12 / (2 * np.pi) * np.sin(2 * np.pi / 12)
    assert BLOCK_VOLUME < volume < BLOCK_VOLUME + polygon * HOLE_AREA * 20e-9
    assert set(survey.owners) == {face.number for face in survey.faces}


@cases
def test_the_unit_of_a_header_is_named(tmp_path: Path, unit: str, name: str) -> None:
    path = tmp_path / "part.step"
    path.write_text(f"ISO-10303-21;\n#1 = {unit};\n")
    assert read_length_unit(path) == name


@pytest.mark.parametrize(
    ("diameter", "likely"),
    [(12e6, "12 m if the numbers are in µm"), (1e-5, "m if the numbers are in m")],
)
def test_a_part_of_kilometres_or_nanometres_is_refused_as_a_slip_of_units(
    tmp_path: Path, diameter: float, likely: str
) -> None:
    path = tmp_path / "sphere.step"
    with built_part(path):
        gmsh.model.occ.addSphere(0, 0, 0, diameter / 2)
    with pytest.raises(MeshError, match="slip of units") as error:
        survey_step(StepFile(path))
    assert likely in str(error.value)


def test_a_part_in_inches_that_reads_as_5_m_is_doubted_with_what_it_would_be_in_mm(
    tmp_path: Path,
) -> None:
    path = tmp_path / "part.step"
    path.write_text(
        "ISO-10303-21;\n#1 = ( CONVERSION_BASED_UNIT('INCH',#2) LENGTH_UNIT() NAMED_UNIT(#3) );\n"
    )
    doubt = doubt_size(path, 5.08)
    assert doubt is not None
    assert "5.08 m" in doubt
    assert "inch" in doubt
    assert "0.2 m if the numbers are in mm" in doubt
    assert doubt_size(path, 0.5) is None


@pytest.fixture
def stepped(tmp_path: Path) -> Path:
    """A block of 60 x 40 x 20 on whose top a tool has left a step of 54 µm: five faces, four of
    them as narrow.
    """
    with built_part(tmp_path / "stepped.step"):
        occ = gmsh.model.occ
        block, pocket = occ.addBox(0, 0, 0, 60, 40, 20), occ.addBox(20, 10, 19.946, 15, 10, 1)
        occ.cut([(3, block)], [(3, pocket)])
    return tmp_path / "stepped.step"


def test_a_step_of_54_um_is_left_out_of_the_mesh_and_its_faces_are_named(stepped: Path) -> None:
    left_out = mesh_part(StepFile(stepped), {"foot": Patch("z-")}, size=0.03, details=0.0)
    (remark,) = left_out.quality.remarks
    assert "5 of 11 faces (face:" in remark and "left out" in remark and "mesh.smallest" in remark
    assert left_out.quality.volume == approx(60 * 40 * 20e-9, rel=1e-9)
    assert left_out.quality.minimum_scaled_jacobian > 0.1
    kept = mesh_part(
        StepFile(stepped), {"foot": Patch("z-")}, size=0.03, smallest=1e-3, details=0.0
    )
    assert not any("left out" in remark for remark in kept.quality.remarks)
    assert kept.quality.volume == approx((60 * 40 * 20 - 15 * 10 * 0.054) * 1e-9, rel=1e-9)


def test_a_face_keeps_its_number_when_a_narrow_feature_is_left_out(stepped: Path) -> None:
    faces = survey_step(StepFile(stepped)).faces
    walls = [face for face in faces if face.area > 700e-6]  # the whole top and those around it
    patches = {f"side{face.number}": Patch(f"face:{face.number}") for face in walls}
    mesh = mesh_part(StepFile(stepped), patches, size=0.03, details=0.0)
    assert any("left out" in remark for remark in mesh.quality.remarks)
    _, centroids = patch_moments(mesh.points, mesh.patches)
    assert len(walls) >= 5
    for face in walls:
        assert centroids[f"side{face.number}"] == approx(face.center, abs=1e-3)


def test_a_narrow_feature_that_an_interface_names_stays(stepped: Path) -> None:
    floor = next(
        face
        for face in survey_step(StepFile(stepped)).faces
        if face.area == approx(15 * 10e-6, rel=1e-6)
    )
    mesh = mesh_part(StepFile(stepped), {"floor": Patch(f"face:{floor.number}")}, size=0.03)
    assert mesh.quality.cad_areas["floor"] == approx(15 * 10e-6, rel=1e-9)


@pytest.fixture
def perforated(tmp_path: Path) -> Path:
    """A plate of 300 x 200 x 10 with 96 holes of 4."""
    with built_part(tmp_path / "perforated.step"):
        occ = gmsh.model.occ
        corners = [occ.addPoint(x, y, 0) for x, y in ((0, 0), (300, 0), (300, 200), (0, 200))]
        sides = [occ.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        holes = [
            occ.addCurveLoop([occ.addCircle(20 + 23.6 * i, 18 + 23.4 * j, 0, 2)])
            for i in range(12)
            for j in range(8)
        ]
        surface = occ.addPlaneSurface([occ.addCurveLoop(sides), *holes])
        occ.extrude([(2, surface)], 0, 0, 10)
    return tmp_path / "perforated.step"


def test_a_budget_that_is_exceeded_names_faces_and_the_key_that_helps(perforated: Path) -> None:
    with pytest.raises(MeshError, match=r"more than the budget.*mesh\.smallest"):
        mesh_part(StepFile(perforated), {"foot": Patch("x-")}, size=0.0004)


OTHER = "'../secret.step'"
DOCUMENT = f"#9000 = DOCUMENT_FILE({OTHER},{OTHER},$,#9001,'',$);\n#9001 = DOCUMENT_TYPE('');\n"


@cases
def test_a_part_defined_with_documents_is_refused_before_the_kernel_opens_them(
    drilled: Path, keyword: str
) -> None:
    product = "PRODUCT_DEFINITION('design','',#6,#9)"
    text = drilled.read_text()
    assert product in text
    text = text.replace(product, f"{keyword}('design','',#6,#9,(#9000))")
    drilled.write_text(text.replace("ENDSEC;\nEND-ISO", DOCUMENT + "ENDSEC;\nEND-ISO"))
    with pytest.raises(
        MeshError,
        match=rf"drilled\.step:\d+ refers to other files \({keyword.strip().upper()}\), and these are never",
    ):
        describe_component(make_part(StepFile(drilled)))


def test_a_document_beside_a_part_is_refused_only_where_it_is_a_file(drilled: Path) -> None:
    text = drilled.read_text()
    reference = "#9002 = APPLIED_DOCUMENT_REFERENCE(#9000,'',(#5));\n"
    drilled.write_text(text.replace("ENDSEC;\nEND-ISO", DOCUMENT + reference + "ENDSEC;\nEND-ISO"))
    with pytest.raises(MeshError, match=r"other files.*APPLIED_DOCUMENT_REFERENCE"):
        describe_component(make_part(StepFile(drilled)))
    paper = "#9000 = DOCUMENT('drawing','PDWAD of DOCUMENT_FILE',$,#9001);\n#9001 = DOCUMENT_TYPE('');\n"
    drilled.write_text(text.replace("ENDSEC;\nEND-ISO", paper + reference + "ENDSEC;\nEND-ISO"))
    assert describe_component(make_part(StepFile(drilled))).volume == approx(BLOCK_VOLUME, rel=1e-9)
