"""Channels of a test that look wrong, in sentences: nothing is mended."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.scene.test_data.records import TestChannel
from headstock.scene.test_data.responses import label_channel
from headstock.solvers.pairing.channel_faults import ChannelFault, Kind, find_channel_faults
from headstock.solvers.pairing.mode_pairing import Field

LEAST_COLUMNS = 3  # with fewer shapes an accident looks like a fault


@dataclass(frozen=True)
class _ChannelRemark:
    """Channels that look wrong.

    Attributes:
        text: How, and how much better the shapes agree then.
        rows: Numbers of the channels among those of the test, from 0.
    """

    text: str
    rows: tuple[int, ...]


def describe_channel_faults(
    measured: Field, computed: Field, channels: Sequence[TestChannel]
) -> tuple[_ChannelRemark, ...]:
    """Say which channels look turned, swapped, shifted, reversed, dead or badly scaled, the one that
    explains most first; nothing by few shapes.

    Args:
        measured: ``(c, k)`` shapes.
        computed: ``(c, k)`` their partners.
    """
    columns = measured.shape[1]
    if columns < LEAST_COLUMNS:
        return ()
    sensors: defaultdict[str, list[int]] = defaultdict(list)
    for row, channel in enumerate(channels):
        sensors[channel.point].append(row)
    numbered = sorted(sensors, key=lambda name: (not name.isdecimal(), len(name), name))
    rows = [sensors[name] for name in numbered]
    remarks = []
    for fault in find_channel_faults(measured, computed, rows):
        names = ", or ".join(_name(one, channels) for one in (fault, *fault.rivals))
        before, after = fault.mac
        text = f"{names}: MAC of {columns} modes rises from {before:.3f} to {after:.3f}; check its mounting, cable and name"
        remarks.append(_ChannelRemark(text, fault.rows))
    return tuple(remarks)


def _name(fault: ChannelFault, channels: Sequence[TestChannel]) -> str:
    rows = [channels[row] for row in fault.rows]
    labels = [label_channel(row) for row in rows]
    names = [_name_direction(row) for row in rows]
    points = list(dict.fromkeys(row.point for row in rows))
    first, last = points[0], points[-1]
    recorded = [
        ("-" * (sign < 0) + _name_direction(channels[source])).replace("--", "")
        for source, sign in zip(fault.sources, fault.signs, strict=True)
    ]
    onward = channels[fault.sources[0]].point in points[1:2]
    large = fault.factor > 1.0
    size = fault.factor if large else 1.0 / max(fault.factor, np.finfo(float).tiny)
    texts: dict[Kind, str] = {
        "exchanged": f"sensor {first}: {names[0]} and {names[-1]} look exchanged",
        "reversed": f"sensor {first}: {' and '.join(names)} look{'s' * (len(names) == 1)} reversed",
        "turned": f"sensor {first} looks turned: its {', '.join(names)} are recorded as {', '.join(recorded)}",
        "swapped sensors": f"sensors {first} and {last} look swapped",
        "swapped channels": f"{' and '.join(labels)} look swapped",
        "shifted": f"sensors {first} to {last} look shifted: each is recorded under the number of the "
        + ("next one" if onward else "one before"),
        "dead": f"{labels[0]} looks dead",
        "scaled": f"{labels[0]} looks {size:.3g} times too {'large' if large else 'small'}",
    }
    return texts[fault.kind]


def _name_direction(channel: TestChannel) -> str:
    return label_channel(channel).partition(":")[2].removeprefix("+")
