"""Journals of a sweep: finished poses, each appended whole, so that a sweep that was killed goes on
where it was.

Every process writes a journal of its own and reads those of all. A result is a line of JSON, then its
large arrays; no pickle.
"""

import contextlib
import fcntl
import json
import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.tool_travel import NO_FEED
from headstock.pipeline.storage.journals import Journal, JournalForm, read_journal
from headstock.pipeline.storage.outputs import TakenOutputError, make_part, read_growing_file
from headstock.pipeline.storage.records import RecordError
from headstock.pipeline.storage.typed_json import decode_value, dump_coded, encode_value

PoseState = Literal["done", "failed", "unreachable"]
SingleArray = NDArray[np.float32]
KINDS = ("<f8", "<f4")
# of a frequency response at a port to a load there [m/N, Hz, N/m]
FIGURES = (
    "most_negative_real",
    "most_negative_real_hz",
    "chatter_limit",
    "minimum_dynamic_stiffness",
    "minimum_dynamic_stiffness_hz",
)
LARGEST_HEAD = 1 << 20
_HEAD = struct.Struct("<I")
FOLDER = "poses"
SUFFIX = ".journal"
FLUSH_SECONDS = 1.0
KEY_LETTERS = 16
START = b"headstock poses "


@dataclass(frozen=True, eq=False)
class PoseResult:
    """Everything a sweep keeps of a pose.

    Attributes:
        positions: ``(k,)`` of the sweep's axes [m, rad].
        state: ``failed`` when anything asked for could not be computed; ``unreachable`` when a
            mechanism cannot take the pose.
        frequencies_hz: ``(m,)`` rising, a few more than asked for, so that modes can be followed
            from pose to pose.
        wanted: How many of them the scene asks for.
        rigid_count: How many of them are rigid-body modes.
        shapes: ``(d, m)`` mass-normalised, dofs of every component in its own axes.
        compliance: ``(p, 3, 3)`` of each point [m/N], machine axes.
        links: Part that gives most of the compliance in x, y, z at each point, ``3 p`` names, empty
            where nothing gives way.
        link_shares: ``(3 p,)`` its share.
        condition: ``(0 or 1,)`` condition number of a mechanism.
        figures: ``(q, f)`` of the frequency response, per input port and as ``FIGURES`` names them;
            NaN where there is none.
        feed: ``(3,)`` direction in which the tool is fed along a path, machine frame; NaN where
            nobody asks or it does not move across its axis.
        limits: ``(d, n)`` limit depth of cut by direction of travel and speed of the spindle [m].
        chatter_hz: ``(d,)`` frequency of chatter at the lowest limit; NaN where there is none.
        chatter_modes: ``d`` names of the mode behind it.
        limits_confirmed: Whether multipliers found the limits.
    """

    positions: FloatArray
    state: PoseState = "done"
    error: str = ""
    frequencies_hz: FloatArray = field(default_factory=lambda: np.zeros(0))
    wanted: int = 0
    rigid_count: int = 0
    shapes: SingleArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.float32))
    compliance: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    links: tuple[str, ...] = ()
    link_shares: FloatArray = field(default_factory=lambda: np.zeros(0))
    condition: FloatArray = field(default_factory=lambda: np.zeros(0))
    figures: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    feed: FloatArray = field(default_factory=NO_FEED.copy)
    limits: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    chatter_hz: FloatArray = field(default_factory=lambda: np.zeros(0))
    chatter_modes: tuple[str, ...] = ()
    limits_confirmed: bool = True

    @property
    def identity(self) -> bytes:
        """Pose and feed of the result as bytes."""
        return identify_pose(self.positions, self.feed)


def identify_pose(positions: FloatArray, feed: FloatArray) -> bytes:
    """A pose of a sweep among those in which the same is computed.

    Args:
        positions: ``(k,)`` [m, rad].
        feed: ``(3,)``; a path may go through a pose more than once.
    """
    return positions.tobytes() + feed.tobytes()


def encode_result(result: PoseResult) -> bytes:
    """Return a result as bytes that ``_decode_result`` reads back bit by bit: text, then large arrays."""
    blocks: list[bytes] = []

    def keep(array: NDArray[Any]) -> str:
        words = (array.dtype.str, sum(map(len, blocks)), *array.shape)
        blocks.append(array.tobytes())
        return " ".join(map(str, words))

    text = dump_coded(encode_value(result, keep))
    return b"".join([_HEAD.pack(len(text)), text, *blocks])


def _decode_result(content: bytes) -> PoseResult:
    """Return a result from its bytes.

    Raises:
        ValueError: They are no result, or one of another version.
    """

    def fetch(words: str) -> NDArray[Any]:
        kind, *numbers = words.split()
        place, *shape = map(int, numbers)
        if kind not in KINDS:
            raise ValueError(f"an array of {kind[:20]!r}")
        return np.frombuffer(content, kind, math.prod(shape), begin + place).reshape(shape)

    try:
        (length,) = _HEAD.unpack_from(content)
        begin = _HEAD.size + length
        if length > min(LARGEST_HEAD, len(content)):
            raise ValueError("its head is too long")
        coded = json.loads(content[_HEAD.size : begin])
        result = decode_value(coded, {PoseResult.__name__: PoseResult}, fetch)
    except (struct.error, RecordError) as error:
        raise ValueError(f"no pose result: {error}") from error
    if not isinstance(result, PoseResult):
        raise ValueError("no pose result")
    return result


def _pose_form(key: str) -> JournalForm:
    """Form of a journal of poses whose results depend on what the key says."""
    return JournalForm(START, START + f"1 {key}\n".encode())


def open_journal(folder: Path, key: str, name: str) -> Journal:
    """Open a journal for encoded results of poses, or begin it; a context manager.

    Args:
        folder: Of the sweep's results.
        key: Of everything the poses' results depend on.
        name: Of the process among those of the sweep.

    Raises:
        OutputError: It cannot be written, or another process writes it.
    """
    make_part(folder / FOLDER)
    path = folder / FOLDER / f"{key[:KEY_LETTERS]}-{name}{SUFFIX}"
    return Journal(path, _pose_form(key), flush_seconds=FLUSH_SECONDS)


def read_journals(folder: Path, key: str) -> dict[bytes, PoseResult]:
    """Finished poses by what identifies them; a pose that succeeded in one journal counts
    before one that failed.

    Raises:
        OutputError: A journal cannot be read, or is a file that Headstock did not write.
    """
    results: dict[bytes, PoseResult] = {}
    for path in sorted((folder / FOLDER).glob(f"{key[:KEY_LETTERS]}-*{SUFFIX}")):
        for record in read_journal(path, _pose_form(key)):
            with contextlib.suppress(ValueError):
                result = _decode_result(record)
                name = result.identity
                if name not in results or results[name].state == "failed":
                    results[name] = result
    return results


def remove_other_journals(folder: Path, key: str) -> None:
    """Remove journals of other contents that no living process writes."""
    make_part(folder / FOLDER)  # which is no link
    for path in (folder / FOLDER).glob(f"*{SUFFIX}"):
        if path.name.startswith(key[:KEY_LETTERS]):
            continue
        with contextlib.suppress(OSError, TakenOutputError):
            read_growing_file(path, START)
            with path.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink()
