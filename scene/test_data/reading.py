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
    texts: dict[str, object] = {
        "points": [asdict(point) for point in data.points.values()],
        "lines": data.lines,
        "remarks": data.remarks,
    }
    arrays: dict[str, NDArray[Any]] = {}
    if (responses := data.responses) is not None:
        texts["motions"] = list(map(asdict, responses.motions))
        texts["forces"] = list(map(asdict, responses.forces))
        arrays |= {"lines_hz": responses.frequencies_hz, "responses": responses.values}
        if responses.deviations is not None:
            arrays["deviations"] = responses.deviations
    if (modes := data.modes) is not None:
        texts |= {"channels": list(map(asdict, modes.channels)), "scaled": modes.scaled}
        arrays |= {"modes_hz": modes.frequencies_hz, "damping": modes.damping}
        arrays["shapes"] = modes.shapes
    return {"texts": np.frombuffer(json.dumps(texts).encode(), np.uint8), **arrays}


def _unpack(arrays: Arrays) -> TestData:
    texts = json.loads(arrays["texts"].tobytes())
    motions, forces, channels = (
        tuple(TestChannel(one["point"], as_vector(one["direction"])) for one in texts.get(key, ()))
        for key in ("motions", "forces", "channels")
    )
    points = {
        one["name"]: TestPoint(
            one["name"],
            as_vector(one["position"]),
            tuple(map(as_vector, one["axes"])),
            one["part"],
        )
        for one in texts["points"]
    }
    responses = modes = None
    if "responses" in arrays:
        values, deviations = arrays["responses"], arrays.get("deviations")
        responses = MeasuredResponses(arrays["lines_hz"], motions, forces, values, deviations)
    if "shapes" in arrays:
        modes = MeasuredModes(
            arrays["modes_hz"], arrays["damping"], channels, arrays["shapes"], texts["scaled"]
        )
    lines = tuple(map(tuple, texts["lines"]))
    return TestData(points, lines, responses, modes, tuple(texts["remarks"]))
