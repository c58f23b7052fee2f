"""What a sweep finds in one pose, and its form in a journal: a line of JSON about arrays, then the arrays; no pickle."""

import dataclasses
import json
import math
import struct
import typing
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray

PoseState = Literal["done", "failed", "unreachable"]
SingleArray = NDArray[np.float32]
KINDS = ("<f8", "<f4")
# of a frequency response at a port to a load there [m/N, Hz, N/m]
FIGURES = ("worst_real", "worst_real_hz", "chatter_stiffness", "softest", "softest_hz")
LARGEST_HEAD = 1 << 20
_HEAD = struct.Struct("<I")


@dataclass(frozen=True, eq=False)
class PoseResult:
    """Everything a sweep keeps of a pose.

    Attributes:
        positions: ``(k,)`` of the sweep's axes [m, rad].
        state: ``failed`` when anything asked for could not be computed; ``unreachable`` when a mechanism cannot take the pose.
        error: Why.
        frequencies_hz: ``(m,)`` rising, a few more than asked for, so that modes can be followed from pose to pose.
        wanted: How many of them the scene asks for.
        rigid_count: How many of them are rigid-body modes.
        shapes: ``(d, m)`` mass-normalised, dofs of every component in its own axes.
        compliance: ``(p, 3, 3)`` of each point [m/N], machine axes.
        links: Part that gives most of the compliance in x, y, z at each point, ``3 p`` names, empty where nothing gives way.
        link_shares: ``(3 p,)`` its share.
        condition: ``(0 or 1,)`` condition number of a mechanism.
        figures: ``(q, f)`` of the frequency response, per input port and as ``FIGURES`` names them; NaN where there is none.
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


def encode_result(result: PoseResult) -> bytes:
    """A result as bytes that ``decode_result`` reads back bit by bit."""
    head: dict[str, Any] = {}
    blocks: list[bytes] = []
    for item in dataclasses.fields(result):
        value = getattr(result, item.name)
        if isinstance(value, np.ndarray):
            kind = "<f4" if value.dtype == np.float32 else "<f8"
            blocks.append(np.ascontiguousarray(value, dtype=kind).tobytes())
            value = [kind, *value.shape]
        head[item.name] = value
    text = json.dumps(head, ensure_ascii=False, separators=(",", ":")).encode()
    return b"".join([_HEAD.pack(len(text)), text, *blocks])


def decode_result(content: bytes) -> PoseResult:
    """A result from its bytes.

    Raises:
        ValueError: They are no result, or one of another version.
    """
    try:
        (length,) = _HEAD.unpack_from(content)
        if length > min(LARGEST_HEAD, len(content)):
            raise ValueError("its head is too long")
        head = json.loads(content[_HEAD.size : _HEAD.size + length])
        place = _HEAD.size + length
        values: dict[str, Any] = {}
        for name, hint in typing.get_type_hints(PoseResult).items():
            value = head[name]
            if isinstance(value, list) and value[:1] and value[0] in KINDS and hint is not tuple[str, ...]:
                kind, *shape = value
                count = math.prod(shape)
                value = np.frombuffer(content, dtype=kind, count=count, offset=place).reshape(shape)
                place += count * np.dtype(kind).itemsize
            values[name] = tuple(value) if isinstance(value, list) else value
        return PoseResult(**values)
    except (struct.error, KeyError, TypeError, AttributeError, UnicodeDecodeError) as error:
        raise ValueError(f"no pose result: {error}") from error
