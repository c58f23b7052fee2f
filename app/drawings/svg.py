"""Lines, texts and frames of SVG pictures, as every plot of the report draws them; places in user
units, ``y`` downwards.
"""

from collections.abc import Iterable

from markupsafe import Markup


def line(x1: float, y1: float, x2: float, y2: float, *, opacity: float) -> Markup:
    """A line in the colour of the text. Places to a tenth; whole numbers (``int``) are written as
    such.

    Args:
        x2: Where it ends, to the right.
        y2: Where it ends, downwards.
        opacity: From 0 to 1.
    """
    ends = (_place(end) for end in (x1, y1, x2, y2))
    return Markup(
        '<line x1="{}" y1="{}" x2="{}" y2="{}" stroke="currentColor" opacity="{}"/>'
    ).format(*ends, opacity)


def text(
    x: float,
    y: float,
    words: str,
    *,
    anchor: str = "start",
    size: float = 11,
    color: str = "currentColor",
    opacity: float | None = None,
) -> Markup:
    """A line of text.

    Args:
        x: Of its start, middle or end.
        anchor: ``start``, ``middle`` or ``end``: which part of it is at ``x``.
        opacity: From 0 to 1; opaque without it.
    """
    faint = Markup("") if opacity is None else Markup(' opacity="{}"').format(opacity)
    return Markup(
        '<text x="{:.1f}" y="{:.1f}" font-size="{}" text-anchor="{}" fill="{}"{}>{}</text>'
    ).format(x, y, size, anchor, color, faint, words)


def hatching(identity: str, color: str) -> Markup:
    """Slanted lines to fill areas with: ``url(#identity)``."""
    return Markup(
        '<defs><pattern id="{}" width="7" height="7" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
        '<rect width="2" height="7" fill="{}" opacity="0.45"/></pattern></defs>'
    ).format(identity, color)


def area(places: Iterable[tuple[float, float]], fill: str, *, opacity: float = 1.0) -> Markup:
    """A filled area.

    Args:
        opacity: From 0 to 1.
    """
    return Markup('<polygon points="{}" fill="{}" opacity="{:g}"/>').format(
        points(places), fill, opacity
    )


def points(places: Iterable[tuple[float, float]]) -> str:
    """Places as lines and areas take them."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def heading(x: float, y: float, words: str, *, size: float = 11.5) -> Markup:
    """What a plot shows, above its left end."""
    return Markup(
        '<text x="{:.1f}" y="{:.1f}" font-size="{}" font-weight="600" fill="currentColor">{}</text>'
    ).format(x, y, size, words)


def picture(
    parts: Iterable[Markup],
    *,
    identity: str,
    kind: str,
    width: float,
    height: float,
    label: str = "",
    widest: float | None = None,
) -> Markup:
    """A whole picture.

    Args:
        parts: What is in it, the lowest first.
        identity: Its ``id`` in the page.
        label: Said where it cannot be seen.
        widest: On the page [px]; as wide as there is space without it.
    """
    said = Markup(' aria-label="{}"').format(label) if label else Markup("")
    style = Markup("") if widest is None else Markup(' style="max-width:{:.0f}px"').format(widest)
    return Markup(
        '<svg id="{}" class="{}" viewBox="0 0 {:.0f} {:.0f}" role="img"{}{}>{}</svg>'
    ).format(identity, kind, width, height, said, style, Markup("").join(parts))


def _place(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.1f}"
