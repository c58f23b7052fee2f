"""Matrices of bodies leave and come back in every form; what is wrong with a file is named."""

import dataclasses
import functools
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from common import approx, make_box, make_component
from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.solids import SuperelementFile
from headstock.pipeline.exchange.bodies import make_superelement
from headstock.pipeline.exchange.files import encode_body, read_body
from headstock.pipeline.exchange.matrices import ExchangeError, list_matrices
from headstock.pipeline.exchange.op4 import encode_op4, read_op4
from headstock.reduction.superelement import Superelement
from reduced_parts import reduce_mesh

FORMS = ["op4", "dmig", "abaqus", "calculix", "mtx"]
POINTS = "part_points.bdf"


@functools.cache
def reduced() -> Superelement:
    """A cantilever between two interfaces, with a few modes."""
    mesh = make_box((4, 1, 1), (0.4, 0.05, 0.04), {"foot": "x-", "tip": "x+"})
    component = make_component({"foot": "rigid", "tip": "rigid"})
    return reduce_mesh(component, mesh, modes=5)


def write(folder: Path, form: str) -> SuperelementFile:
    files = encode_body(reduced(), form)
    for ending, content in files.items():
        (folder / f"part{ending}").write_bytes(content)
    points = None if form == "dmig" else folder / POINTS
    return SuperelementFile(folder / f"part{next(iter(files))}", points)


def frequencies(superelement: Superelement) -> FloatArray:
    squares = scipy.linalg.eigvalsh(superelement.stiffness, superelement.mass)
    return np.asarray(np.sqrt(squares[6:16]))


@pytest.mark.parametrize("form", FORMS)
def test_a_body_comes_back_as_it_left(tmp_path: Path, form: str) -> None:
    read, given = read_body(write(tmp_path, form)), reduced()
    # bulk data keep ten digits
    assert frequencies(read) == approx(frequencies(given), rel=1e-7 if form == "dmig" else 1e-12)
    assert read.mass_kg == approx(given.mass_kg, rel=1e-9)
    assert read.center_of_mass == approx(given.center_of_mass, abs=1e-9)
    assert read.inertia == approx(given.inertia, abs=1e-9 * given.inertia.max())
    assert set(read.interface_maps) == {"node_1", "node_2"}


@pytest.mark.parametrize("form", ["op4", "mtx"])
def test_numbers_keep_every_bit(tmp_path: Path, form: str) -> None:
    read = read_body(write(tmp_path, form))
    assert np.array_equal(read.stiffness, reduced().stiffness)
    assert np.array_equal(read.mass, reduced().mass)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (lambda p: (1e3 * p[0], 1e3 * p[1], 1e3 * p[2]), "their unit is mm"),
        (lambda p: (p[1], p[0], p[2]), "in the order y x z it is zero"),
    ],
)
def test_wrong_units_and_axes_are_named(points, words: str) -> None:  # type: ignore[no-untyped-def]
    body = list_matrices(reduced())
    moved = {number: points(point) for number, point in body.points.items()}
    with pytest.raises(ExchangeError, match=words):
        make_superelement(dataclasses.replace(body, points=moved))


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (lambda size: np.roll(np.arange(size), 1), "order of dofs"),
        (
            lambda size: np.r_[np.arange(12).reshape(2, 6).T.ravel(), 12:size],
            "x of all nodes first",
        ),
        (lambda size: np.r_[3:6, 0:3, 9:12, 6:9, 12:size], "rotations before translations"),
        (lambda size: np.r_[12:size, 0:12], "scalar dofs first"),
    ],
)
def test_another_order_of_dofs_is_named(rows, words: str) -> None:  # type: ignore[no-untyped-def]
    body = list_matrices(reduced())
    order = np.ix_(rows(len(body.nodes)), rows(len(body.nodes)))
    with pytest.raises(ExchangeError, match=words):
        make_superelement(
            dataclasses.replace(body, stiffness=body.stiffness[order], mass=body.mass[order])
        )


def test_matrices_in_millimetres_and_tonnes_are_named() -> None:
    body = list_matrices(reduced())
    scale = np.where((body.nodes[:, 1] > 0) & (body.nodes[:, 1] < 4), 1.0, 1e3)
    scale[body.nodes[:, 1] == 0] = 1.0
    points = {n: (1e3 * x, 1e3 * y, 1e3 * z) for n, (x, y, z) in body.points.items()}
    stiffness, mass = (1e-3 * np.outer(scale, scale) * m for m in (body.stiffness, body.mass))
    with pytest.raises(ExchangeError, match="lie up to 400 m apart; matrices in mm, N and t"):
        make_superelement(dataclasses.replace(body, points=points, stiffness=stiffness, mass=mass))


@functools.cache
def small() -> Superelement:
    """Its interfaces alone: files of a few kB."""
    body, rows = list_matrices(reduced()), slice(12)
    return make_superelement(
        dataclasses.replace(
            body,
            nodes=body.nodes[rows],
            stiffness=body.stiffness[rows, rows],
            mass=body.mass[rows, rows],
        )
    )


def write_small(folder: Path, form: str) -> list[Path]:
    """Files of a small body, of each form all that are read."""
    files = encode_body(small(), form)
    for ending, content in files.items():
        (folder / f"part{ending}").write_bytes(content)
    return [folder / f"part{ending}" for ending in files]


def read_part(paths: list[Path], form: str) -> Superelement:
    points = None if form == "dmig" else paths[0].with_name(POINTS)
    return read_body(SuperelementFile(paths[0], points))


def try_part(paths: list[Path], form: str) -> tuple[Superelement | None, str]:
    try:
        return read_part(paths, form), ""
    except HeadstockError as error:
        return None, str(error)


@pytest.mark.parametrize("form", FORMS)
def test_a_file_cut_anywhere_is_one_named_error_or_whole(tmp_path: Path, form: str) -> None:
    paths = write_small(tmp_path, form)
    given, refused = read_part(paths, form), 0
    for path in paths:
        content = path.read_bytes()
        for end in range(0, len(content), max(10, len(content) // 60)):
            path.write_bytes(content[:end])
            read, message = try_part(paths, form)
            assert "part" in message or read is not None
            refused += read is None
            if read is not None:
                assert np.array_equal(read.stiffness, given.stiffness)
                assert np.array_equal(read.mass, given.mass)
        path.write_bytes(content)
    assert refused > 60


TEXT_OP4 = """       2       2       6       2KAAX    1P,3E23.16
       1       1       2
 1.5000000000000000E+00 2.0000000000000000E+00
       2       1       2
 2.0000000000000000E+00 4.0000000000000000D-01
       3       1       1
 1.4142135623730951E+00
"""


def test_op4_as_text_is_read(tmp_path: Path) -> None:
    path = tmp_path / "part.op4"
    path.write_text(TEXT_OP4 + TEXT_OP4.replace("KAAX", "MAAX").replace("1.5", "1.7"))
    read = read_op4(path)
    assert np.array_equal(read["KAAX"], [[1.5, 2.0], [2.0, 0.4]])
    assert read["MAAX"][0, 0] == 1.7


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("part.op4", TEXT_OP4.replace("       2       2       6", "       2   20001       6"), "20001 x 2"),
        ("part.op4", TEXT_OP4.replace("       2       2       6", "   19999   19999       6"), "far more"),
        ("part.op4", TEXT_OP4.replace("       2KAAX", "       4KAAX"), "is complex"),
        ("part.op4", TEXT_OP4.replace("       2       1       2", "       2       9       2"), "does not fit"),
        ("part.op4", TEXT_OP4.replace("       2       1       2", "       2       0       2"), "is sparse"),
        ("part.op4", TEXT_OP4[:-60], "does not fit"),
        ("part.op4", "nonsense", "is no OUTPUT4 file"),
        ("part.sti", "1 1 1.0\n20000 20000 1.0\n", "names row 20000, but has 2 entries"),
        ("part.sti", "1 1 1.0\n20001 20001 1.0\n", "has 20001 dofs"),
        ("part.sti", "1 1 1.0\n1e300 2 1.0\n", "whole numbers from 1"),
        ("part.sti", "0 1 1.0\n", "whole numbers from 1"),
        ("part.sti", "1 1 1.0\n1 1 1.0\n", "an entry twice"),
        ("part.sti", "1 1 nan\n", "not finite"),
        ("part.sti", "1 1 1.0\n1 2 1", "ends within a line"),
        ("part_STIF1.mtx", "1,1,1,1,1.0\n1,11,1,11,1.0\n", "dofs of nodes must be 1 to 6"),
        ("part_K.mtx", "%%MatrixMarket matrix coordinate real symmetric\n9 9 49000000\n1 1 1.0\n", "more than it has bytes"),
        ("part_K.mtx", "%%MatrixMarket matrix coordinate real symmetric\n90000 9 1\n1 1 1.0\n", "90000 x 9"),
        ("part.bdf", "DMIG,KAAX,0,6,2,0\nDMIG,KAAX,7,9,,7,9,1.0\n", "no grid point"),
    ],
)  # fmt: skip
def test_changed_counts_and_huge_indices_are_named(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    path = tmp_path / name
    path.write_text(content)
    path.with_name(POINTS).write_text("GRID           1              0.      0.      0.\n")
    for other in ("part.mas", "part_M.mtx", "part_MASS1.mtx"):
        path.with_name(other).write_text("1 1 1.0\n")
    with pytest.raises(HeadstockError, match=message) as raised:
        read_body(SuperelementFile(path, path.with_name(POINTS)))
    assert name in str(raised.value)


def test_rounding_between_the_halves_of_a_matrix_is_evened_out(tmp_path: Path) -> None:
    file = write(tmp_path, "op4")
    matrix = reduced().stiffness.copy()
    matrix[0, 1] += 1e-9 * np.abs(matrix).max()
    file.path.write_bytes(encode_op4({"KAAX": matrix, "MAAX": reduced().mass}))
    read = read_body(file)
    assert np.array_equal(read.stiffness, read.stiffness.T)


def test_dofs_that_a_supported_body_lacks_are_held(tmp_path: Path) -> None:
    body = list_matrices(reduced())
    kept = [row for row, (node, dof) in enumerate(body.nodes) if node != 1 or dof not in (2, 4)]
    held = dataclasses.replace(
        body,
        nodes=body.nodes[kept],
        stiffness=body.stiffness[np.ix_(kept, kept)],
        mass=body.mass[np.ix_(kept, kept)],
    )
    with pytest.raises(ExchangeError, match="supported"):
        make_superelement(held)
    read = make_superelement(held, supported=True)
    translation, rotation = read.constraints
    assert read.labels[1] == ("1", "y") and translation[1] == 1.0
    assert np.count_nonzero(translation) == 1 < np.count_nonzero(rotation)


def test_a_deck_says_where_nodes_are(tmp_path: Path) -> None:
    file = write(tmp_path, "calculix")
    points = "".join(
        f"{number}, {x:.17g}, {y:.17g}, {z:.17g}\n"
        for number, (x, y, z) in list_matrices(reduced()).points.items()
    )
    deck = tmp_path / "part.inp"
    deck.write_text(f"*HEADING\n*NODE, NSET=ALL\n{points}*STEP\n")
    read = read_body(SuperelementFile(file.path, deck))
    assert frequencies(read) == approx(frequencies(reduced()), rel=1e-12)
    deck.write_text("*HEADING\n")
    with pytest.raises(ExchangeError, match=r"part.inp has no \*NODE"):
        read_body(SuperelementFile(file.path, deck))
