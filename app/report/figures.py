"""Bars and lines of the report as SVG, so that they print and work without scripts."""

from collections.abc import Mapping, Sequence

from markupsafe import Markup

from headstock.app.texts.tables import sort_shares
from headstock.pipeline.storage.json_texts import Json

SHOWN_SHARE = 0.005
SMALLEST_PERCENT = 0.0005  # what is shown as 0.0 %, without a sign
BARS_SHOWN = 10
JOINT_COLOR = "#94a3b8"
BAR_WIDTH, BAR_STEP = 340, 27
BUDGET_ROW = """<text x="0" y="{line}" font-size="11.5" fill="currentColor">{name}</text>
<text x="{width}" y="{line}" font-size="11.5" text-anchor="end" fill="currentColor" data-value="{value}">{text}</text>
<rect x="0" y="{bar}" width="{width}" height="7" rx="2" fill="currentColor" opacity="0.08"/>
<rect x="0" y="{bar}" width="{long}" height="7" rx="2" fill="{color}"/>"""
LABEL_WIDTH = 44
STICK_WIDTH, STICK_HEIGHT, STICK_LEFT = 1040, 62, 130


def draw_budget(shares: Mapping[str, float], colors: Mapping[str, str], identity: str, longest: float) -> Markup:
    """One bar per part, largest first; joints in grey, components in their colours; a share of ``longest`` fills the width."""
    rows = [item for item in sort_shares(dict(shares))[:BARS_SHOWN] if item[1] >= SHOWN_SHARE]
    parts = []
    for number, (name, share) in enumerate(rows):
        places = {"line": number * BAR_STEP + 12, "bar": number * BAR_STEP + 16, "width": BAR_WIDTH}
        words = {"name": shorten(name), "value": repr(share), "text": percent(share), "color": colors.get(name, JOINT_COLOR)}
        parts.append(Markup(BUDGET_ROW).format(**places, **words, long=f"{max(1.0, BAR_WIDTH * share / longest):.1f}"))
    height = max(1, len(rows)) * BAR_STEP + 2
    return Markup('<svg id="{}" class="budget" viewBox="0 0 {} {}" role="img">{}</svg>').format(
        identity, BAR_WIDTH, height, Markup("").join(parts)
    )


def draw_frequencies(modal: Sequence[Json], identity: str) -> Markup:
    """A stick per elastic natural frequency, one row per pose, from zero to the highest."""
    highest = max((modes["frequencies_hz"][-1] for modes in modal if modes["frequencies_hz"]), default=1.0) or 1.0
    scale = (STICK_WIDTH - STICK_LEFT - 40) / highest
    parts = []
    for row, modes in enumerate(modal):
        y = row * STICK_HEIGHT
        base = y + STICK_HEIGHT - 16
        parts.append(
            Markup('<text x="0" y="{}" font-size="13" fill="currentColor">{}</text>').format(
                base - 4, shorten(modes["pose_name"], 18)
            )
        )
        parts.append(
            Markup('<line x1="{}" y1="{}" x2="{}" y2="{}" stroke="currentColor" opacity="0.3"/>').format(
                STICK_LEFT, base, STICK_WIDTH - 20, base
            )
        )
        parts.append(_sticks(modes, scale, base))
    size = (STICK_WIDTH, len(modal) * STICK_HEIGHT)
    return Markup('<svg id="{}" class="sticks" viewBox="0 0 {} {}" role="img">{}</svg>').format(
        identity, *size, Markup("").join(parts)
    )


def draw_stack(shares: Mapping[str, float], colors: Mapping[str, str]) -> Markup:
    """A thin stacked bar of shares, largest first."""
    parts, start = [], 0.0
    for name, share in sort_shares(dict(shares)):
        if share >= SHOWN_SHARE:
            piece = '<rect x="{:.1f}" width="{:.1f}" height="9" fill="{}"><title>{}</title></rect>'
            parts.append(Markup(piece).format(100 * start, max(0.0, 100 * share - 0.4), colors.get(name, JOINT_COLOR), name))
        start += max(0.0, share)
    return Markup('<svg class="stack" viewBox="0 0 100 9" preserveAspectRatio="none" aria-hidden="true">{}</svg>').format(
        Markup("").join(parts)
    )


def percent(share: float) -> str:
    """A share in per cent to three digits."""
    share = 0.0 if abs(share) < SMALLEST_PERCENT else share
    return f"{100 * share:.1f} %" if abs(share) < 0.9995 else f"{100 * share:.0f} %"


def shorten(text: str, length: int = 38) -> str:
    """A text that fits beside its number."""
    return text if len(text) <= length else f"{text[: length - 1]}…"


def _sticks(modes: Json, scale: float, base: int) -> Markup:
    parts, free_from = [], 0.0
    for frequency in modes["frequencies_hz"][modes["rigid_count"] :]:
        x = STICK_LEFT + scale * frequency
        parts.append(
            Markup('<line x1="{:.1f}" y1="{}" x2="{:.1f}" y2="{}" stroke="#4f7cac" stroke-width="2.4"/>').format(
                x, base - 30, x, base
            )
        )
        if x >= free_from:
            label = '<text x="{:.1f}" y="{}" font-size="11" text-anchor="middle" fill="currentColor" data-value="{}">{}</text>'
            # at 1000 Hz and above whole numbers: four digits and more
            text = f"{frequency:.4g}" if frequency < 1000.0 else f"{frequency:.0f}"
            parts.append(Markup(label).format(x, base + 13, repr(frequency), text))
            free_from = x + LABEL_WIDTH
    return Markup("").join(parts)
