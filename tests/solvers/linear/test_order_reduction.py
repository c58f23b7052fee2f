"""Balanced truncation stays below its bound, and other tools get the same system."""

import io
import sys
import types

import numpy as np
import pytest
import scipy.io

from headstock.geometry.parts.components import Material
from headstock.pipeline.exports import encode_mat
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.state_space import balance_truncate, measure_error, to_control, to_state_space
from headstock.validation.parts.line_elements import TIP, cantilever_system
from headstock.validation.references.prismatic_beams import PrismaticBeam

BEAM = PrismaticBeam(0.5, 0.1, 0.038, Material("steel", 210e9, 0.3, 7850.0))


def beam_space(zeta):
    return to_state_space(add_modal_damping(cantilever_system(BEAM, 4), [zeta]), inputs=[TIP], outputs=[TIP])


@pytest.mark.parametrize("order", [2, 4, 6])
@pytest.mark.parametrize("zeta", [0.01, 0.2])
def test_the_error_lies_below_the_bound_and_near_it(order, zeta):
    space = beam_space(zeta)
    found = balance_truncate(space, order)
    frequencies = np.unique(
        np.concatenate([np.linspace(0.0, 3000.0, 400), np.abs(np.linalg.eigvals(space.a).imag) / (2.0 * np.pi)])
    )
    error = measure_error(space, found.space, frequencies)
    assert 0.1 * found.bound < error <= found.bound * (1.0 + 1e-6)
    assert np.linalg.eigvals(found.space.a).real.max() < 0.0
    assert found.space.inputs == space.inputs and len(found.space.states) == order


def test_all_states_kept_is_the_same_system():
    space = beam_space(0.02)
    found = balance_truncate(space, len(space.a))
    assert found.bound == 0.0
    assert measure_error(space, found.space, np.linspace(0.0, 3000.0, 50)) < 1e-6 * found.hankel[0]


def test_what_does_not_decay_has_no_balance():
    with pytest.raises(ModelError, match="decay"):
        balance_truncate(beam_space(0.0), 2)
    with pytest.raises(ModelError, match="order 17"):
        balance_truncate(beam_space(0.1), 17)


def test_matlab_reads_the_same_matrices_and_names():
    space = beam_space(0.02)
    read = scipy.io.loadmat(io.BytesIO(encode_mat(space)), simplify_cells=True)
    for name in "abcd":
        np.testing.assert_array_equal(np.reshape(read[name.upper()], getattr(space, name).shape), getattr(space, name))
    assert read["inputs"] == "tip x" and read["states"][1] == "mode 1 velocity"


def test_python_control_gets_matrices_and_names(monkeypatch):
    kept = {}

    def state_space(*matrices, **names):
        kept["matrices"], kept["names"] = matrices, names

    monkeypatch.setitem(sys.modules, "control", types.SimpleNamespace(StateSpace=state_space))
    space = beam_space(0.02)
    to_control(space)
    assert kept["matrices"] == (space.a, space.b, space.c, space.d)
    assert kept["names"]["inputs"] == ["tip x"]


def test_without_python_control_it_is_said_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ModelError, match="pip install control"):
        to_control(beam_space(0.02))
