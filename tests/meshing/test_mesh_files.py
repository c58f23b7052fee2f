"""Imported meshes, each written by an independent writer from the same box or tube and read
back.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest

from built_parts import gmsh_session
from cases import cases
from common import approx
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.solids import Box, MeshFile, Tube
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.components.finishing import patch_moments
from headstock.meshing.components.meshing import _estimate_cells, describe_component, mesh_component
from headstock.meshing.elements.quality import integrate_mesh
from headstock.meshing.errors import MeshError
from headstock.meshing.files.gmsh import read_gmsh
from meshed_parts import make_part, mesh_part

pytestmark = pytest.mark.process

SIZE = (0.03, 0.02, 0.05)
# gmsh position of the node that each format puts in this place, corners left out, written down from
# the formats' manuals: Abaqus C3D10 and Nastran CTETRA: 12 23 31 14 24 34; gmsh: 01 12 20 30 23 13
TET10_TAIL = [4, 5, 6, 7, 9, 8]
# Abaqus C3D20: 12 23 34 41 56 67 78 85 15 26 37 48; gmsh: 01 03 04 12 15 23 26 37 45 47 56 67
ABAQUS_HEX20_TAIL = [8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
# Nastran CHEXA: 12 23 34 41 15 26 37 48 56 67 78 85
NASTRAN_HEX20_TAIL = [8, 11, 13, 9, 10, 12, 14, 15, 16, 18, 19, 17]
# Abaqus C3D27: centre, then faces 1234, 5678, 1265, 2376, 3487, 4158; gmsh: 0321 0154 0473 1265
# 2376 4567 centre
ABAQUS_HEX27_TAIL = [*ABAQUS_HEX20_TAIL, 26, 20, 25, 21, 23, 24, 22]
ABAQUS_TYPES = {
    "tet4": "C3D4",
    "tet10": "C3D10",
    "hex8": "C3D8R",
    "hex20": "C3D20R",
    "hex27": "C3D27",
}
GMSH_TYPES = {"tet4": 4, "tet10": 11, "hex8": 5, "hex20": 17, "hex27": 12}
GMSH_FACETS = {"tet4": 2, "tet10": 9, "hex8": 3, "hex20": 16, "hex27": 10}


def numbered(rows: Any, first: int = 1) -> Iterator[tuple[int, Any]]:
    yield from enumerate(rows, first)


def abaqus_order(kind: str) -> list[int]:
    tails = {"tet10": TET10_TAIL, "hex20": ABAQUS_HEX20_TAIL, "hex27": ABAQUS_HEX27_TAIL}
    return [*range(4 if kind.startswith("tet") else 8), *tails.get(kind, [])]


def wrapped(numbers: Iterable[int], per_line: int = 16) -> str:
    words = [str(number) for number in numbers]
    return ",\n".join(", ".join(words[i : i + per_line]) for i in range(0, len(words), per_line))


def write_inp(path: Path, mesh: ComponentMesh, extra: str = "") -> None:
    lines = ["** comment", "*Heading", "box, in metres", "*NODE, NSET=Nall"]
    lines += [
        f"{i}, {', '.join(repr(float(x)) for x in point)}" for i, point in numbered(mesh.points, 11)
    ]
    lines.append(f"*Element, type={ABAQUS_TYPES[mesh.kind]}, elset=Eall")
    lines += [
        wrapped([i, *(cell[abaqus_order(mesh.kind)] + 11)]) for i, cell in numbered(mesh.cells, 101)
    ]
    path.write_text("\n".join(lines) + "\n" + extra + "*STEP\n*STATIC\n*END STEP\n")


def write_bdf(path: Path, mesh: ComponentMesh) -> None:
    tails = {"tet10": TET10_TAIL, "hex20": NASTRAN_HEX20_TAIL}
    order = [*range(4 if mesh.kind.startswith("tet") else 8), *tails.get(mesh.kind, [])]
    name = "CTETRA" if mesh.kind.startswith("tet") else "CHEXA"
    lines = ["SOL 101", "CEND", "BEGIN BULK", "MAT1,1,2.1+11,,0.3"]
    for i, (x, y, z) in numbered(mesh.points):
        lines += [
            f"{'GRID*':<8}{i:<16}{'':16}{x:<16.9e}{y:<16.9e}{'*':<8}".rstrip(),
            f"{'*':<8}{z:<16.9e}",
        ]
    for i, cell in numbered(mesh.cells):
        fields = [str(i), "1", *(str(node + 1) for node in cell[order])]
        rows = [fields[start : start + 8] for start in range(0, len(fields), 8)]
        for k, row in enumerate(rows):
            head, tail = name if k == 0 else "+", "+" if k + 1 < len(rows) else ""
            lines.append(
                (f"{head:<8}" + "".join(f"{field:<8}" for field in row)).ljust(72 if tail else 0)
                + tail
            )
    path.write_text("\n".join([*lines, "ENDDATA", ""]))


def write_msh(path: Path, mesh: ComponentMesh, sets: dict[str, IntArray]) -> None:
    names = ['3 99 "solid"', *(f'2 {i} "{name}"' for i, name in enumerate(sets, 1))]
    rows = [
        (GMSH_FACETS[mesh.kind], i, facet)
        for i, facets in enumerate(sets.values(), 1)
        for facet in facets
    ]
    rows += [(GMSH_TYPES[mesh.kind], 99, cell) for cell in mesh.cells]
    lines = [
        "$MeshFormat",
        "2.2 0 8",
        "$EndMeshFormat",
        "$PhysicalNames",
        str(len(names)),
        *names,
        "$EndPhysicalNames",
    ]
    lines += ["$Nodes", str(len(mesh.points))]
    lines += [
        f"{i} {' '.join(repr(float(x)) for x in point)}" for i, point in numbered(mesh.points)
    ]
    lines += ["$EndNodes", "$Elements", str(len(rows))]
    lines += [
        f"{i} {kind} 2 {tag} {tag} {' '.join(str(n + 1) for n in nodes)}"
        for i, (kind, tag, nodes) in enumerate(rows, 1)
    ]
    path.write_text("\n".join([*lines, "$EndElements", ""]))


@pytest.fixture
def box_mesh() -> Callable[[CellKind], ComponentMesh]:
    def make(kind: CellKind) -> ComponentMesh:
        order = 1 if kind in ("tet4", "hex8") else 2
        patches = {"bottom": Patch("z-"), "top": Patch("z+")}
        mesh = mesh_part(Box(SIZE), patches, size=0.02, order=order, cells=kind[:3])
        if kind != "hex20":
            return mesh
        used = np.unique(mesh.cells[:, :20])
        place = np.full(len(mesh.points), -1)
        place[used] = np.arange(len(used))
        patches_20 = {name: place[facets[:, :8]] for name, facets in mesh.patches.items()}
        return dataclasses.replace(
            mesh,
            points=mesh.points[used],
            cells=place[mesh.cells[:, :20]],
            kind="hex20",
            patches=patches_20,
        )

    return make


@pytest.fixture
def read_faces(tmp_path: Path) -> Callable[..., ComponentMesh]:
    """A mesh that is written as an Abaqus deck and read back with faces as interfaces."""

    def read(
        mesh: ComponentMesh, faces: dict[str, str | Patch], extra: str = "", **changes: Any
    ) -> ComponentMesh:
        write_inp(tmp_path / "box.inp", mesh, extra)
        patches = {
            name: Patch(face) if isinstance(face, str) else face for name, face in faces.items()
        }
        return mesh_part(MeshFile(tmp_path / "box.inp"), patches, **changes)

    return read


def write_any(path: Path, mesh: ComponentMesh) -> None:
    if path.suffix == ".msh":
        write_msh(path, mesh, mesh.patches)
    elif path.suffix == ".inp":
        write_inp(path, mesh)
    else:
        write_bdf(path, mesh)


EVERY_KIND = ["tet4", "tet10", "hex8", "hex20", "hex27"]
WRITABLE = [
    (kind, suffix)
    for suffix in (".msh", ".inp", ".bdf")
    for kind in EVERY_KIND
    if (kind, suffix) != ("hex27", ".bdf")
]


@pytest.mark.parametrize(("kind", "suffix"), WRITABLE)
def test_mesh_files_come_back_node_for_node(
    box_mesh: Callable[[CellKind], ComponentMesh], tmp_path: Path, kind: CellKind, suffix: str
) -> None:
    mesh = box_mesh(kind)
    write_any(tmp_path / f"box{suffix}", mesh)
    component = make_part(
        MeshFile(tmp_path / f"box{suffix}"), {"foot": Patch("z-"), "side": Patch("x+")}
    )
    back = mesh_component(component)
    # 20-node hexes are completed by face and body centres; the file's own nodes stay first
    assert back.kind == ("hex27" if kind == "hex20" else kind)
    assert np.allclose(
        back.points[back.cells[:, : mesh.cells.shape[1]]],
        mesh.points[mesh.cells],
        atol=1e-9 if suffix == ".bdf" else 0.0,
        rtol=0,
    )
    assert back.quality.minimum_scaled_jacobian == approx(
        mesh.quality.minimum_scaled_jacobian, rel=1e-6
    )
    volume, center, inertia = integrate_mesh(back.points, back.cells, back.kind)
    mass = np.prod(SIZE)
    assert volume == approx(mass, rel=1e-7)
    assert np.allclose(center, [0, 0, 0.025], atol=1e-9)
    assert np.allclose(
        inertia,
        mass / 12 * np.diag([0.02**2 + 0.05**2, 0.03**2 + 0.05**2, 0.03**2 + 0.02**2]),
        rtol=1e-6,
        atol=1e-13,
    )
    areas, _ = patch_moments(back.points, back.patches)
    assert areas["foot"] == approx(0.03 * 0.02, rel=1e-7)
    assert areas["side"] == approx(0.02 * 0.05, rel=1e-7)


@pytest.mark.parametrize("suffix", [".msh", ".inp", ".bdf"])
def test_curved_tets_keep_their_curvature(tmp_path: Path, suffix: str) -> None:
    mesh = mesh_part(Tube(0.04, 0.02, 0.03), {"o": Patch("outer")}, size=0.01)
    write_any(tmp_path / f"tube{suffix}", mesh)
    found = describe_component(make_part(MeshFile(tmp_path / f"tube{suffix}")))
    assert found.volume == approx(mesh.quality.volume, rel=1e-8)
    assert found.volume == approx(np.pi * (0.02**2 - 0.01**2) * 0.03, rel=1e-3)


def test_file_in_millimetres_is_scaled_by_its_unit(
    box_mesh: Callable[[CellKind], ComponentMesh], tmp_path: Path
) -> None:
    mesh = box_mesh("tet10")
    write_inp(tmp_path / "box.inp", dataclasses.replace(mesh, points=mesh.points * 1e3))
    component = make_part(MeshFile(tmp_path / "box.inp", unit=1e-3), {"pad": Patch("z-")})
    assert describe_component(component).volume == approx(np.prod(SIZE), rel=1e-12)
    assert describe_component(component).patch_areas["pad"] == approx(0.03 * 0.02, rel=1e-12)
    assert _estimate_cells(component) == len(mesh.cells)


def test_physical_surfaces_of_msh_files_are_sets(
    box_mesh: Callable[[CellKind], ComponentMesh], tmp_path: Path
) -> None:
    mesh = box_mesh("tet10")
    write_msh(tmp_path / "box.msh", mesh, mesh.patches)
    back = mesh_part(MeshFile(tmp_path / "box.msh"), {"a": Patch("set:top"), "b": Patch("z+")})
    assert np.array_equal(back.patches["a"], back.patches["b"])
    with pytest.raises(MeshError, match=r"no set 'roof'.*set:bottom, set:top"):
        mesh_part(MeshFile(tmp_path / "box.msh"), {"a": Patch("set:roof")})


@pytest.mark.parametrize("kind", ["tet10", "hex20"])
def test_abaqus_surfaces_and_sets_select_the_same_face(
    box_mesh: Callable[[CellKind], ComponentMesh],
    read_faces: Callable[..., ComponentMesh],
    kind: CellKind,
) -> None:
    mesh = box_mesh(kind)
    corners = 3 if kind == "tet10" else 4
    top = {frozenset(facet[:corners].tolist()) for facet in mesh.patches["top"]}
    # faces S1.. in the numbering of the Abaqus manual
    tet_faces, hex_faces = (
        ["123", "142", "243", "341"],
        ["1234", "5876", "1562", "2673", "3784", "4851"],
    )
    faces = [[int(c) - 1 for c in face] for face in (tet_faces if corners == 3 else hex_faces)]
    members = [
        (i, s)
        for i, cell in numbered(mesh.cells, 101)
        for s, face in enumerate(faces, 1)
        if frozenset(cell[face].tolist()) in top
    ]
    assert len(members) == len(top)
    extra = "*SURFACE, NAME=Lid, TYPE=ELEMENT\n" + "".join(f"{i}, S{s}\n" for i, s in members)
    extra += "*NSET, NSET=lidnodes\n" + wrapped(np.unique(mesh.patches["top"]) + 11, 8) + "\n"
    extra += "*NSET, NSET=Again\nLidNodes\n*SURFACE, TYPE=NODE, NAME=ns\nagain,\n"
    extra += f"*ELSET, ELSET=Some, GENERATE\n101, {100 + len(mesh.cells)}, 1\n"
    names = dict(zip("abcd", ("set:lid", "set:LIDNODES", "set:again", "set:NS"), strict=True))
    back = read_faces(mesh, {"top": "z+", **names}, extra)
    for name in names:
        assert np.array_equal(back.patches[name], back.patches["top"])


def test_imprints_on_mesh_files_take_the_facets_inside(
    read_faces: Callable[..., ComponentMesh],
) -> None:
    mesh = mesh_part(Box(SIZE), size=0.005, cells="hex")
    half = Patch("z+", "rect", (0.0075, 0.0, 9.0), (0.015, 0.02))
    back = read_faces(mesh, {"half": half, "disk": Patch("z+", "disk", (0, 0, 0), (0.012,))})
    areas, centroids = patch_moments(back.points, back.patches)
    assert areas["half"] == approx(0.015 * 0.02, rel=1e-9)
    assert np.allclose(centroids["half"], [0.0075, 0.0, 0.05], atol=1e-9)
    # of 24 facets the four whose middles lie within 6 mm
    assert areas["disk"] == approx(4 * 0.005**2, rel=1e-9)


def test_h12_points_lines_and_single_facets_are_refused_unless_forced(
    read_faces: Callable[..., ComponentMesh],
) -> None:
    mesh = mesh_part(Box(SIZE), size=0.005, cells="hex")
    x, _, z = mesh.points.T
    edge = np.flatnonzero((z == 0.05) & (x == x.min())) + 11
    assert len(edge) > 1
    sets = f"*NSET, NSET=edge\n{wrapped(edge, 8)}\n*NSET, NSET=point\n{edge[0]}\n"
    for name, count in (("edge", len(edge)), ("point", 1)):
        with pytest.raises(MeshError, match=r"depends on the mesh.*allow_singular"):
            read_faces(mesh, {"a": f"set:{name}"}, sets)
        forced = read_faces(mesh, {"a": f"set:{name}"}, sets, allow_singular=True)
        assert len(np.unique(forced.patches["a"])) == count
    single = Patch("z+", "rect", (0.0025, 0.0025, 0.0), (0.006, 0.003))
    with pytest.raises(MeshError, match=r"single facet.*allow_singular"):
        read_faces(mesh, {"a": single}, sets)


def test_h04_disconnected_meshes_are_refused_with_the_number_of_parts(
    box_mesh: Callable[[CellKind], ComponentMesh], read_faces: Callable[..., ComponentMesh]
) -> None:
    mesh = box_mesh("hex8")
    points = np.concatenate([mesh.points + np.array([0.1 * k, 0, 0]) for k in range(3)])
    cells = np.concatenate([mesh.cells + k * len(mesh.points) for k in range(3)])
    with pytest.raises(MeshError, match="3 parts"):
        read_faces(dataclasses.replace(mesh, points=points, cells=cells), {"foot": "z-"})


@pytest.mark.parametrize(
    ("kind", "push"),
    [("hex8", 2.0), ("hex27", 2.0), ("tet4", 2.0), ("tet10", 2.0), ("hex8", 0.9999)],
)
def test_h10_inverted_and_degenerate_elements_are_named(
    box_mesh: Callable[[CellKind], ComponentMesh],
    read_faces: Callable[..., ComponentMesh],
    kind: CellKind,
    push: float,
) -> None:
    mesh = box_mesh(kind)
    points = mesh.points.copy()
    a, b = mesh.cells[0][:2]
    points[a] += push * (points[b] - points[a])  # onto or beyond its neighbour
    with pytest.raises(MeshError, match=r"elements are unusable.*element \d+ at \("):
        read_faces(dataclasses.replace(mesh, points=points), {"foot": "z-"})


def test_h10_distorted_but_valid_hexes_are_accepted(
    read_faces: Callable[..., ComponentMesh],
) -> None:
    mesh = mesh_part(Box((6.0, 0.2, 0.1)), size=1.0, cells="hex", order=2)
    points = mesh.points.copy()
    points[:, 0] += 2.0 * points[:, 1] * np.cos(np.pi * points[:, 0])
    back = read_faces(dataclasses.replace(mesh, points=points), {"foot": "y-"})
    assert 0.3 < back.quality.minimum_scaled_jacobian < 1.0


@cases
def test_h46_files_that_hold_no_usable_mesh_are_refused_by_name(
    tmp_path: Path, name: str, text: str, words: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(MeshError, match=words):
        mesh_part(MeshFile(tmp_path / name), {"foot": Patch("z-")})
    assert not list(tmp_path.glob("pwned"))


def test_missing_faces_of_a_mesh_file_name_the_available_ones(
    box_mesh: Callable[[CellKind], ComponentMesh], read_faces: Callable[..., ComponentMesh]
) -> None:
    for face in ("face:7", "outer", "set:none"):
        with pytest.raises(MeshError, match=r"available: .*z\+, set:NALL"):
            read_faces(box_mesh("hex8"), {"a": face})


def test_a_script_beside_a_gmsh_mesh_is_not_run(tmp_path: Path) -> None:
    """Gmsh obeys ``NAME.opt``; read in this process, where no view of the files hides it."""
    mesh = tmp_path / "cube.msh"
    with gmsh_session():
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(3)
        gmsh.write(str(mesh))
    (tmp_path / "cube.msh.opt").write_text(f'SystemCall "touch {tmp_path}/obeyed";\n')
    assert len(read_gmsh(mesh).points) >= 8
    assert not (tmp_path / "obeyed").exists()
