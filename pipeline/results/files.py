"""The two files of a run that hold its numbers, ``results.h5`` and ``summary.json``: written
together, and read again; with the curves over frequency, along a path and over time that reports draw.
"""

import dataclasses
import functools
import hashlib
import importlib
import io
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from headstock.geometry.parts.components import Component
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.meshing.process.strangers import RESULTS, require_size
from headstock.meshing.size_files import SUFFIX, encode_sizes
from headstock.pipeline.numbers.folders import (
    FORMAT,
    RESULTS_FILE,
    SUMMARY_FILE,
    VERSION,
    naming_damage,
    read_results_file,
    read_summary,
)
from headstock.pipeline.planning.analyses import load_answer_types
from headstock.pipeline.planning.plan import Stage, StageRecord
from headstock.pipeline.results.grids import MESH_MODULE
from headstock.pipeline.results.mode_files import MODES_FOLDER, VOLUME_FOLDER, file_stem
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.pipeline.results.views import MachineView, pick_name
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import (
    PendingOutputs,
    UnusableOutputError,
    naming_output,
    replace_outputs,
)
from headstock.pipeline.storage.records import (
    RecordError,
    read_record,
    write_record,
    write_words,
)
from headstock.pipeline.storage.typed_json import (
    LARGE,
    AnyArray,
    decode_value,
    dump_coded,
    encode_value,
    find_fault,
    reachable_classes,
)

if TYPE_CHECKING:
    import pyvista


REPORT_FILE = "report.html"
TABLES_FOLDER, FIGURES_FOLDER, SIZES_FOLDER = "tables", "figures", "sizes"
PUBLISHED = (TABLES_FOLDER, FIGURES_FOLDER, MODES_FOLDER)  # folders beside the report
# pattern of the path of a data set to its unit; answers name those of their own
UNITS = {
    r"provenance/.*": "",
    r"labels|record/text|numbers/.*": "",
    r"view/.*/(edges|nodes|triangles|cells)": "",
    r"view/.*/(origin|tool_place|work_place)|view/skins/.*/points": "m",
    r"view/.*/rotation|view/axes/.*": "1",
    r"view/poses/.*/pushes/.*": "m/N",
    r"view/poses/.*/shifts/.*": "m/sqrt(kg)",
    r"joints/.*/stiffness": "SI: N and N m per m and rad",
}


def add_results(pending: PendingOutputs, folder: Path, results: Results) -> str:
    """Write ``results.h5``, to appear with the other pending files; one that the same command left
    there with the same content stays, with the times of that run.

    Args:
        pending: Files that appear together.

    Returns:
        SHA-256 of the file, by which a summary names the file it goes with.

    Raises:
        AccuracyError: A result is not a finite number.
        OutputError: The disk is full or the folder is gone.
    """
    content = _digest_content(results)
    if (digest := _find_same(folder / RESULTS_FILE, content)) is not None:
        return digest
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        file.attrs["content"] = content
        _fill(file, results)
    with naming_output(folder / RESULTS_FILE) as path:
        pending.add(path, image.getvalue())
    return hashlib.sha256(image.getbuffer()).hexdigest()


def _digest_content(results: Results) -> str:
    """Return a SHA-256 of what was found, in which stages and by what command: of all but times."""
    origin = results.provenance and dataclasses.replace(results.provenance, date="")
    plain = dataclasses.replace(results, stages=(), provenance=origin, volumes=None)
    stages = [(each.stage.kind, each.stage.component, each.stage.pose) for each in results.stages]

    def name_array(array: AnyArray) -> str:
        return str(_fingerprint(array))

    return hashlib.sha256(dump_coded(encode_value((plain, stages), name_array))).hexdigest()


def _find_same(path: Path, content: str) -> str | None:
    """Return the SHA-256 of a file of results with this content; None where there is none."""
    try:
        require_size(path, RESULTS, RecordError)
        image = path.read_bytes()
        with h5py.File(io.BytesIO(image), "r") as file:
            same = bool(file.attrs.get("content") == content)
    except (OSError, RecordError):
        return None
    return hashlib.sha256(image).hexdigest() if same else None


def publish_summary(pending: PendingOutputs, folder: Path, results: Results) -> None:
    """Write ``summary.json`` and let it appear, last, with the other pending files.

    Args:
        pending: Files that appear together.
        results: All that a run found, with the digest of ``results.h5``.

    Raises:
        AccuracyError: A result is not a finite number.
        OutputError: It cannot be written; all earlier files are then as they were.
    """
    with naming_output(folder / SUMMARY_FILE) as path:
        pending.add(path, dump_summary(summarise(results)).encode())
        pending.publish()


def _fill(file: "h5py.File", results: Results) -> None:
    file.attrs["format"] = FORMAT
    file.attrs["version"] = VERSION
    file.attrs["name"] = results.name
    for library, version in results.versions.items():
        file.require_group("versions").attrs[library] = version
    if results.provenance is not None:
        # no attribute: a limit of HDF5 keeps long ones out
        file["provenance/scene_text"] = np.bytes_(results.provenance.scene_text.encode() or b"\n")
        write_words(file["provenance"], results.provenance.summarise_for_export())
    for name, stiffness in results.joint_springs.items():
        file[f"joints/{name}/stiffness"] = stiffness
    if results.labels:
        file["labels"] = np.char.encode(np.array(results.labels), "utf-8")
    write_record(file.create_group("view", track_order=True), results.view)
    results.numbers.write(file.create_group("numbers"))
    units = dict(UNITS)
    for answer in results.answers:
        answer.fill(file)
        units |= answer.units
    _fill_record(file, results)
    mark_units(file, units)


def _fill_record(file: "h5py.File", results: Results) -> None:
    """Everything but the view once more as one text, for ``open_results``; arrays that are in the
    file are named in it.
    """
    known: dict[tuple[str, tuple[int, ...], bytes], str] = {}

    def remember(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset) and item.size > LARGE and not name.startswith("view/"):
            known[_fingerprint(item[()])] = name

    def keep(array: AnyArray) -> str:
        name = known.setdefault(_fingerprint(array), f"record/arrays/{len(known)}")
        if name not in file:
            file[name] = array
        return name

    file.visititems(remember)
    plain = dataclasses.replace(results, view=MachineView(), volumes=None)
    text = np.frombuffer(dump_coded(encode_value(plain, keep)), dtype=np.uint8)
    file.create_dataset("record/text", data=text, compression="gzip", compression_opts=4)


def _fingerprint(array: AnyArray) -> tuple[str, tuple[int, ...], bytes]:
    content = np.ascontiguousarray(array)
    return array.dtype.str, array.shape, hashlib.sha256(content).digest()


def mark_units(file: "h5py.File", units: Mapping[str, str]) -> None:
    """Give every data set the attribute ``unit``: ``1`` for numbers without one, empty for words
    and indices.

    Args:
        units: Pattern of whole paths to unit; the first that fits counts, and what none fits stays
            as it is.
    """

    def mark(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset):
            found = next(
                (unit for pattern, unit in units.items() if re.fullmatch(pattern, name)), None
            )
            if found is not None:
                item.attrs["unit"] = found

    file.visititems(mark)


def open_results(folder: Path) -> Results:
    """Everything a run found, from its folder; ``Results.mesh`` reads the ``.vtu`` files.

    Raises:
        UnusableOutputError: The files are missing, damaged, of another version or of different runs.
    """
    summary = read_summary(folder)

    def read(file: "h5py.File") -> Results:
        kinds = reachable_classes([Results, *load_answer_types()])
        coded = json.loads(file["record/text"][()].tobytes())
        found = decode_value(coded, kinds, lambda name: np.asarray(file[name][()]))
        if fault := find_fault(found, Results, "record/text"):
            raise RecordError(fault)
        return dataclasses.replace(
            cast(Results, found), view=read_record(file["view"], MachineView)
        )

    results = read_results_file(folder, read)
    with naming_damage(folder / SUMMARY_FILE):
        if fault := find_fault(summary["stages"], list[Mapping[str, object]], "stages"):
            raise RecordError(fault)
        # the stage that wrote the record cannot be in it
        last = [
            StageRecord(
                Stage(stage["stage"], stage["component"], stage["reason"], stage["pose"]),
                stage["seconds"],
                cached=stage["cached"],
                peak_rss_mb=stage["peak_rss_mb"],
                cpu_seconds=stage["cpu_seconds"],
            )
            for stage in summary["stages"][len(results.stages) :]
        ]
        files = {name: entry["sha256"] for name, entry in summary["files"].items()}
        if fault := find_fault(last, list[StageRecord], "stages"):
            raise RecordError(fault)
    return dataclasses.replace(
        results,
        stages=(*results.stages, *last),
        files=files,
        saved_mesh=functools.partial(read_mesh, folder),
    )


def read_view(folder: Path) -> MachineView:
    """Read what there is to draw from ``results.h5``.

    Raises:
        UnusableOutputError: The file is missing, damaged, of an earlier version or of another run than the
            summary.
    """
    return read_results_file(folder, lambda file: read_record(file["view"], MachineView))


def read_mesh(
    folder: str | Path, component: str, pose: str | None = None
) -> "pyvista.UnstructuredGrid":
    """A component from the files of a run, as ``Results.mesh`` has it: of ``volume/`` where it is
    there, else of ``modes/``.

    Args:
        pose: Name of a pose; the first where none is named.

    Raises:
        KeyError: There is no such component or pose; the message has those that are.
        UnusableOutputError: There are no results, or no mesh of the component.
    """
    if not isinstance(folder, str | Path):
        raise UnusableOutputError(f"{folder!r} is no folder of results; write a text or a Path")
    folder = Path(folder)
    view = read_view(folder)
    name = pick_name("component", component, view.skins)
    file = f"{file_stem(pick_name('pose', pose, view.poses))}.vtu"
    for part in (VOLUME_FOLDER, MODES_FOLDER):
        path = folder / part / file
        if path.is_file():
            mesh = importlib.import_module(MESH_MODULE).read_component(
                path, list(view.skins).index(name)
            )
            if mesh is not None:
                return mesh
    raise UnusableOutputError(
        f"{folder} has no mesh of {name!r} in {VOLUME_FOLDER}/{file} or {MODES_FOLDER}/{file};"
        " `headstock run SCENE --volume` writes them"
    )


def write_sizes(folder: Path, components: Mapping[str, Component]) -> list[str]:
    """Write the element sizes of meshes with varying sizes; return remarks.

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
