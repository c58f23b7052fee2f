"""Meshes in XDMF, MED, Exodus, Nastran and gmsh: written and read back, and read as other programs
write them.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import h5py
import netCDF4
import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOExodus import vtkExodusIIReader

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.solids import Box, MeshFile, Tube
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.components.finishing import patch_moments
from headstock.meshing.elements.quality import integrate_mesh
from headstock.meshing.errors import MeshError
from headstock.meshing.files.writing import encode_mesh
from headstock.meshing.formats import MESH_FORMATS
from headstock.meshing.process.strangers import files_beside
from meshed_parts import mesh_part

pytestmark = pytest.mark.process

Form = Literal["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF4"]
SIZE = (0.03, 0.02, 0.05)
PATCHES = {
    "bottom": Patch("z-"),
    "top": Patch("z+"),
    "support:again": Patch("z+"),
    "side": Patch("x+"),
}
WRITTEN = [one.suffixes[0] for one in MESH_FORMATS if one.written]
# corners of a unit cube, and cells as the MED manual draws them: counted from the other side
CUBE = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    dtype=float,
)
HEX_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
HEX_EDGES += [(0, 4), (1, 5), (2, 6), (3, 7)]
MED_CORNERS = [0, 3, 2, 1, 4, 7, 6, 5]


def read_file(path: Path) -> MeshFile:
    return MeshFile(path, 1.0, tuple(path.parent / name for name in files_beside(path)))


def write_file(mesh: ComponentMesh, path: Path) -> MeshFile:
    for name, content in encode_mesh(mesh, path).items():
        (path.parent / name).write_bytes(content)
    return read_file(path)


def patch_places(mesh: ComponentMesh) -> dict[str, set[tuple[float, ...]]]:
    return {
        name: {tuple(np.round(place, 9) + 0.0) for place in mesh.points[np.unique(facets)]}
        for name, facets in mesh.patches.items()
    }


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex27", "curved"])
def test_meshes_come_back_node_for_node_with_their_patches(
    tmp_path: Path, kind: str, suffix: str
) -> None:
    if kind == "curved":
        solid: Box | Tube = Tube(0.04, 0.02, 0.03)
        patches, settings = {"mantle": Patch("outer"), "top": Patch("z+")}, {"size": 0.012}
        mesh = mesh_part(solid, patches, **settings)
    else:
        patches = PATCHES
        order = 1 if kind in ("tet4", "hex8") else 2
        mesh = mesh_part(Box(SIZE), patches, size=0.02, order=order, cells=kind[:3])
    sets = {name: Patch(f"set:{name}") for name in patches}
    solid_file = write_file(mesh, tmp_path / f"part{suffix}")
    back = mesh_part(solid_file, sets)
    assert (back.kind, len(back.points)) == (mesh.kind, len(mesh.points))
    rounding = 1e-14  # of text in columns; other formats hold every bit
    nodes = np.abs(
        back.points[np.lexsort(np.round(back.points, 9).T)]
        - mesh.points[np.lexsort(np.round(mesh.points, 9).T)]
    )
    assert nodes.max() <= (rounding if suffix in (".bdf", ".msh") or kind == "hex27" else 0.0)
    # cells keep their place and the place of their nodes
    moved = back.points[back.cells] - mesh.points[mesh.cells]
    assert np.abs(moved).max() <= 1e-14
    found, given = (integrate_mesh(one.points, one.cells, one.kind) for one in (back, mesh))
    assert found.volume == approx(given.volume, rel=1e-11)
    assert np.allclose(found.inertia, given.inertia, rtol=1e-10, atol=1e-20)
    assert patch_places(back) == patch_places(mesh)


def test_exodus_files_are_what_vtk_takes_them_for(tmp_path: Path) -> None:
    mesh = mesh_part(Box(SIZE), PATCHES, size=0.02, cells="hex")
    write_file(mesh, tmp_path / "part.exo")
    reader = vtkExodusIIReader()
    reader.SetFileName(str(tmp_path / "part.exo"))
    reader.UpdateInformation()
    count = reader.GetNumberOfObjects(reader.SIDE_SET)
    sizes = {
        reader.GetObjectName(reader.SIDE_SET, i): reader.GetNumberOfEntriesInObject(
            reader.SIDE_SET, i
        )
        for i in range(count)
    }
    assert sizes == {name: len(facets) for name, facets in mesh.patches.items()}
    reader.Update()
    grid = reader.GetOutput().GetBlock(0).GetBlock(0)
    assert grid.GetNumberOfCells() == len(mesh.cells)
    cell = grid.GetCell(0)
    places = vtk_to_numpy(grid.GetPoints().GetData())
    nodes = places[[cell.GetPointId(i) for i in range(27)]]
    # where VTK expects the 27 nodes of a brick
    expected = np.array(cell.GetParametricCoords()).reshape(-1, 3)
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    assert np.allclose((nodes - low) / (high - low), expected, atol=1e-6)


def write_med(
    path: Path,
    points: FloatArray,
    cells: Mapping[str, tuple[IntArray, IntArray]],
    families: Mapping[int, list[str]],
    node_tags: IntArray,
) -> None:
    """As libmed writes: families without a group have no GRO, and there is a field."""
    with h5py.File(path, "w") as file:
        mesh = file.create_group("ENS_MAA/Mesh_1")
        mesh.attrs["ESP"] = mesh.attrs["DIM"] = 3
        step = mesh.create_group("-0000000000000000001-0000000000000000001")
        step["NOE/COO"] = points.T.ravel()
        step["NOE/COO"].attrs["NBR"] = len(points)
        step["NOE/FAM"] = node_tags
        for code, (nodes, tags) in cells.items():
            step[f"MAI/{code}/NOD"] = nodes.T.ravel() + 1
            step[f"MAI/{code}/NOD"].attrs["NBR"] = len(nodes)
            step[f"MAI/{code}/FAM"] = tags
        file.create_group("FAS/Mesh_1/FAMILLE_ZERO").attrs["NUM"] = 0
        for number, groups in families.items():
            kind = "NOEUD" if number > 0 else "ELEME"
            family = file.create_group(f"FAS/Mesh_1/{kind}/FAM_{number}")
            family.attrs["NUM"] = number
            if groups:
                names = [list(name.encode().ljust(80, b"\0")) for name in groups]
                family["GRO/NOM"] = np.array(names, dtype=np.int8)
        file.create_group("CHA/resu____DEPL/step").attrs["NDT"] = 1


def test_groups_of_salome_become_sets(tmp_path: Path) -> None:
    points = np.vstack([CUBE, [CUBE[list(edge)].mean(axis=0) for edge in HEX_EDGES]])
    # MED's own numbering: corners from the other side, then its edges in the order of VTK
    middle = {frozenset(edge): 8 + i for i, edge in enumerate(HEX_EDGES)}
    edges = [middle[frozenset((MED_CORNERS[a], MED_CORNERS[b]))] for a, b in HEX_EDGES]
    lid = [4, 5, 6, 7, *(middle[frozenset(edge)] for edge in [(4, 5), (5, 6), (6, 7), (7, 4)])]
    foot = [0, 3, 2, 1, *(middle[frozenset(edge)] for edge in [(0, 3), (3, 2), (2, 1), (1, 0)])]
    tags = np.zeros(20, dtype=int)
    tags[[0, 1, 2, 3]] = 4
    write_med(
        tmp_path / "cube.med",
        points,
        {
            "H20": (np.array([[*MED_CORNERS, *edges]]), np.array([-9])),
            "QU8": (np.array([lid, foot]), np.array([-6, -7])),
            "SE3": (np.array([[0, 1, 8]]), np.array([0])),
        },
        {-6: ["Lid", "both"], -7: ["both"], -8: [], -9: ["volume"], 4: ["Corners below"]},
        tags,
    )
    sets = {"a": "set:Lid", "b": "set:both", "c": "set:Corners below", "z-": "z-", "z+": "z+"}
    patches = {name: Patch(face) for name, face in sets.items()}
    mesh = mesh_part(read_file(tmp_path / "cube.med"), patches)
    assert mesh.kind == "hex27" and mesh.quality.volume == approx(1.0, rel=1e-14)
    assert mesh.quality.minimum_scaled_jacobian == approx(1.0, rel=1e-12)
    assert np.array_equal(mesh.patches["a"], mesh.patches["z+"])
    assert np.array_equal(mesh.patches["c"], mesh.patches["z-"])
    assert len(mesh.patches["b"]) == 2
    with pytest.raises(MeshError, match=r"no set 'roof'.*set:Lid, set:both, set:Corners below"):
        mesh_part(read_file(tmp_path / "cube.med"), {"a": Patch("set:roof")})


def write_exodus(path: Path, form: Form) -> None:
    """Two hexes in two blocks with a shell between, as Cubit writes: no names, coordinates by axis."""
    points = np.vstack([CUBE, CUBE[4:] + np.array([0, 0, 1])])
    with netCDF4.Dataset(path, "w", format=form) as file:
        for name, size in {"num_nodes": 12, "four": 4, "eight": 8, "one": 1, "two": 2}.items():
            file.createDimension(name, size)
        for axis, values in zip("xyz", points.T, strict=True):
            file.createVariable(f"coord{axis}", "f8", ("num_nodes",))[:] = values
        blocks = [
            ("HEX8", "eight", [1, 2, 3, 4, 5, 6, 7, 8]),
            ("SHELL4", "four", [1, 2, 3, 4]),
            ("HEX", "eight", [5, 6, 7, 8, 9, 10, 11, 12]),
        ]
        for number, (kind, width, nodes) in enumerate(blocks, 1):
            block = file.createVariable(f"connect{number}", "i4", ("one", width))
            block.elem_type = kind
            block[:] = [nodes]
        # element 3, side 6 is the lid; element 2 is the shell at the foot
        for number, (elements, sides) in enumerate([([3], [6]), ([2, 1], [1, 4])], 1):
            length = "one" if len(elements) == 1 else "two"
            file.createVariable(f"elem_ss{number}", "i4", (length,))[:] = elements
            file.createVariable(f"side_ss{number}", "i4", (length,))[:] = sides
        file.createVariable("ss_prop1", "i4", ("two",))[:] = [100, 200]
        file.createVariable("node_ns1", "i4", ("four",))[:] = [9, 10, 11, 12]


@pytest.mark.parametrize("form", ["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF4"])
def test_side_sets_without_a_name_go_by_their_number(tmp_path: Path, form: Form) -> None:
    write_exodus(tmp_path / "two.e", form)
    sets = {"lid": "set:side_set_100", "more": "set:side_set_200", "nodes": "set:node_set_1"}
    sets |= {"z-": "z-", "z+": "z+", "x-": "x-"}
    patches = {name: Patch(face) for name, face in sets.items()}
    mesh = mesh_part(read_file(tmp_path / "two.e"), patches, allow_singular=True)
    assert mesh.quality.volume == approx(2.0, rel=1e-14)
    assert np.array_equal(mesh.patches["lid"], mesh.patches["z+"])
    assert np.array_equal(mesh.patches["nodes"], mesh.patches["z+"])
    assert len(mesh.patches["more"]) == 2
    _, centroids = patch_moments(mesh.points, mesh.patches)
    assert centroids["more"] == approx([0.25, 0.5, 0.25], rel=1e-12)


def test_properties_and_sets_of_nastran_decks_become_sets(tmp_path: Path) -> None:
    grids = "".join(f"GRID,{10 + i},,{x},{y},{z}\n" for i, (x, y, z) in enumerate(CUBE))
    (tmp_path / "cube.bdf").write_text(
        "SOL 101\nCEND\nBEGIN BULK\n"
        + grids
        + "CHEXA,1,3,10,11,12,13,14,15,\n+,16,17\n"
        + "CQUAD4,2,7,14,15,16,17\n"
        + "SPC1,5,123456,10,THRU,13\n"
        + '$HMSET         8        1 "clamped face"\n'
        + "SET1    8       10      11      12      \n+       13\n"
        + "SET1    9       10      99999\n"
        + '$HMSET         6        2 "elements"\nSET1,6,10,11,12,13\nENDDATA\n'
    )
    sets = {"lid": "set:property_7", "spc": "set:spc_5", "named": "set:clamped face"}
    patches = {name: Patch(face) for name, face in (sets | {"z-": "z-", "z+": "z+"}).items()}
    solid = read_file(tmp_path / "cube.bdf")
    mesh = mesh_part(solid, patches)
    assert np.array_equal(mesh.patches["lid"], mesh.patches["z+"])
    assert np.array_equal(mesh.patches["spc"], mesh.patches["z-"])
    assert np.array_equal(mesh.patches["named"], mesh.patches["z-"])
    # sets of elements, and lists with numbers of no node, are none
    with pytest.raises(MeshError, match=r"available: .*set:clamped face$"):
        mesh_part(solid, {"a": Patch("set:elements")})


XDMF = """<?xml version="1.0"?>
<Xdmf Version="3.0"><Domain><Grid Name="Grid">
<Geometry GeometryType="XYZ"><DataItem DataType="Float" Dimensions="8 3" Format="XML" Precision="8">
{points}</DataItem></Geometry>
<Topology TopologyType="Mixed" NumberOfElements="3">
<DataItem DataType="Int" Dimensions="{count}" Format="XML" Precision="8">{mixed}</DataItem></Topology>
<Attribute Name="facets" AttributeType="Scalar" Center="Cell">
<DataItem DataType="Int" Dimensions="3" Format="XML" Precision="4">1 20 30</DataItem></Attribute>
</Grid></Domain></Xdmf>
"""


def test_mixed_grids_with_integers_become_sets(tmp_path: Path) -> None:
    mixed = [9, *range(8), 5, 4, 5, 6, 7, 5, 0, 3, 2, 1]
    text = XDMF.format(
        points=" ".join(map(str, CUBE.ravel())), count=len(mixed), mixed=" ".join(map(str, mixed))
    )
    (tmp_path / "cube.xdmf").write_text(text)
    sets = {"lid": "set:facets_20", "foot": "set:facets_30", "z-": "z-", "z+": "z+"}
    patches = {name: Patch(face) for name, face in sets.items()}
    mesh = mesh_part(read_file(tmp_path / "cube.xdmf"), patches)
    assert np.array_equal(mesh.patches["lid"], mesh.patches["z+"])
    assert np.array_equal(mesh.patches["foot"], mesh.patches["z-"])


def test_integers_of_solid_cells_are_sets_that_may_be_of_several_materials(tmp_path: Path) -> None:
    # a cube of two wedges and, in a grid of values only, their tags as dolfinx writes them
    wedges = [8, 0, 1, 2, 4, 5, 6, 8, 0, 2, 3, 4, 6, 7]
    text = XDMF.format(
        points=" ".join(map(str, CUBE.ravel())), count=len(wedges), mixed=" ".join(map(str, wedges))
    )
    attribute = text[text.index("<Attribute") : text.index("</Grid>")]
    topology = text[text.index("<Topology") : text.index("</Topology>")] + "</Topology>"
    tags = attribute.replace('Dimensions="3"', 'Dimensions="2"').replace("1 20 30", "5 9")
    tags = tags.replace("facets", "part")
    text = text.replace(attribute, "").replace(
        "</Grid>", f'</Grid><Grid Name="part">{topology}{tags}</Grid>'
    )
    (tmp_path / "cube.xdmf").write_text(text)
    whole = mesh_part(read_file(tmp_path / "cube.xdmf"))
    assert whole.kind == "tet10" and whole.quality.volume == approx(1.0, rel=1e-14)
    assert "part_5 (1 cells), part_9 (1 cells)" in " ".join(whole.quality.remarks)
    solid = dataclasses.replace(read_file(tmp_path / "cube.xdmf"), solid="part_9")
    half = mesh_part(solid, {"cut": Patch("set:cut")})
    assert half.quality.volume == approx(0.5, rel=1e-14)
    areas, _ = patch_moments(half.points, half.patches)
    assert areas["cut"] == approx(2**0.5, rel=1e-12)


def test_curved_hexes_that_need_27_nodes_are_not_written_with_20(tmp_path: Path) -> None:
    mesh = mesh_part(Box(SIZE), PATCHES, size=0.02, cells="hex")
    points = mesh.points.copy()
    points[mesh.cells[0, 26]] += 1e-3
    moved = dataclasses.replace(mesh, points=points)
    for suffix in (".med", ".bdf"):
        with pytest.raises(MeshError, match=r"hexes of 20 nodes only.*write .xdmf or .exo"):
            encode_mesh(moved, tmp_path / f"part{suffix}")
    assert write_file(moved, tmp_path / "part.xdmf").beside
