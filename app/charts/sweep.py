"""Maps and curves of a sweep as images, by matplotlib."""

import functools
from collections.abc import Callable, Mapping

import numpy as np

from headstock.app.charts.charts import (
    DPI,
    INK,
    calm_axes,
    encode_figure,
    label_axes,
    line_style,
    new_figure,
)
from headstock.app.pictures.libraries import Figure
from headstock.app.tables.sweep_quantities import Quantity, list_swept
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import SCENE_UNITS
from headstock.pipeline.answers.lobes import MM
from headstock.pipeline.results.views import COLORS
from headstock.scene.studies import Sweep
from headstock.studies.sweeps.results import LimitMap, SweepResults

PER_ROW = 3
FIELD_INCHES = (4.0, 3.5)
# left, bottom, width, height of a field's map and of its colours, in fields
MAP_SHARE, BAR_SHARE = (0.14, 0.13, 0.68, 0.79), (0.84, 0.13, 0.03, 0.79)
FAMILIES = {"mode": "modes", "lobes": "lobes"}  # by how names of quantities begin
MANY = 60  # poses that need no markers
LEGEND_LINES = 20  # beside a chart
DEEPEST_SHOWN = (
    95  # percentile of limits at which colours end: few deep pockets do not flatten lobes
)


def draw_sweep(results: SweepResults, share: slice = slice(None)) -> dict[str, bytes]:
    """Pictures of a sweep by name: maps over a plane, curves along one axis or a way; a volume in
    its middle planes; limit depths of cut over speeds and poses.
    """
    families: dict[str, list[Quantity]] = {"modes": [], "stiffness": [], "lobes": []}
    for quantity in list_swept(results):
        if np.isfinite(quantity.values).any():
            family = quantity.name.partition("_")[0]
            families[FAMILIES.get(family, "stiffness")].append(quantity)
    moving = [axis for axis, count in enumerate(results.sweep.shape) if count > 1]
    plane = results.sweep.kind == "grid" and len(moving) >= 2
    maps = functools.partial(_draw_maps, axes=moving[:2])
    draw: Callable[..., bytes] = maps if plane else _draw_curves
    pictures: dict[str, Callable[[], bytes]] = {
        name: functools.partial(draw, results.sweep, members)
        for name, members in families.items()
        if members
    }
    if results.limits:
        pictures["limits"] = functools.partial(_draw_limits, results.sweep, results.limits)
        pictures["common_limits"] = functools.partial(_draw_common, results.limits)
    return {name: picture() for name, picture in list(pictures.items())[share]}


def _draw_limits(sweep: Sweep, limits: Mapping[str, LimitMap]) -> bytes:
    """Limit depth over speed and pose, a field for each direction: a dot at the best speed of each
    pose, a line at the speed whose limit is deepest in the worst pose.
    """
    figure = new_figure(10.0, 0.4 + 3.6 * len(limits))
    places, label = _way_of(sweep)
    for number, (name, found) in enumerate(limits.items(), start=1):
        frame = figure.add_subplot(len(limits), 1, number)
        depths, best = MM * found.depths, found.common_best
        mesh = frame.pcolormesh(
            found.rpm,
            places,
            depths,
            vmin=0.0,
            vmax=float(np.nanpercentile(depths, DEEPEST_SHOWN)) if np.isfinite(depths).any() else 1,
            shading="nearest",
            rasterized=True,
        )
        frame.patch.set(hatch="////", edgecolor="#8c9bab")  # where no limit was looked for
        bar = figure.colorbar(mesh, ax=frame, extend="max")
        bar.ax.tick_params(labelsize=7)
        frame.scatter(
            found.figures["best_rpm"],
            places,
            s=14 if len(places) < MANY else 3,
            color="white",
            edgecolors=INK,
            linewidths=0.5 if len(places) < MANY else 0.2,
            clip_on=False,
            label="best speed of each pose",
        )
        if best is not None:
            frame.axvline(
                float(found.rpm[best]),
                color=COLORS[1],
                linestyle="--",
                linewidth=1.6,
                label=f"best over all poses: {MM * found.everywhere[best]:.3g} mm at {found.rpm[best]:.0f} rpm",
            )
        label_axes(frame, title=f"Limit depth of cut [mm], travel {name}")
        frame.legend(
            fontsize=7,
            frameon=False,
            ncols=2,
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            borderaxespad=0.0,
        )
        label_axes(frame, x="speed of the spindle [rpm]", y=label)
        frame.tick_params(labelsize=7)
    return encode_figure(figure)


def _draw_common(limits: Mapping[str, LimitMap]) -> bytes:
    """Depth of cut that is stable in every pose, over the speed, a line for each direction."""
    figure = new_figure(10.0, 3.6)
    frame = figure.add_subplot(1, 1, 1)
    for number, (name, found) in enumerate(limits.items()):
        frame.plot(
            found.rpm,
            MM * found.everywhere,
            linewidth=1.6,
            label=f"travel {name}",
            **line_style(number, COLORS),
        )
    frame.set_ylim(bottom=0.0)
    label_axes(
        frame,
        title="Depth of cut that is stable in every pose",
        x="speed of the spindle [rpm]",
        y="[mm]",
    )
    frame.legend(fontsize=7, frameon=False)
    calm_axes(frame)
    return encode_figure(figure)


def _middle_plane(sweep: Sweep, values: FloatArray, axes: list[int]) -> FloatArray:
    """Values ``(n0, n1)`` over two axes of a grid, the others in their middle.

    Args:
        values: Over its poses ``(n,)``.
    """
    table = values.reshape(sweep.shape)
    place = tuple(
        slice(None) if axis in axes else count // 2 for axis, count in enumerate(sweep.shape)
    )
    return np.asarray(table[place])


def _draw_maps(sweep: Sweep, quantities: list[Quantity], axes: list[int]) -> bytes:
    rows, columns = -(-len(quantities) // PER_ROW), min(PER_ROW, len(quantities))
    # fields of one size at places of their own: to measure every label takes longer than to draw all
    wide, high = FIELD_INCHES
    figure = Figure(figsize=(wide * columns, high * rows), dpi=DPI)
    spans = []
    for axis in axes:
        factor, word = SCENE_UNITS[sweep.units[axis]]
        spans.append((factor * np.unique(sweep.positions[:, axis]), f"{sweep.axes[axis]} [{word}]"))
    for number, quantity in enumerate(quantities):
        frame, beside = (
            figure.add_axes(
                (
                    (number % columns + left) / columns,
                    (rows - 1 - number // columns + bottom) / rows,
                    width / columns,
                    height / rows,
                )
            )
            for left, bottom, width, height in (MAP_SHARE, BAR_SHARE)
        )
        mesh = frame.pcolormesh(
            spans[0][0],
            spans[1][0],
            _middle_plane(sweep, quantity.values, axes).T,
            shading="nearest",
        )
        bar = figure.colorbar(mesh, cax=beside)
        bar.ax.tick_params(labelsize=7)
        # the numbers themselves, no "+1.108" in a corner
        bar.ax.ticklabel_format(axis="y", useOffset=False)
        label_axes(frame, title=f"{quantity.title}{f' [{quantity.unit}]' if quantity.unit else ''}")
        frame.set_xlabel(spans[0][1], fontsize=8)
        frame.set_ylabel(spans[1][1], fontsize=8)
        frame.tick_params(labelsize=7)
    return encode_figure(figure)


def _draw_curves(sweep: Sweep, quantities: list[Quantity]) -> bytes:
    places, label = _way_of(sweep)
    units = list(dict.fromkeys(quantity.unit for quantity in quantities))
    figure = new_figure(10.0, 0.4 + 3.6 * len(units))
    for number, unit in enumerate(units, start=1):
        frame = figure.add_subplot(len(units), 1, number)
        own = [quantity for quantity in quantities if quantity.unit == unit]
        marker = "." if len(places) < MANY else ""
        for place, quantity in enumerate(own):
            style = line_style(place, COLORS)
            frame.plot(
                places, quantity.values, marker=marker, linewidth=1.4, label=quantity.title, **style
            )
        columns = -(-len(own) // LEGEND_LINES)
        frame.legend(
            fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, ncols=columns
        )
        frame.ticklabel_format(axis="y", useOffset=False)
        label_axes(frame, x=label, y=f"[{unit}]" if unit else "")
        calm_axes(frame)
    return encode_figure(figure)


def _way_of(sweep: Sweep) -> tuple[FloatArray, str]:
    """Return where poses are along a sweep ``(n,)``, and what to write below: the axis that moves,
    or the number of the pose.
    """
    positions = sweep.positions
    moving = [axis for axis in range(positions.shape[1]) if np.ptp(positions[:, axis]) > 0.0]
    if len(moving) == 1 and bool((np.diff(positions[:, moving[0]]) > 0.0).all()):
        factor, word = SCENE_UNITS[sweep.units[moving[0]]]
        return factor * positions[:, moving[0]], f"{sweep.axes[moving[0]]} [{word}]"
    return np.arange(1, len(positions) + 1, dtype=np.float64), "pose"
