"""Matrices of bodies leave and come back in every form; what is wrong with a file is named."""

import dataclasses
import functools
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from mpi4py import MPI

from common import approx, make_box, make_component
from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.solids import SuperelementFile
from headstock.pipeline.exchange.bodies import make_superelement
from headstock.pipeline.exchange.files import encode_body, read_body
from headstock.pipeline.exchange.matrices import ExchangeError, list_matrices
from headstock.pipeline.exchange.op4 import encode_op4
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.superelement import Superelement

FORMS = ["op4", "dmig", "abaqus", "calculix", "mtx"]
POINTS = "part_points.bdf"


@functools.cache
def reduced() -> Superelement:
    """A cantilever between two interfaces, with a few modes."""
    mesh = make_box((4, 1, 1), (0.4, 0.05, 0.04), {"foot": "x-", "tip": "x+"})
    component = make_component({"foot": "rigid", "tip": "rigid"})
    return reduce_elastic(component, mesh, comm=MPI.COMM_SELF)


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


def test_another_order_of_dofs_is_refused() -> None:
    body = list_matrices(reduced())
    order = np.roll(np.arange(len(body.nodes)), 1)
    shuffled = dataclasses.replace(body, stiffness=body.stiffness[np.ix_(order, order)])
    with pytest.raises(ExchangeError, match="rigid body"):
        make_superelement(shuffled)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_file_cut_short_is_one_named_error(tmp_path: Path, form: str, share: float) -> None:
    file = write(tmp_path, form)
    content = file.path.read_bytes()
    file.path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(HeadstockError, match="part"):
        read_body(file)


def test_rounding_between_the_halves_of_a_matrix_is_evened_out(tmp_path: Path) -> None:
    file = write(tmp_path, "op4")
    matrix = reduced().stiffness.copy()
    matrix[0, 1] += 1e-9 * np.abs(matrix).max()
    file.path.write_bytes(encode_op4({"KAAX": matrix, "MAAX": reduced().mass}))
    read = read_body(file)
    assert np.array_equal(read.stiffness, read.stiffness.T)
