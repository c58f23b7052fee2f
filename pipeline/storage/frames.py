"""Columns as pandas frames; pandas is loaded when a frame is asked for."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from headstock.geometry.errors import HeadstockError
from headstock.geometry.loading import load_library

if TYPE_CHECKING:
    import pandas


type Frame = pandas.DataFrame


def frame_columns(columns: Mapping[str, Sequence[object]]) -> Frame:
    """Return a pandas frame of columns; those of whole numbers alone are integers, those of
    other numbers, or of none, floats.

    Args:
        columns: Head to the value in each row.

    Raises:
        HeadstockError: pandas is missing.
    """
    try:
        library = load_library("pandas")
    except ModuleNotFoundError as missing:
        raise HeadstockError(
            "tables are pandas': pip install pandas, or start with ./headstock python"
        ) from missing
    frame = library.DataFrame(dict(columns))
    for name, values in columns.items():
        kinds = set(map(type, values))
        if kinds <= {int, float, type(None)} and kinds != {int}:
            frame[name] = frame[name].astype(float)
    found: Frame = frame
    return found
