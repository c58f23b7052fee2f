"""Files of test data by their endings, read in a process apart where they are not small."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headstock.meshing.process.strangers import MATLAB, TEST_DATA, read_apart
from headstock.meshing.process.worker import Arrays
from headstock.scene.reading.files import TEST_DATA_SUFFIXES, UFF_SUFFIXES
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.records import (
    MeasuredModes,
    MeasuredResponses,
    TestChannel,
    TestData,
    TestPoint,
    as_vector,
)
from headstock.scene.test_data.tables import parse_csv, parse_mat, parse_text
from headstock.scene.test_data.uff import parse_uff

PARSERS: dict[str, Callable[[Path], TestData]] = {".csv": parse_csv, ".mat": parse_mat}
PARSERS |= dict.fromkeys(UFF_SUFFIXES, parse_uff) | dict.fromkeys((".frf", ".txt"), parse_text)


def read_test_data(path: Path) -> TestData:
    """Read points, frequency responses and modes of a test.

    Raises:
        MeasurementError: No such file, an unknown ending, or something is wrong in it; says where
            and what to do.
    """
    suffix = path.suffix.lower()
    if suffix not in PARSERS:
        raise MeasurementError(
            f"{path.name}:1: test data end in {', '.join(TEST_DATA_SUFFIXES)}; export one of these"
        )
    kind = MATLAB if suffix == ".mat" else TEST_DATA
    return _unpack(read_apart(path, kind, _parse, error=MeasurementError))


def _parse(path: Path) -> Arrays:
    return _pack(PARSERS[path.suffix.lower()](path))


def _pack(data: TestData) -> Arrays:
    """Test data as arrays, which a worker process hands over."""
    content: dict[str, object] = {
        "points": [asdict(point) for point in data.points.values()],
        "lines": data.lines,
        "remarks": data.remarks,
    }
    arrays: dict[str, NDArray[Any]] = {}
    if data.responses is not None:
        content["motions"] = list(map(asdict, data.responses.motions))
        content["forces"] = list(map(asdict, data.responses.forces))
        arrays["lines_hz"] = data.responses.frequencies_hz
        arrays["responses"] = data.responses.values
        if data.responses.deviations is not None:
            arrays["deviations"] = data.responses.deviations
    if data.modes is not None:
        content["channels"] = list(map(asdict, data.modes.channels))
        content["scaled"] = data.modes.scaled
        arrays["modes_hz"] = data.modes.frequencies_hz
        arrays["damping"] = data.modes.damping
        arrays["shapes"] = data.modes.shapes
    return {"content": np.frombuffer(json.dumps(content).encode(), np.uint8), **arrays}


def _unpack(arrays: Arrays) -> TestData:
    content = json.loads(arrays["content"].tobytes())

    def channels(key: str) -> tuple[TestChannel, ...]:
        return tuple(
            TestChannel(each["point"], as_vector(each["direction"])) for each in content[key]
        )

    points = [
        TestPoint(
            each["name"],
            as_vector(each["position"]),
            tuple(map(as_vector, each["axes"])),
            each["part"],
        )
        for each in content["points"]
    ]
    responses = modes = None
    if "responses" in arrays:
        responses = MeasuredResponses(
            arrays["lines_hz"],
            channels("motions"),
            channels("forces"),
            arrays["responses"],
            arrays.get("deviations"),
        )
    if "shapes" in arrays:
        modes = MeasuredModes(
            arrays["modes_hz"],
            arrays["damping"],
            channels("channels"),
            arrays["shapes"],
            content["scaled"],
        )
    return TestData(
        {point.name: point for point in points},
        tuple(map(tuple, content["lines"])),
        responses,
        modes,
        tuple(content["remarks"]),
    )
