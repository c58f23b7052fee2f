"""Other tools get the same system."""

import io
import sys
import types

import numpy as np
import pytest
import scipy.io

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.pipeline.exports import _encode_mat
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.state_space import StateSpace, to_control, to_state_space
from headstock.validation.parts.line_elements import TIP, cantilever_system
from headstock.validation.references.beam_theory import PrismaticBeam

BEAM = PrismaticBeam(0.5, 0.1, 0.038, Material("steel", 210e9, 0.3, 7850.0))


def beam_space(zeta: float) -> StateSpace:
    return to_state_space(
        add_modal_damping(cantilever_system(BEAM, 4), [zeta]), inputs=[TIP], outputs=[TIP]
    )


def test_matlab_reads_the_same_matrices_and_names() -> None:
    space = beam_space(0.02)
    read = scipy.io.loadmat(io.BytesIO(_encode_mat(space)), simplify_cells=True)
    for name in "abcd":
        np.testing.assert_array_equal(
            np.reshape(read[name.upper()], getattr(space, name).shape), getattr(space, name)
        )
    assert read["inputs"] == "tip x" and read["states"][1] == "mode 1 velocity"


def test_python_control_gets_matrices_and_names(monkeypatch: pytest.MonkeyPatch) -> None:
    matrices, names = [], []

    def state_space(*given: FloatArray, inputs: list[str], **others: list[str]) -> None:
        matrices.append(given)
        names.append(inputs)

    monkeypatch.setitem(sys.modules, "control", types.SimpleNamespace(StateSpace=state_space))
    space = beam_space(0.02)
    to_control(space)
    assert matrices == [(space.a, space.b, space.c, space.d)]
    assert names == [["tip x"]]


def test_without_python_control_it_is_said_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ModelError, match="pip install control"):
        to_control(beam_space(0.02))
