"""Pictures of the machine for a report and for ``figures/``: drawn by a child process, because VTK
may end the one it runs in.
"""

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.meshing.process.guarded import LAUNCHER_PREFIXES
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.views import MachineView
from headstock.pipeline.storage.store import Store, read_entry, write_entry

WORKER = "headstock.app.pictures.worker"
TIME_LIMIT = 120.0
PAINTER_FILES = ("scenes.py", "vtk.py", "png_images.py", "worker.py")
Wanted = Literal["machine", "all"]


@dataclass(frozen=True, eq=False)
class Drawing:
    """What a child drew: PNG files by name without suffix, and a remark for the user when something
    stood in the way.
    """

    images: dict[str, bytes]
    remark: str | None = None


@dataclass(frozen=True, eq=False)
class StoredImages:
    """PNG files as the store keeps them."""

    images: dict[str, NDArray[np.int64]]


def draw_machine(folder: Path, view: MachineView, store: Store) -> Drawing:
    """A picture of the machine in each pose, from the store when nothing that is seen has changed.

    Args:
        folder: Holds the results that the child reads.
        view: The same results.
        store: Where pictures are kept.
    """
    if not view.skins or not view.poses:
        return Drawing({})
    key = _view_key(view)
    kept = read_entry(store, key, StoredImages).value
    if kept is not None:
        return Drawing(
            {name: image.astype(np.uint8).tobytes() for name, image in kept.images.items()}
        )
    drawing = draw_pictures(folder, "machine")
    if drawing.images and drawing.remark is None:
        write_entry(
            store,
            key,
            StoredImages(
                {name: np.frombuffer(data, dtype=np.uint8) for name, data in drawing.images.items()}
            ),
        )
    return drawing


def draw_pictures(folder: Path, wanted: Wanted) -> Drawing:
    """Draw the machine, or the machine, its modes and every chart, of a folder of results."""
    remark = None
    for renderer, prefix in _renderers():
        # without a name in the file system, so that nothing stays behind however this process ends
        with tempfile.TemporaryFile() as target:
            command = [
                *prefix,
                sys.executable,
                "-P",
                "-m",
                WORKER,
                str(folder.resolve()),
                str(target.fileno()),
                renderer,
                wanted,
            ]
            problem = _run(command, target.fileno())
            if problem is None:
                target.seek(0)
                with np.load(target, allow_pickle=False) as images:
                    return Drawing(
                        {name: images[name].tobytes() for name in sorted(images.files)}, remark
                    )
        remark = f"VTK could not draw ({problem}): pictures are painted by matplotlib"
    return Drawing({}, f"no pictures were drawn: {problem}")


def stills_by_pose(view: MachineView, images: Mapping[str, bytes]) -> dict[str, bytes]:
    """The picture of the machine in each pose, as far as there is one."""
    named = {pose: f"machine_{file_stem(pose)}" for pose in view.poses}
    return {pose: images[name] for pose, name in named.items() if name in images}


def _renderers() -> Sequence[tuple[str, list[str]]]:
    return [("vtk", []), ("painted", [])]


def _run(command: list[str], target: int) -> str | None:
    """Run a command that writes to an open file to its end; what went wrong, or None."""
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(LAUNCHER_PREFIXES)
    }
    environment |= {
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
    }
    try:
        child = subprocess.Popen(
            command,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
            pass_fds=[target],
        )
    except OSError as error:
        return str(error)
    try:
        _, complaint = child.communicate(timeout=TIME_LIMIT)
    except BaseException as error:
        # the display server belongs to the same group
        os.killpg(child.pid, signal.SIGKILL)
        child.communicate()
        if isinstance(error, subprocess.TimeoutExpired):
            return f"it took more than {TIME_LIMIT:g} s"
        raise
    if child.returncode == 0:
        return None
    lines = complaint.decode(errors="replace").strip().splitlines()
    return lines[-1][:200] if lines else f"it ended with code {child.returncode}"


def _view_key(view: MachineView) -> str:
    digest = hashlib.sha256()
    for name in PAINTER_FILES:
        digest.update(Path(__file__).with_name(name).read_bytes())
    arrays = [np.array([])]
    for name, skin in view.skins.items():
        digest.update(f"{name}\0".encode())
        arrays += [skin.points, skin.triangles, skin.edges]
    for name, pose in view.poses.items():
        digest.update(f"{name}\0{'|'.join(pose.placements)}\0".encode())
        arrays += [
            np.column_stack([frame.origin, frame.rotation]) for frame in pose.placements.values()
        ]
        arrays += [joint.frame.origin for joint in pose.joints.values()]
        arrays += [point.tool_place for point in pose.points.values()]
    for array in arrays:
        digest.update(f"{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
