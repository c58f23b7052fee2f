"""Other tools get the same system."""

import io

import numpy as np
import scipy.io

from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Material
from headstock.pipeline.exchange.state_spaces import describe_space, encode_mat
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.state_spaces.state_space import StateSpace, to_state_space
from headstock.validation.parts.line_elements import TIP, cantilever_system
from headstock.validation.references.beam_theory import PrismaticBeam

BEAM = PrismaticBeam(0.5, 0.1, 0.038, Material("steel", 210e9, 0.3, 7850.0))


def beam_space(zeta: float) -> StateSpace:
    return to_state_space(
        add_modal_damping(cantilever_system(BEAM, 4), [zeta]), inputs=[TIP], outputs=[TIP]
    )


def test_matlab_reads_the_same_matrices_and_names() -> None:
    record = describe_space(beam_space(0.02), pose=Pose("reference", {"X": 0.1}))
    read = scipy.io.loadmat(io.BytesIO(encode_mat(record.contents)), simplify_cells=True)
    for name in "ABCD":
        matrix = getattr(record, name)
        np.testing.assert_array_equal(np.reshape(read[name], matrix.shape), matrix)
    assert read["inputs"] == "tip x" and read["states"][1] == "mode 1 velocity"
    assert (read["step"], read["axes"], read["positions"]) == (0.0, "X", 0.1)
