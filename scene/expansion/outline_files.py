"""Corners of outlines that stand in files of their own."""

from pathlib import Path

from headstock.scene.reading.csv_files import CsvError, read_corners
from headstock.scene.reading.files import TomlTable, TomlValue, resolve_file
from headstock.scene.reading.findings import Findings, KeyPath

SUFFIXES = (".csv",)
SECTIONS = ("components", "supports", "loads")  # where patches are
OUTLINE = "outline"


def read_outlines(tables: TomlTable, folder: Path, findings: Findings) -> TomlTable:
    """Return a scene in which outlines have the corners that their files hold.

    Args:
        tables: A scene in full.
        folder: Of the scene, in which the files lie.
        findings: Receives problems.
    """
    filled = dict(tables)
    for name in filled.keys() & set(SECTIONS):
        section = _fill(tables[name], (name,), folder, findings)
        assert section is not None  # of a table
        filled[name] = section
    return filled


def _fill(value: TomlValue, key: KeyPath, folder: Path, findings: Findings) -> TomlValue | None:
    """Return a value with its outlines filled; None for one whose file cannot be read."""
    if isinstance(value, list):
        listed = [_fill(inner, (*key, row), folder, findings) for row, inner in enumerate(value)]
        return [inner for inner in listed if inner is not None]
    if not isinstance(value, dict):
        return value
    file = value.get("file")
    if key[-1] != OUTLINE or not isinstance(file, str) or "corners" in value:
        filled = {
            name: _fill(inner, (*key, name), folder, findings) for name, inner in value.items()
        }
        return {name: inner for name, inner in filled.items() if inner is not None}
    try:
        corners, _ = read_corners(resolve_file(folder, file, SUFFIXES))
    except (CsvError, ValueError) as error:
        findings.add((*key, "file"), str(error))
        return None
    return {
        "corners": [[f"{float(length)!r} m" for length in corner] for corner in map(tuple, corners)]
    }
