"""The quantities of a sweep that are mapped, as lists over its poses, and as a table."""

from collections import Counter
from dataclasses import dataclass

from headstock.app.tables.table import PlainTable
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.lobes import MM
from headstock.pipeline.answers.static import UM_PER_KN
from headstock.pipeline.storage.json_texts import find_known
from headstock.studies.sweeps.results import PointMap, SweepResults

FIGURE_TITLES = {
    "minimum_dynamic_stiffness_N_per_um": ("minimum dynamic stiffness", "N/µm"),
    "minimum_dynamic_stiffness_hz": ("frequency of the minimum dynamic stiffness", "Hz"),
    "chatter_limit_N_per_um": ("chatter limit -1/(2 Re)", "N/µm"),
}

# ends of names and titles of what lobes say of each pose
LIMIT_TITLES: tuple[tuple[str, str, str, str], ...] = (
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


def list_swept(results: SweepResults) -> list[Quantity]:
    """Return frequencies of tracked modes, compliances, condition number, figures of frequency
    responses and limits of cuts.
    """
    quantities = [
        Quantity(f"mode_{number}", f"mode {number}", "Hz", values)
        for number, values in enumerate(results.frequencies_hz.T, start=1)
    ]
    for point, found in results.points.items():
        quantities += _list_compliances(point, found)
    if results.condition is not None:
        quantities.append(Quantity("condition_number", "condition number", "", results.condition))
    for channel, figures in results.responses.items():
        stem = f"frf_{channel.replace(' ', '_')}"
        quantities += [
            Quantity(f"{stem}_{key}", f"{title} at {channel}", unit, figures[key])
            for key, (title, unit) in FIGURE_TITLES.items()
        ]
    for name, limits in results.limits.items():
        figures = limits.figures
        quantities += [
            Quantity(f"lobes_{name}_{stem}", f"{title}, travel {name}", unit, figures[key])
            for stem, key, title, unit in LIMIT_TITLES
        ]
    return quantities


def _list_compliances(point: str, found: PointMap) -> list[Quantity]:
    matrix = UM_PER_KN * found.compliance
    values = {
        **{axis: (f"compliance {axis}", matrix[:, i, i]) for i, axis in enumerate(DIRECTIONS)},
        "largest": ("largest compliance", UM_PER_KN * found.largest),
    }
    stem, ratio = f"compliance_{point}", f"largest over smallest compliance at {point}"
    return [
        *(
            Quantity(f"{stem}_{name}", f"{title} at {point}", "µm/kN", sizes)
            for name, (title, sizes) in values.items()
        ),
        Quantity(f"{stem}_ratio", ratio, "", found.ratio),
    ]


def limit_words(results: SweepResults) -> list[str]:
    """Say what is stable in every pose, which modes limit it, and whether limits are confirmed; empty
    without lobes.
    """
    words = []
    for name, limits in results.limits.items():
        best = limits.common_best
        if best is None:
            continue
        modes = Counter(mode for mode in limits.modes if mode)
        often = ", ".join(f"{mode} ({count})" for mode, count in modes.most_common(3))
        # a better speed may lie beyond the end of the range
        at_end = limits.rpm[best] in limits.rpm[[0, -1]]
        end = (
            ", where the speeds asked for end: a deeper cut may be stable beyond" if at_end else ""
        )
        words.append(
            f"travel {name}: {MM * limits.everywhere[best]:.3g} mm are stable in every pose at {limits.rpm[best]:.0f} rpm"
            f"{end}; modes behind the lowest limits (poses): {often}"
        )
    if words and not results.limits_confirmed:
        words.append(
            "limits are those of a single frequency (the tool's receptance is measured); nothing confirms them"
        )
    return words


def tabulate_sweep(results: SweepResults) -> PlainTable:
    """Tabulate a row per pose: its positions in SI, its state, every quantity with its unit in the head, and
    what gives most at each point.
    """
    quantities, sweep = list_swept(results), results.sweep
    labels = sweep.labels or [""] * len(sweep.positions)
    places: list[list[float]] = [[*map(float, row)] for row in sweep.positions]
    axes = [f"{axis} [{unit}]" for axis, unit in zip(sweep.axes, sweep.units, strict=True)]
    names = [
        f"{quantity.name} [{quantity.unit.replace('µ', 'u')}]" if quantity.unit else quantity.name
        for quantity in quantities
    ]
    weakest = [f"weakest {axis} at {name}" for name in results.points for axis in DIRECTIONS]
    rows = tuple(
        (
            number + 1,
            label or None,
            *positions,
            results.states[number],
            *(find_known(quantity.values[number]) for quantity in quantities),
            *(part or None for point in results.points.values() for part in point.links[number]),
            results.errors[number] or None,
        )
        for number, (positions, label) in enumerate(zip(places, labels, strict=True))
    )
    heads = ("pose", "name", *axes, "state", *names, *weakest, "error")
    return PlainTable("sweep", heads, rows)


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


def sampled_error_words(results: SweepResults) -> list[str]:
    """In which poses errors were estimated, and what is not in them; empty where there are none."""
    words, sweep = [], results.sweep
    for sample in results.pose_errors:
        place = ", ".join(
            f"{axis} {show_position(value, unit)}"
            for axis, value, unit in zip(
                sweep.axes, sweep.positions[sample.pose].tolist(), sweep.units, strict=True
            )
        )
        plural = "s" if len(sample.modes) > 1 else ""
        what = [f"mode{plural} {_list_numbers([*sample.modes])}"] * any(
            size is not None for size in sample.modes.values()
        )
        what += ["compliances"] * any(
            size is not None for errors in sample.compliances.values() for size in errors.values()
        )
        left = f"; not in ±: {'; '.join(sample.left_out)}" if sample.left_out else ""
        if what:
            words.append(
                f"± of {' and '.join(what)} covers 95 % of errors in pose {place}, and was estimated in no other{left}"
            )
        elif left:
            words.append(f"no ± in pose {place}{left}")
    return words
