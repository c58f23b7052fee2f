"""Makes ``three_axis_test.uff``: a modal test of the calibrated three-axis machine, made by computing.

Run inside Headstock's environment, in this folder: ``../headstock exec python3 three_axis_test.py``.
Points stay where the file has them. Modes are those of the model, 2 % higher and with 2 % noise; the
sensor at point 11 is turned about z by half a turn.
"""

from pathlib import Path

import numpy as np

import headstock as hs
from headstock.scene.test_data.reading import read_test_data
from headstock.scene.test_data.records import MeasuredModes, TestData
from headstock.scene.test_data.uff_writing import encode_uff

SCENE, TEST = Path("three_axis.toml"), Path("three_axis_test.uff")
VARIANT, POSE = "calibrated+segmented+YCE", "measured"
MODES, LOWEST_HZ = 8, 40.0  # the machine on its air springs lies below
HIGHER, DAMPING, NOISE, TURNED = 1.02, 0.02, 0.02, "11"


def make_test() -> bytes:
    """Return the universal file."""
    found = hs.correlate(hs.load(SCENE), TEST, variant=VARIANT, pose=POSE)
    hertz = found.computed.frequencies_hz
    chosen = np.flatnonzero(hertz > LOWEST_HZ)[:MODES]
    shapes = found.shapes[:, chosen].real
    sizes = np.sqrt(np.mean(shapes**2, axis=0))
    shapes = shapes + NOISE * sizes * np.random.default_rng(1).standard_normal(shapes.shape)
    for row, channel in enumerate(found.channels):
        if channel.point == TURNED and not channel.direction[2]:
            shapes[row] *= -1.0
    modes = MeasuredModes(
        HIGHER * hertz[chosen], np.full(MODES, DAMPING), found.channels, shapes.astype(complex)
    )
    data = TestData(read_test_data(TEST).points, modes=modes)
    return encode_uff(data, "computed: three-axis machine, 2 % noise, point 11 turned")


if __name__ == "__main__":
    TEST.write_bytes(make_test())
