"""Channels of a test that look wrong, in sentences: nothing is mended."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from headstock.scene.test_data.records import TestChannel
from headstock.scene.test_data.responses import label_channel
from headstock.solvers.pairing.channel_faults import (
    ChannelFault,
    find_channel_faults,
    pair_despite_faults,
)
from headstock.solvers.pairing.mode_pairing import Field

LEAST_COLUMNS = 3  # with fewer shapes an accident looks like a fault


@dataclass(frozen=True)
class ChannelRemark:
    """Channels that look wrong.

    Attributes:
        text: How, and how much better the shapes agree then.
        rows: Of the channels.
    """

    text: str
    rows: tuple[int, ...]


def describe_channel_faults(
    measured: Field, computed: Field, channels: Sequence[TestChannel]
) -> tuple[ChannelRemark, ...]:
    """Say which channels look turned, swapped, shifted, reversed, dead or badly scaled, the one that
    explains most first.

    Args:
        measured: ``(c, k)`` shapes.
        computed: ``(c, m)`` shapes, in any order.
    """
    sensors: defaultdict[str, list[int]] = defaultdict(list)
    for row, channel in enumerate(channels):
        sensors[channel.point].append(row)
    numbered = sorted(sensors, key=lambda name: (not name.isdecimal(), len(name), name))
    rows = [sensors[name] for name in numbered]
    first, second = pair_despite_faults(measured, computed, rows)
    if len(first) < LEAST_COLUMNS:
        return ()
    faults = find_channel_faults(measured[:, first], computed[:, second], rows)
    columns = len(first)
    return tuple(ChannelRemark(_describe(fault, channels, columns), fault.rows) for fault in faults)


def _describe(fault: ChannelFault, channels: Sequence[TestChannel], columns: int) -> str:
    text = _name(fault, channels)
    others = "".join(f", or {_name(rival, channels)}" for rival in fault.rivals)
    before, after = fault.mac
    return f"{text}{others}: MAC of {columns} modes rises from {before:.3f} to {after:.3f}; check its mounting, cable and name"


def _name(fault: ChannelFault, channels: Sequence[TestChannel]) -> str:
    rows = [channels[row] for row in fault.rows]
    names = [label_channel(row).partition(":")[2].removeprefix("+") for row in rows]
    points = list(dict.fromkeys(row.point for row in rows))
    sources = [
        ("-" if sign < 0 else "")
        + label_channel(channels[source]).partition(":")[2].removeprefix("+")
        for source, sign in zip(fault.sources, fault.signs, strict=True)
    ]
    first, last = points[0], points[-1]
    match fault.kind:
        case "exchanged":
            return f"sensor {first}: {names[0]} and {names[1]} look exchanged"
        case "reversed":
            verb = "looks" if len(names) == 1 else "look"
            return f"sensor {first}: {' and '.join(names)} {verb} reversed"
        case "turned":
            recorded = ", ".join(source.replace("--", "") for source in sources)
            return f"sensor {first} looks turned: its {', '.join(names)} are recorded as {recorded}"
        case "swapped sensors":
            return f"sensors {first} and {last} look swapped"
        case "swapped channels":
            return f"{' and '.join(map(label_channel, rows))} look swapped"
        case "shifted":
            onward = channels[fault.sources[0]].point == points[1]
            neighbour = "next one" if onward else "one before"
            return f"sensors {first} to {last} look shifted: each is recorded under the number of the {neighbour}"
        case "dead":
            return f"{label_channel(rows[0])} looks dead"
        case "scaled":
            return (
                f"{label_channel(rows[0])} looks {fault.factor:.3g} times too large"
                if fault.factor > 1
                else (f"{label_channel(rows[0])} looks {1 / fault.factor:.3g} times too small")
            )
