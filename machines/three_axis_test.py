"""Makes ``three_axis_test.uff``: a modal test of the calibrated three-axis machine, made by computing.

Run inside Headstock's environment, in this folder: ``../headstock exec python3 three_axis_test.py``.
Points stay where the file has them. Modes and frequency responses are those of the segmented model, 2 %
higher and with 2 % noise; the sensor at point 11 is turned about z by half a turn.
"""

import itertools
import tempfile
from pathlib import Path

import numpy as np

import headstock as hs
from headstock.geometry.frames import FloatArray
from headstock.scene.test_data.reading import read_test_data
from headstock.scene.test_data.records import (
    MeasuredModes,
    MeasuredResponses,
    TestChannel,
    TestData,
)
from headstock.scene.test_data.uff_writing import encode_uff

SCENE, TEST = Path("three_axis.toml"), Path("three_axis_test.uff")
VARIANT, POSE = "calibrated+segmented+YCE", "measured"
MODES, LOWEST_HZ = 8, 40.0  # the machine on its air springs lies below
HIGHER, DAMPING, NOISE, TURNED = 1.02, 0.02, 0.02, "11"
LINES_HZ = np.arange(40.0, 341.0, 1.5)
HIT, MOVED = "6", ("6", "15")  # points: on the slider of the tool, and on the table
ALONG = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def make_test() -> bytes:
    """Return the universal file."""
    points, random = read_test_data(TEST).points, np.random.default_rng(1)
    # what is 2 % higher everywhere has at a line what the model has 2 % below
    asked = _place_responses(LINES_HZ / HIGHER)
    modes = read_test_data(TEST).modes
    with tempfile.TemporaryDirectory() as folder:
        empty = Path(folder) / TEST.name
        empty.write_bytes(encode_uff(TestData(points, responses=asked, modes=modes), "empty"))
        found = hs.correlate(hs.load(SCENE), empty, variant=VARIANT, pose=POSE)
    hertz = found.computed.frequencies_hz
    chosen = np.flatnonzero(hertz > LOWEST_HZ)[:MODES]
    shapes = found.shapes[:, chosen].real
    sizes = np.sqrt(np.mean(shapes**2, axis=0))
    shapes = shapes + NOISE * sizes * random.standard_normal(shapes.shape)
    for row, channel in enumerate(found.channels):
        if channel.point == TURNED and not channel.direction[2]:
            shapes[row] *= -1.0
    modes = MeasuredModes(
        HIGHER * hertz[chosen], np.full(MODES, DAMPING), found.channels, shapes.astype(complex)
    )
    assert found.responses is not None
    values = found.responses.computed.receptance / HIGHER**2
    noise = NOISE * np.sqrt(np.mean(np.abs(values) ** 2, axis=0) / 2.0)
    parts = random.standard_normal((2, *values.shape))
    values = values + noise * (parts[0] + 1j * parts[1])
    responses = MeasuredResponses(LINES_HZ, asked.motions, asked.forces, values)
    data = TestData(points, responses=responses, modes=modes)
    return encode_uff(data, "computed: three-axis machine, 2 % noise, point 11 turned")


def _place_responses(lines_hz: FloatArray) -> MeasuredResponses:
    """Return responses without values at the lines."""
    motions, forces = (
        tuple(TestChannel(*ends) for ends in itertools.product(points, ALONG))
        for points in (MOVED, (HIT,))
    )
    ones = np.ones((len(lines_hz), len(motions), len(forces)), dtype=complex)
    return MeasuredResponses(lines_hz, motions, forces, ones)


if __name__ == "__main__":
    TEST.write_bytes(make_test())
