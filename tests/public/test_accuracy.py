"""What an accuracy promises: met only where it is, ± that covers, an end in any case."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import headstock as hs
from common import approx

SCENE = """
free = true
accuracy = "{accuracy}"
materials.m = {{ E = "210 GPa", nu = 0.3, rho = "7850 kg/m^3" }}
analyses.modal = {{ up_to = "{up_to} Hz" }}
[components.part]
material = "m"
solid = {{ tube = {{ outer = "{outer} mm", inner = "{inner} mm", length = "{length} mm" }} }}
"""
# of swept grids of hexahedra with 27 nodes, two of them extrapolated [Hz]
THIN_RING = [585.9, 819.3, 1643.1, 2427.8]
STOUT_RING = [4160.7, 4398.3]
THICK_TUBE = [9943.4, 10419.4, 11455.9]


def search(folder: Path, accuracy: str, *sizes: int) -> hs.Results:
    path = folder / "part.toml"
    outer, inner, length, up_to = sizes
    path.write_text(
        SCENE.format(accuracy=accuracy, outer=outer, inner=inner, length=length, up_to=up_to)
    )
    return hs.run(path)


@pytest.mark.parametrize(
    ("sizes", "truth"),
    [
        ((240, 216, 20, 2500), np.repeat(THIN_RING, 2)),
        ((160, 100, 40, 4500), np.repeat(STOUT_RING, 2)),
        ((100, 50, 140, 11500), np.repeat(THICK_TUBE, 2)[:-1]),
    ],
)
def test_an_accuracy_of_one_percent_is_met_where_single_tets_fill_a_section(
    tmp_path: Path, sizes: tuple[int, ...], truth: NDArray[np.float64]
) -> None:
    results = search(tmp_path, "1 %", *sizes)
    assert not results.failures
    (modes,) = results.modal
    found = modes.frequencies_hz[modes.rigid_count :]
    given = np.array([error.total for error in modes.list_errors()[modes.rigid_count :]])
    assert len(found) == len(truth)
    off = np.abs(found - truth)
    assert (off <= 0.01 * truth).all()
    assert (off <= given + 1e-4 * truth).all()


def test_a_free_part_keeps_no_modes_for_interfaces_that_it_has_not(tmp_path: Path) -> None:
    results = search(tmp_path, "0.2 %", 160, 100, 40, 4500)
    assert not results.failures
    (modes,) = results.modal
    assert np.allclose(modes.frequencies_hz[6:], np.repeat(STOUT_RING, 2), rtol=2e-3, atol=0.0)


def test_a_thin_tube_that_ovalizes_is_not_left_to_polynomials(tmp_path: Path) -> None:
    path = tmp_path / "part.toml"
    path.write_text(
        SCENE.format(accuracy="3 %", outer=60, inner=52, length=70, up_to=4500).replace(
            "[components.part]", '[components.part]\nfidelity = "polynomial"'
        )
    )
    results = hs.run(path)
    assert not results.failures
    (modes,) = results.modal
    assert modes.frequencies_hz[6] == approx(3330.0, rel=0.05)
