"""Claims about the block on springs."""

import numpy as np

from headstock.geometry.frames import rigid_map
from headstock.validation.parts.closed_form_cases import _block_frequencies, _SprungBlock


def test_frequencies_equal_the_six_by_six_eigenproblem_for_unequal_springs() -> None:
    block = _SprungBlock((0.7, 1.1, 0.4), 310.0, (0.9e4, 2.0e4, 1.5e4))
    a, b, h = (0.5 * edge for edge in block.size)
    corners = np.array([[x, y, -h] for x in (-a, a) for y in (-b, b)])
    motions = rigid_map(corners, np.zeros(3))
    stiffness = motions.T @ np.diag(np.tile(block.spring, 4)) @ motions
    inertia = 310.0 / 3.0 * np.array([b**2 + h**2, a**2 + h**2, a**2 + b**2])
    root = np.sqrt(np.concatenate([np.full(3, 310.0), inertia]))
    exact = np.sqrt(np.linalg.eigvalsh(stiffness / np.outer(root, root))) / (2 * np.pi)
    np.testing.assert_allclose(_block_frequencies(block), exact, rtol=1e-12)
