"""Faces of a changed part are found by place, wherever its file has it."""

import dataclasses

import numpy as np
import pytest
from cad_blocks import as_vector, bore, box_faces

from common import approx
from headstock.geometry.assemblies.replaced_parts import find_faces_again, find_old_position
from headstock.geometry.frames import FloatArray, rotation_about
from headstock.geometry.parts.cad_faces import CadFace

HOLES = [(0.02, 0.03), (0.08, 0.03), (0.05, 0.17)]


def block(*holes: tuple[float, float], radius: float = 0.005) -> list[CadFace]:
    """A block whose holes have slightly different depths."""
    bores = [bore(n, at, radius, 0.02 + 0.001 * n) for n, at in enumerate(holes, 7)]
    return [*box_faces(), *bores]


def moved(faces: list[CadFace], rotation: FloatArray, shift: FloatArray) -> list[CadFace]:
    """Faces elsewhere; of a motion along the axes their boxes, too."""
    ends = [np.array([face.low, face.high]) @ rotation.T + shift for face in faces]
    return [
        dataclasses.replace(
            face,
            center=as_vector(rotation @ face.center + shift),
            normal=as_vector(rotation @ face.normal),
            low=as_vector(box.min(axis=0)),
            high=as_vector(box.max(axis=0)),
            axis=as_vector(rotation @ face.axis),
            axis_point=as_vector(rotation @ face.axis_point + shift),
        )
        for face, box in zip(faces, ends, strict=True)
    ]


def test_equal_faces_are_found_and_those_that_moved_are_lost() -> None:
    old = block(*HOLES)
    new = block(HOLES[0], HOLES[1], (0.05, 0.12))
    assert find_faces_again(old, new) == {n: (n,) for n in range(1, 9)} | {9: ()}
    wider = block(*HOLES, radius=0.0051)
    assert [find_faces_again(old, wider)[n] for n in (6, 7, 8, 9)] == [(6,), (), (), ()]
    filled = [dataclasses.replace(face, hollow=False) for face in old]
    assert find_faces_again(old, filled)[7] == ()


def test_a_face_that_was_cut_is_found_in_its_pieces() -> None:
    old = box_faces()
    top = old[5]
    low, high = np.array(top.low), np.array(top.high)
    pieces = [
        dataclasses.replace(
            top,
            number=number,
            area=top.area * 0.4,
            low=as_vector(low + np.array([start * high[0], 0.0, 0.0])),
            high=as_vector(high * [start + 0.4, 1.0, 1.0]),
            center=as_vector(high * [start + 0.2, 0.5, 1.0]),
        )
        for number, start in ((6, 0.0), (7, 0.6))
    ]
    sunk = dataclasses.replace(pieces[1], number=8, center=as_vector(high * [0.5, 0.5, 0.9]))
    assert find_faces_again(old, [*old[:5], *pieces, sunk])[6] == (6, 7)
    # a neighbour that shares an edge with it does not lie on it
    beside = dataclasses.replace(top, number=9, low=as_vector(np.array([high[0], 0.0, high[2]])))
    beside = dataclasses.replace(beside, high=as_vector(high * [2.0, 1.0, 1.0]))
    assert find_faces_again(old, [beside])[6] == ()


def test_a_freeform_face_is_found_where_it_is_as_large() -> None:
    face = dataclasses.replace(box_faces()[0], kind="freeform")
    assert find_faces_again([face], [face])[1] == (1,)
    larger = dataclasses.replace(face, area=face.area * 1.01)
    assert find_faces_again([face], [larger])[1] == ()


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, 0.3])
def test_a_part_in_other_coordinates_is_brought_back(turn: float) -> None:
    old = block(*HOLES)
    rotation, shift = rotation_about(np.array([0.0, 0.0, 1.0]), turn), np.array([1.0, 2.0, -3.0])
    new = moved(block(HOLES[0], HOLES[1], HOLES[2], (0.05, 0.1)), rotation, shift)
    motion = find_old_position(old, new)
    assert motion.rotation == approx(rotation.T, abs=1e-9)
    assert motion.shift == approx(-rotation.T @ shift, abs=1e-9)
    if turn == 0.0:
        back = moved(new, motion.rotation, motion.shift)
        assert find_faces_again(old, back) == {n: (n,) for n in range(1, 10)}


def test_a_part_that_stays_is_not_moved() -> None:
    assert np.array_equal(find_old_position(block(*HOLES), block(HOLES[1])).rotation, np.eye(3))
    unlike = [dataclasses.replace(face, area=2.0 * face.area) for face in box_faces()]
    assert np.array_equal(find_old_position(box_faces(), unlike).shift, np.zeros(3))
