"""The parts of a machine drawn apart, with the areas where they touch in the colours of open values."""

from dataclasses import dataclass, replace

import numpy as np

from headstock.app.pictures.libraries import hsv_to_rgb
from headstock.app.pictures.machine_sketch import lift_areas
from headstock.app.pictures.numbered import Color, LabelledSurface
from headstock.app.pictures.scenes import join_skins_in_pose
from headstock.geometry.frames import Frame
from headstock.pipeline.results.views import MachineView, PoseView
from headstock.scene.reading.expressions import is_expression, names_in
from headstock.scene.reading.files import TomlValue, write_value
from headstock.scene.reading.findings import KeyPath, show_key
from headstock.scene.reading.open_values import OpenValue
from headstock.scene.scene import Scene

APART = 0.8  # shift of a part over the distance of its middle from the machine's
PART, CERTAIN = 0.86, (0.45, 0.5, 0.55)  # grey of parts; of areas that nothing is asked of
LONGEST = 110  # characters of a line of the legend
SECTIONS = ("joints", "points")


@dataclass(frozen=True)
class _Asked:
    """An open value with the interfaces that it is about, ``component.interface``."""

    question: OpenValue
    ends: frozenset[str]


def label_exploded(scene: Scene, view: MachineView, placed: PoseView) -> LabelledSurface:
    """Draw the parts of a machine apart, areas of interfaces numbered like the open values."""
    machine, asked = scene.machine, _find_areas(scene)
    apart = replace(placed, placements=_move_apart(view, placed))
    joined = join_skins_in_pose(view, apart)
    corners, triangles, owners = [joined.points], [joined.triangles], [joined.owners]
    start, first = len(joined.points), len(view.skins) + 1
    for name, part in machine.components.items():
        frame = apart.placements[name]
        for label, area in lift_areas(part).items():
            end = f"{name}.{label}"
            number = next((i for i, one in enumerate(asked, 1) if end in one.ends), 0)
            places = area.reshape(-1, 3) @ frame.rotation.T + frame.origin
            places, flat = np.unique(places.round(9), axis=0, return_inverse=True)
            corners.append(places)
            triangles.append(start + flat.reshape(-1, 3))
            owners.append(np.full(len(area), first + number))
            start += len(places)
    colors = _choose_colors(len(asked))
    palette = np.vstack([np.full((first, 3), PART), [CERTAIN], *colors])
    return LabelledSurface(
        np.vstack(corners),
        np.vstack(triangles),
        np.concatenate(owners),
        {
            **dict(enumerate(view.skins, 1)),
            **{first + number: str(number) for number in range(1, len(asked) + 1)},
        },
        f"{scene.name}: parts apart, where they touch",
        palette=palette,
        legend=tuple(
            (_describe(number, one.question), color)
            for number, (one, color) in enumerate(zip(asked, colors, strict=True), 1)
        ),
    )


def _find_areas(scene: Scene) -> list[_Asked]:
    """Return open values of joints and points, directly or by a parameter, with their interfaces."""
    users: dict[KeyPath, set[str]] = {}
    for section in SECTIONS:
        entries = scene.written.get(section)
        for name, entry in entries.items() if isinstance(entries, dict) else ():
            for parameter in _parameters_of(entry):
                users.setdefault(("parameters", parameter), set()).add(f"{section}.{name}")
    machine = scene.machine
    ends = {f"joints.{name}": [*map(str, one.ends)] for name, one in machine.joints.items()}
    ends |= {
        f"points.{name}": [str(one.tool), str(one.work)] for name, one in machine.points.items()
    }
    asked = []
    for question in scene.questions:
        named: set[str] = set()
        for key in question.keys:
            direct = {show_key(key[:2])} if key[0] in SECTIONS else set[str]()
            for user in users.get(key[:2], set()) | direct:
                named.update(ends.get(user, ()))
        default = str(question.default)
        # of an end that is asked for itself
        asked.append(_Asked(question, frozenset({default} if default in named else named)))
    return [one for one in asked if one.ends]


def _parameters_of(value: TomlValue) -> set[str]:
    if isinstance(value, dict | list):
        inner = value.values() if isinstance(value, dict) else value
        return set().union(*map(_parameters_of, inner))
    return set(names_in(value)) if isinstance(value, str) and is_expression(value) else set()


def _move_apart(view: MachineView, placed: PoseView) -> dict[str, Frame]:
    """Return frames of components, each farther from the middle of the machine."""
    middles = {
        name: frame.origin
        + frame.rotation @ (0.5 * (view.skins[name].points.min(0) + view.skins[name].points.max(0)))
        for name, frame in placed.placements.items()
        if name in view.skins
    }
    middle = np.mean([*middles.values()], axis=0)
    return {
        name: Frame(frame.origin + APART * (middles[name] - middle), frame.rotation)
        if name in middles
        else frame
        for name, frame in placed.placements.items()
    }


def _choose_colors(count: int) -> list[Color]:
    hues = np.arange(count) / max(count, 1)
    values = np.where(np.arange(count) % 2, 0.95, 0.75)
    rows = hsv_to_rgb(np.column_stack([hues, np.full(count, 0.85), values]).reshape(-1, 3))
    return [(float(r), float(g), float(b)) for r, g, b in rows]


def _describe(number: int, question: OpenValue) -> str:
    name = show_key(question.keys[0]).removeprefix("parameters.")
    more = f" +{len(question.keys) - 1}" if len(question.keys) > 1 else ""
    text = f"{number}  {name}{more}: {write_value(question.default)}; {question.reason}"
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
