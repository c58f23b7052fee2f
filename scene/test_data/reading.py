"""Files of test data by their endings, read in a process apart where they are not small."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

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


@dataclass(frozen=True)
class _Texts:
    """What of test data is no array."""

    points: tuple[TestPoint, ...]
    lines: tuple[tuple[str, ...], ...]
    remarks: tuple[str, ...]
    motions: tuple[TestChannel, ...] = ()
    forces: tuple[TestChannel, ...] = ()
    channels: tuple[TestChannel, ...] = ()
    scaled: bool = False


def _pack(data: TestData) -> Arrays:
    """Test data as arrays, which a worker process hands over."""
    texts = _Texts(tuple(data.points.values()), data.lines, data.remarks)
    arrays: dict[str, NDArray[Any]] = {}
    if (responses := data.responses) is not None:
        texts = replace(texts, motions=responses.motions, forces=responses.forces)
        arrays |= {"lines_hz": responses.frequencies_hz, "responses": responses.values}
        if responses.deviations is not None:
            arrays["deviations"] = responses.deviations
    if (modes := data.modes) is not None:
        texts = replace(texts, channels=modes.channels, scaled=modes.scaled)
        arrays |= {"modes_hz": modes.frequencies_hz, "damping": modes.damping}
        arrays["shapes"] = modes.shapes
    return {"texts": np.frombuffer(TypeAdapter(_Texts).dump_json(texts), np.uint8), **arrays}


def _unpack(arrays: Arrays) -> TestData:
    texts = TypeAdapter(_Texts).validate_json(arrays["texts"].tobytes())
    responses = modes = None
    if "responses" in arrays:
        responses = MeasuredResponses(
            arrays["lines_hz"],
            texts.motions,
            texts.forces,
            arrays["responses"],
            arrays.get("deviations"),
        )
    if "shapes" in arrays:
        modes = MeasuredModes(
            arrays["modes_hz"], arrays["damping"], texts.channels, arrays["shapes"], texts.scaled
        )
    points = {point.name: point for point in texts.points}
    return TestData(points, texts.lines, responses, modes, texts.remarks)
