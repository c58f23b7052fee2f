"""Pictures of the machine for a report and for ``figures/``: drawn by a child process, because VTK
may end the one it runs in.
"""

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from headstock.app.pictures.picture import Picture, write_pictures
from headstock.app.pictures.scenes import list_machine_pictures, list_mode_pictures
from headstock.geometry.loading import OWN_FOLDER
from headstock.meshing.process.isolation import child_environment
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.views import MachineView
from headstock.pipeline.storage.store import Store, read_entry, write_entry

WORKER = "headstock.app.pictures.worker"
TIME_LIMIT = 120.0
RENDERER_FILES = ("picture.py", "scenes.py", "renderer.py")
GL_WINDOW = "VTK_DEFAULT_OPENGL_WINDOW"
REMEDY = "./headstock doctor tells what is missing"


@dataclass(frozen=True, eq=False)
class Drawing:
    """What a child drew: PNG files by name without suffix, and a remark for the user when something
    stood in the way.
    """

    images: dict[str, bytes]
    remark: str | None = None


@dataclass(frozen=True, eq=False)
class _StoredImages:
    """PNG files as the store keeps them."""

    images: dict[str, NDArray[np.int64]]


def draw_machine(view: MachineView, store: Store) -> Drawing:
    """A picture of the machine in each pose, from the store when nothing that is seen has changed.

    Args:
        view: What there is to draw.
        store: Where pictures are kept.
    """
    if not view.skins or not view.poses:
        return Drawing({})
    key = _view_key(view)
    kept = read_entry(store, key, _StoredImages).value
    if kept is not None:
        return Drawing(
            {name: image.astype(np.uint8).tobytes() for name, image in kept.images.items()}
        )
    drawing = draw_pictures(list_machine_pictures(view), "picture of the machine")
    if drawing.images and drawing.remark is None:
        write_entry(
            store,
            key,
            _StoredImages(
                {name: np.frombuffer(data, dtype=np.uint8) for name, data in drawing.images.items()}
            ),
        )
    return drawing


def draw_modes(run: Results) -> Drawing:
    """Draw the modes of each pose."""
    return draw_pictures(list_mode_pictures(run.modal, run.view), "pictures of modes")


def draw_charts(folder: Path) -> Drawing:
    """Draw every chart of a folder of results."""
    return _draw("charts", str(folder.resolve()), (), what="charts")


def draw_pictures(pictures: Sequence[Picture], what: str = "pictures") -> Drawing:
    """Draw pictures by name, and what to call them where they cannot be drawn."""
    if not pictures:
        return Drawing({})
    with _written(pictures) as source:
        return _draw("pictures", str(source), (source,), what=what)


def open_window(pictures: Sequence[Picture]) -> str | None:
    """Show pictures in a window until the user closes it; what went wrong, or None."""
    with _written(pictures) as source:
        return _run("window", str(source), 0, (source,))


@contextmanager
def _written(pictures: Sequence[Picture]) -> Iterator[int]:
    """Number of an open file with pictures, at its start."""
    with tempfile.TemporaryFile() as file:
        write_pictures(file, pictures)
        file.seek(0)
        yield file.fileno()


def _draw(kind: str, source: str, files: Sequence[int], *, what: str) -> Drawing:
    # without a name in the file system, so that nothing stays behind however this process ends
    with tempfile.TemporaryFile() as target:
        problem = _run(kind, source, target.fileno(), (*files, target.fileno()))
        if problem is not None:
            return Drawing({}, f"no {what}: {problem}")
        target.seek(0)
        with np.load(target, allow_pickle=False) as images:
            return Drawing({name: images[name].tobytes() for name in sorted(images.files)})


def stills_by_pose(view: MachineView, images: Mapping[str, bytes]) -> dict[str, bytes]:
    """The picture of the machine in each pose, as far as there is one."""
    named = {pose: f"machine_{file_stem(pose)}" for pose in view.poses}
    return {pose: images[name] for pose, name in named.items() if name in images}


def _run(kind: str, source: str, target: int, files: Sequence[int]) -> str | None:
    """Run a child to its end; what went wrong, or None.

    Args:
        source: Folder of results for charts, else number of an open file.
        target: Number of the open file that it writes to.
        files: Numbers of open files that it inherits.
    """
    environment = child_environment(WORKER) | {"OMP_NUM_THREADS": "1"}
    if kind == "window":
        environment.pop(GL_WINDOW, None)
    else:
        # also where there is a display: pictures are the same everywhere
        environment[GL_WINDOW] = "vtkEGLRenderWindow"
    command = [sys.executable, "-P", "-m", WORKER, kind, source, str(target)]
    try:
        child = subprocess.Popen(
            command,
            cwd=OWN_FOLDER,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
            pass_fds=files,
        )
    except OSError as error:
        return str(error)
    try:
        _, complaint = child.communicate(timeout=None if kind == "window" else TIME_LIMIT)
    except BaseException as error:
        os.killpg(child.pid, signal.SIGKILL)
        child.communicate()
        if isinstance(error, subprocess.TimeoutExpired):
            return f"it took more than {TIME_LIMIT:g} s"
        raise
    if child.returncode == 0:
        return None
    if b"Failed to load EGL" in complaint:
        return f"VTK finds no EGL library; {REMEDY}"
    lines = complaint.decode(errors="replace").strip().splitlines()
    if child.returncode < 0:
        name = signal.Signals(-child.returncode).name
        return f"VTK ended the process ({name}); {REMEDY}"
    return f"{lines[-1][:200] if lines else f'exit code {child.returncode}'}; {REMEDY}"


def _view_key(view: MachineView) -> str:
    digest = hashlib.sha256()
    for name in RENDERER_FILES:
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
