"""Worth over price as a figure: how far each change of a scene moves its numbers, beside what it
saves or takes.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from headstock.app.charts.charts import (
    FAINT,
    INK,
    add_legend,
    calm_axes,
    encode_figure,
    label_axes,
    new_figure,
)
from headstock.app.charts.study import COLORS
from headstock.app.pictures.libraries import FuncFormatter, Line2D, MaxNLocator, NullLocator, Patch
from headstock.studies.effects import EffectsSummary
from headstock.studies.model_influence import CLEARLY

SMALLEST = 1e-5  # what moves less is drawn as that
ROW_INCHES, EDGE_INCHES = 0.27, 0.9
# what is to be done, in few words, and what that is called in the two lists
ACTIONS = {
    "keep": ("keep", "keep it", "take", "name it", "matters"),
    "for the third digit": (
        "third digit",
        "keep it for the third digit",
        "name it for the third digit",
    ),
    "may be dropped": ("drop", "leave it out"),
    "as written is enough": ("either", "enough", "rightly left out"),
}


class _Row(NamedTuple):
    """A change: its words, largest change of a number, share of the time that it adds, what is to be
    done, and what of modes has no counterpart.
    """

    words: str
    worth: float
    added: float
    action: str
    modes: str = ""


def draw_worth(summary: EffectsSummary) -> bytes | None:
    """Two panels side by side with a row per change, those that move most for their price first;
    None where nothing moved anything.

    Args:
        summary: Content of ``effects.json``.
    """
    rows = [row for row in _list_rows(summary) if row.worth > 0.0]
    if not rows:
        return None
    rows.sort(key=lambda row: row.worth / max(CLEARLY, abs(row.added)))  # the last is on top
    figure = new_figure(11.0, EDGE_INCHES + ROW_INCHES * len(rows))
    worth, price = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    places = range(len(rows))
    colors = dict(zip(ACTIONS, (COLORS[0], COLORS[1], COLORS[2], FAINT), strict=True))
    shades = [colors[_find_action(row.action)] for row in rows]
    for axes in (worth, price):
        calm_axes(axes)
    worth.set_xscale("log")
    worth.barh(places, [max(row.worth, SMALLEST) for row in rows], color=shades, height=0.66)
    for place, row in enumerate(rows):
        if row.modes:
            worth.text(0.9, place, row.modes, ha="right", va="center", fontsize=8, color="white")
    worth.set_xlim(0.7 * SMALLEST, 1.6)
    worth.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100.0 * value:g} %"))
    worth.xaxis.set_minor_locator(NullLocator())
    worth.set_yticks(list(places), [row.words for row in rows])
    label_axes(worth, x="worth: largest change of a number")
    for limit in (summary["small_change"], summary["large_change"]):
        worth.axvline(limit, color=INK, linewidth=0.8, linestyle="--")
    price.barh(places, [100.0 * row.added for row in rows], color=shades, height=0.66)
    price.axvline(0.0, color=INK, linewidth=0.8)
    price.xaxis.set_major_locator(MaxNLocator(5))
    price.xaxis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{value:+g} %" if value else "0")
    )
    label_axes(price, x="price: processor time against that as written")
    shown = [name for name in ACTIONS if colors[name] in shades]
    limits = " and ".join(
        f"{100.0 * limit:g} %" for limit in (summary["small_change"], summary["large_change"])
    )
    handles = [*(Patch(color=colors[name]) for name in shown), Line2D([], [], color=INK, ls="--")]
    add_legend(figure, handles, [*shown, limits])
    return encode_figure(figure)


def _list_rows(summary: EffectsSummary) -> Iterable[_Row]:
    for effect in summary["effects"]:
        share = effect["time_share"] * (-1.0 if effect["active"] else 1.0)
        words = f"effect {effect['effect']} {'off' if effect['active'] else 'on'}"
        yield _Row(words, effect["largest_change"], share, effect["advice"])
    for model in summary["models"]:
        words = ", ".join(model["bodies"]) or "path"
        if model["kind"] in ("interfaces", "modes", "mesh"):
            words = f"{model['kind']} of {words}"
        elif model["kind"] == "pose":
            words = "pose along the path"
        yield _Row(
            f"{words}: {model['tried']}",
            model["worth"],
            -model["time_saved_share"],
            model["action"],
            _count(model["missing_modes"], "missing") or _count(model["added_modes"], "more"),
        )


def _count(modes: Sequence[str], word: str) -> str:
    return f"{len(modes)} {'mode' if len(modes) == 1 else 'modes'} {word}" if modes else ""


def _find_action(action: str) -> str:
    return next(name for name, words in ACTIONS.items() if action in words)
