"""The quantities of a sweep that are mapped, as lists over its poses, and as a table."""

from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np

from headstock.app.tables.table import PlainTable
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import show_position
from headstock.studies.sweeps.files import LimitMapSummary, Numbers, PointMapSummary, SweepSummary

type LimitKey = Literal[
    "lowest_mm", "lowest_rpm", "best_mm", "best_rpm", "at_common_best_mm", "chatter_hz"
]

FIGURE_TITLES = {
    "minimum_dynamic_stiffness_N_per_um": ("minimum dynamic stiffness", "N/µm"),
    "minimum_dynamic_stiffness_hz": ("frequency of the minimum dynamic stiffness", "Hz"),
    "chatter_limit_N_per_um": ("chatter limit -1/(2 Re)", "N/µm"),
}

# ends of names and titles of what lobes say of each pose
LIMIT_TITLES: tuple[tuple[str, LimitKey, str, str], ...] = (
    ("lowest", "lowest_mm", "lowest limit depth", "mm"),
    ("lowest_speed", "lowest_rpm", "speed of the lowest limit", "rpm"),
    ("best", "best_mm", "deepest limit", "mm"),
    ("best_speed", "best_rpm", "best speed", "rpm"),
    ("at_common_best", "at_common_best_mm", "limit at the best speed of all poses", "mm"),
    ("chatter", "chatter_hz", "chatter at the lowest limit", "Hz"),
)


@dataclass(frozen=True, eq=False)
class Quantity:
    """What is mapped.

    Attributes:
        unit: Empty without one.
        values: ``(n,)``, NaN where there is none.
    """

    name: str
    title: str
    unit: str
    values: FloatArray


def list_swept(summary: SweepSummary) -> list[Quantity]:
    """Return frequencies of tracked modes, compliances, condition number, figures of frequency
    responses and limits of cuts.
    """
    condition = summary["condition_number"]
    quantities = [
        *(
            Quantity(f"mode_{number}", f"mode {number}", "Hz", values)
            for number, values in enumerate(_columns(summary), start=1)
        ),
        *(
            quantity
            for point, entry in summary["static"].items()
            for quantity in _list_compliances(point, entry)
        ),
        *(
            []
            if condition is None
            else [_fill("condition_number", "condition number", "", condition)]
        ),
    ]
    for channel, figures in summary["frf"].items():
        stem = f"frf_{channel.replace(' ', '_')}"
        quantities += [
            _fill(f"{stem}_{key}", f"{title} at {channel}", unit, figures[key])
            for key, (title, unit) in FIGURE_TITLES.items()
        ]
    for name, limits in summary["lobes"].items():
        quantities += [
            _fill(f"lobes_{name}_{stem}", f"{title}, travel {name}", unit, limits[key])
            for stem, key, title, unit in LIMIT_TITLES
        ]
    return quantities


def _list_compliances(point: str, entry: PointMapSummary) -> list[Quantity]:
    stem, matrix = f"compliance_{point}", np.array(entry["compliance_um_per_kN"], dtype=float)
    return [
        *(
            Quantity(f"{stem}_{axis}", f"compliance {axis} at {point}", "µm/kN", values)
            for axis, values in zip(
                DIRECTIONS, matrix.reshape(-1, 3, 3).diagonal(axis1=1, axis2=2).T, strict=True
            )
        ),
        _fill(
            f"{stem}_largest", f"largest compliance at {point}", "µm/kN", entry["largest_um_per_kN"]
        ),
        _fill(f"{stem}_ratio", f"largest over smallest compliance at {point}", "", entry["ratio"]),
    ]


def _fill(name: str, title: str, unit: str, values: Numbers) -> Quantity:
    return Quantity(name, title, unit, np.array(values, dtype=float))


def limit_words(summary: SweepSummary) -> list[str]:
    """Say what is stable in every pose, which modes limit it, and whether limits are confirmed; empty
    without lobes.
    """
    words = []
    for name, limits in summary["lobes"].items():
        if limits["common_best_mm"] is None:
            continue
        modes = Counter(mode for mode in limits["modes"] if mode)
        often = ", ".join(f"{mode} ({count})" for mode, count in modes.most_common(3))
        words.append(
            f"travel {name}: {limits['common_best_mm']:.3g} mm are stable in every pose at {limits['common_best_rpm']:.0f} rpm"
            f"{_end_of_range(limits)}; modes behind the lowest limits (poses): {often}"
        )
    if words and not summary["limits_confirmed"]:
        words.append(
            "limits are those of a single frequency (the tool's receptance is measured); nothing confirms them"
        )
    return words


def _end_of_range(limits: LimitMapSummary) -> str:
    """That the best speed is where the range of speeds ends, so that a better one may lie beyond."""
    if limits["common_best_rpm"] not in np.array(limits["rpm"], dtype=float)[[0, -1]]:
        return ""
    return ", where the speeds asked for end: a deeper cut may be stable beyond"


def tabulate_sweep(summary: SweepSummary) -> PlainTable:
    """Tabulate a row per pose: its positions in SI, its state, every quantity with its unit in the head, and
    what gives most at each point.
    """
    quantities = list_swept(summary)
    labels = summary["labels"] or [""] * len(summary["positions"])
    axes = [
        f"{axis} [{unit}]" for axis, unit in zip(summary["axes"], summary["units"], strict=True)
    ]
    names = [
        f"{quantity.name} [{quantity.unit.replace('µ', 'u')}]" if quantity.unit else quantity.name
        for quantity in quantities
    ]
    weakest = [
        (f"weakest {axis} at {name}", point["weakest"])
        for name, point in summary["static"].items()
        for axis in "xyz"
    ]
    rows = []
    for number, (positions, label, state) in enumerate(
        zip(summary["positions"], labels, summary["states"], strict=True)
    ):
        values = [
            float(quantity.values[number]) if np.isfinite(quantity.values[number]) else None
            for quantity in quantities
        ]
        links = [links[number][place % 3] or None for place, (_, links) in enumerate(weakest)]
        rows.append(
            (
                number + 1,
                label or None,
                *positions,
                state,
                *values,
                *links,
                summary["errors"].get(str(number)),
            )
        )
    heads = ("pose", "name", *axes, "state", *names, *(heading for heading, _ in weakest), "error")
    return PlainTable("sweep", heads, tuple(rows))


def _columns(summary: SweepSummary) -> list[FloatArray]:
    table = np.array(summary["frequencies_hz"], dtype=float)
    return list(table.T) if table.ndim == 2 else []


def _list_numbers(numbers: list[int]) -> str:
    """Ascending numbers, three or more in a row as a range: ``1 to 6, 9``."""
    rows: list[list[int]] = []
    for number in numbers:
        if rows and number == rows[-1][-1] + 1:
            rows[-1].append(number)
        else:
            rows.append([number])
    return ", ".join(
        f"{row[0]} to {row[-1]}" if len(row) > 2 else ", ".join(map(str, row)) for row in rows
    )


def sampled_error_words(summary: SweepSummary) -> list[str]:
    """In which poses errors were estimated, and what is not in them; empty where there are none."""
    words = []
    for sample in summary["sampled_errors"]:
        place = ", ".join(
            f"{axis} {show_position(value, unit)}"
            for axis, value, unit in zip(
                summary["axes"], summary["positions"][sample["pose"]], summary["units"], strict=True
            )
        )
        modes = sample["error_hz"]
        plural = "s" if len(modes) > 1 else ""
        what = [f"mode{plural} {_list_numbers(list(map(int, modes)))}"] * any(
            size is not None for size in modes.values()
        )
        points = sample["error_um_per_kN"]
        what += ["compliances"] * any(
            size is not None for errors in points.values() for size in errors.values()
        )
        left = (
            f"; not in ±: {'; '.join(sample['error_left_out'])}" if sample["error_left_out"] else ""
        )
        if what:
            words.append(
                f"± of {' and '.join(what)} covers 95 % of errors in pose {place}, and was estimated in no other{left}"
            )
        elif left:
            words.append(f"no ± in pose {place}{left}")
    return words
