"""What a search chose, as keys of the scene that give the same run again without one."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from headstock.geometry.parts.components import Component, Interface, MeshSettings
from headstock.meshing.size_files import SUFFIX, encode_sizes
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.storage.outputs import replace_outputs
from headstock.scene.reading.files import TomlTable, TomlValue

LENGTHS = ("size", "rim_size", "smallest", "leave_out", "details")  # of a mesh


SIZES_FOLDER = "sizes"


def write_sizes(folder: Path, components: Mapping[str, Component]) -> list[str]:
    """Write the element sizes of meshes that have them from place to place; remarks.

    Args:
        components: By name, with the settings of their meshes.

    Raises:
        OutputError: The disk is full or the folder is gone.
    """
    contents = {
        f"{file_stem(name)}{SUFFIX}": encode_sizes(part.mesh.sizes)
        for name, part in components.items()
        if part.fidelity == "elastic" and part.mesh.sizes is not None
    }
    return replace_outputs(folder, SIZES_FOLDER, contents)


def list_values(components: Mapping[str, Component]) -> TomlTable:
    """Values by dotted key, which ``load_scene`` takes.

    Args:
        components: Those whose models, meshes, modes or interfaces were chosen, with what was.
    """
    values: TomlTable = {}
    for name, part in components.items():
        key = f"components.{name}"
        values[f"{key}.fidelity"] = part.fidelity
        if part.fidelity == "segmented":
            values[f"{key}.segments.count"] = part.segments.count
        if part.fidelity == "elastic":
            values[f"{key}.mesh"] = _mesh_values(name, part.mesh)
        if part.fidelity in ("elastic", "polynomial") and (kept := _reduction_values(part)):
            values[f"{key}.reduction"] = kept
        values |= {
            f"{key}.interfaces.{own}.coupling": _coupling_value(item)
            for own, item in part.interfaces.items()
            if item.flexible
        }
    return values


def _reduction_values(part: Component) -> TomlTable:
    settings = part.reduction
    values: TomlTable = {}
    if settings.modes_to_hz is not None:
        values["modes_to"] = f"{settings.modes_to_hz:.12g} Hz"
    if settings.correct_mesh and part.fidelity == "elastic":
        values["correct_mesh"] = True
    return values


def _mesh_values(name: str, mesh: MeshSettings) -> TomlTable:
    """Those of its keys that are not the default; sizes from place to place are those of a file beside
    the scene.
    """
    plain = MeshSettings()
    changed: dict[str, TomlValue] = {
        field.name: value
        for field in dataclasses.fields(mesh)
        if field.name != "sizes"
        and (value := getattr(mesh, field.name)) != getattr(plain, field.name)
    }
    if mesh.sizes is not None:
        del changed["size"]
    written: TomlTable = {
        key: f"{1e3 * float(str(value)):.12g} mm" if key in LENGTHS else value
        for key, value in changed.items()
    }
    return written if mesh.sizes is None else {**written, "sizes": f"{file_stem(name)}{SUFFIX}"}


def _coupling_value(interface: Interface) -> TomlValue:
    form = "strong" if interface.coupling == "rigid" else "weak"
    return {"flexible": interface.flexible, "form": form}
