"""Maps of the report: a coloured field per quantity as SVG, its cells one small embedded picture; of a volume a few layers."""

import base64
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from headstock.app.pictures.png_images import encode_png
from headstock.app.report import svg
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.results.map import MapSummary

WIDTH, LEFT, TOP, BOTTOM = 340, 56, 22, 34
# five stops of viridis, told apart by most colour-blind readers and in grey
STOPS = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], dtype=float)
TITLES = {
    "condition_number": "condition number",
    "mean_leg_m": "mean leg length [m]",
    **{f"stiffness_{axis}_n_per_um": f"static stiffness {axis} [N/µm]" for axis in "xyz"},
    **{f"f{number}_hz": f"mode {number} [Hz]" for number in range(1, 7)},
}


def map_values(found: MapSummary, name: str) -> FloatArray:
    """Values ``(n0, n1)`` of a quantity, of a volume ``(n0, n1, n2)``, NaN where there is none."""
    # None becomes NaN
    return np.array(found["quantities"][name], dtype=float)


class MapLayer(NamedTuple):
    """A plane to draw: its place along the third axis of a volume, and what it stands at; of a plane it is the map itself."""

    place: int | None = None
    title: str = ""


def map_layers(found: MapSummary) -> list[MapLayer]:
    """The map itself, or the lowest, middle and highest layer of a volume."""
    if len(found["axes"]) == 2:
        return [MapLayer()]
    levels, axis = found["positions"][2], found["axes"][2]
    places = sorted({0, (len(levels) - 1) // 2, len(levels) - 1})
    return [MapLayer(place, f"{axis} = {show_position(levels[place], found['units'][axis])}") for place in places]


def draw_map(found: MapSummary, name: str, layer: int | None = None) -> Markup:
    """One quantity over a plane: first axis to the right, second upwards; grey where the pose cannot be taken.

    Args:
        found: The map of a summary.
        name: Of the quantity.
        layer: Place along the third axis of a volume; colours are those of the whole volume.
    """
    whole = map_values(found, name)
    values = whole if layer is None else whole[:, :, layer]
    known = whole[np.isfinite(whole)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    share = np.clip((values - low) / ((high - low) or 1.0), 0.0, 1.0)
    pixels = np.full((*values.shape, 4), [200, 200, 200, 255], dtype=np.uint8)
    good = np.isfinite(values)
    channels = [np.interp(share[good], np.linspace(0.0, 1.0, len(STOPS)), STOPS[:, channel]) for channel in range(3)]
    pixels[good, :3] = np.round(np.stack(channels, axis=-1)).astype(np.uint8)
    picture = base64.b64encode(encode_png(np.ascontiguousarray(pixels.transpose(1, 0, 2)[::-1]))).decode()
    spans = [(float(positions[0]), float(positions[-1])) for positions in found["positions"][:2]]
    ratio = (spans[1][1] - spans[1][0]) / ((spans[0][1] - spans[0][0]) or 1.0)
    inside = WIDTH - LEFT - 8
    height = float(np.clip(inside * ratio, 60.0, 480.0))
    title = f"{TITLES.get(name, name)}: {low:.4g} to {high:.4g}"
    shown = [[show_position(end, found["units"][axis]) for end in span] for axis, span in zip(found["axes"], spans, strict=False)]
    words = [
        svg.text(LEFT, 14, title, size=12),
        svg.text(LEFT, TOP + height + 14, shown[0][0], size=10),
        svg.text(WIDTH - 8, TOP + height + 14, shown[0][1], anchor="end", size=10),
        svg.text(LEFT + inside / 2, TOP + height + 14, found["axes"][0], anchor="middle", size=10),
        svg.text(LEFT - 4, TOP + height, shown[1][0], anchor="end", size=10),
        svg.text(LEFT - 4, TOP + 9, shown[1][1], anchor="end", size=10),
        svg.text(LEFT - 4, TOP + height / 2, found["axes"][1], anchor="end", size=10),
    ]
    image = Markup(
        '<image x="{}" y="{}" width="{}" height="{:.1f}" preserveAspectRatio="none" style="image-rendering:pixelated"'
        ' href="data:image/png;base64,{}"/>'
    ).format(LEFT, TOP, inside, height, picture)
    stem = name if layer is None else f"{name}_{layer}"
    high = TOP + height + BOTTOM - 12
    return svg.picture([image, *words], identity=f"map_{stem}", kind="map", width=WIDTH, height=high, label=title)
