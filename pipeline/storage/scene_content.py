"""What results of a scene depend on besides its text: this program's packages, the files of its solids and its measured forces."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import headstock.geometry
import headstock.meshing
import headstock.pipeline
import headstock.reduction
import headstock.scene
import headstock.solvers
from headstock.pipeline.storage.json_texts import Json

PACKAGES = (
    headstock.geometry,
    headstock.meshing,
    headstock.solvers,
    headstock.reduction,
    headstock.scene,
    headstock.pipeline,
)
FILE_KEYS = ("step", "mesh", "superelement")


def file_digests(folder: Path, raw: Json) -> Iterator[tuple[str, str]]:
    """Files that solids and measured forces are read from and their SHA-256."""
    names = [
        component["solid"][key]
        for component in raw.get("components", {}).values()
        for key in FILE_KEYS
        if key in component.get("solid", {})
    ]
    contouring = raw.get("analyses", {}).get("contouring")
    if isinstance(contouring, dict) and "forces" in contouring:
        names.append(contouring["forces"])
    for name in names:
        with (folder / name).open("rb") as file:
            yield name, hashlib.file_digest(file, "sha256").hexdigest()
