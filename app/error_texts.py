"""How error estimates read: ``77.4 ± 0.6``, the share of each source, and what is not in them."""

import math
from collections.abc import Sequence

from rich.console import Console

from headstock.pipeline.error_estimates import DISCRETISATION, REDUCTION
from headstock.pipeline.json_texts import Json

MOST_DECIMALS = 3
NO_BOUND = "± ?"


def error_decimals(error: float) -> int:
    """Decimals that an error leaves worth printing: to its first digit, at most three."""
    return min(MOST_DECIMALS, max(0, -math.floor(math.log10(error)))) if error > 0.0 else MOST_DECIMALS


def show_frequency(hz: float, error: float | None) -> str:
    """A frequency with the decimals that its error leaves; three where it is not known."""
    return f"{hz:.{MOST_DECIMALS if error is None else error_decimals(error)}f}"


def show_error(error: float | None) -> str:
    """An error to its first digit, never rounded down."""
    if error is None:
        return NO_BOUND
    if error < 10.0**-MOST_DECIMALS:
        return f"± <{10.0**-MOST_DECIMALS:g}"
    scale = 10.0 ** math.floor(math.log10(error))
    return f"± {math.ceil(error / scale - 1e-9) * scale:.{error_decimals(error)}f}"


def show_size(error: float | None) -> str:
    """An error to its first digit however small it is, never rounded down."""
    if error is None or error <= 0.0:
        return NO_BOUND if error is None else "± 0"
    decimals = -math.floor(math.log10(error))
    rounded = math.ceil(error * 10.0**decimals - 1e-9) / 10.0**decimals
    return f"± {rounded:.{max(0, decimals)}f}"


def show_span(span: Sequence[float] | None) -> str:
    """Lowest and highest frequency with averaging and rigid interfaces."""
    return "-" if span is None else f"{span[0]:.4g} .. {span[1]:.4g}"


def largest_shares(modes: Json) -> dict[str, float]:
    """Largest part [Hz] of each source over the elastic modes of a pose."""
    shares = modes.get("error_share", [])[modes["rigid_count"] :]
    sources = dict.fromkeys(source for share in shares for source in share)
    return {source: max((share[source] or 0.0 for share in shares if source in share), default=0.0) for source in sources}


def error_words(modes: Json) -> list[str]:
    """What is not in the errors of a pose's frequencies, and where there are none."""
    shares = modes.get("error_share", [])[modes["rigid_count"] :]
    words = []
    if modes.get("interface_spread_hz"):
        words.append("interfaces: lowest and highest with every interface averaging or rigid")
    if modes.get("error_left_out"):
        words.append(f"not in ±: {'; '.join(modes['error_left_out'])}")
    if any(share.get(REDUCTION, 0.0) is None for share in shares):
        words.append(f"{NO_BOUND} : beyond the cut-off of the modes kept, where there is no bound; see the warnings")
    if any(share.get(DISCRETISATION, 0.0) is None for share in shares):
        words.append(f"{NO_BOUND} : modes of imported parts take part whose mesh error their files do not state")
    return words


def print_error_shares(console: Console, modes: Json) -> None:
    """Print where the errors of a pose's frequencies come from."""
    found = ", ".join(f"{source} up to {size:.2g} Hz" for source, size in largest_shares(modes).items())
    for words in [f"± from {found}"] * bool(found) + error_words(modes):
        console.print(f"  {words}", markup=False)
    console.print()


def show_plain_error(error: float) -> str:
    """An error to two digits."""
    return f"± {error:.2g}"


def response_error_words(response: Json) -> list[str]:
    """How far the lines of a frequency response may be off, by source, and what is not in it; empty where nothing is known."""
    found = response.get("error")
    if not found:
        return []
    sources = {source: shares for source, shares in found.items() if source != "bounded_to_hz"}
    if None in sources.values():
        return ["no bound of the reduction error: the range lies beyond the cut-off of the modes kept"]
    parts = [
        f"{source} {100 * shares['median_share']:.2g} % of a line in the median, at most {100 * shares['largest_share']:.2g} % at "
        f"{shares['largest_share_hz']:.4g} Hz"
        for source, shares in sources.items()
    ]
    words = [f"± from {'; '.join(parts)}"]
    if found["bounded_to_hz"] < response["to_hz"]:
        words.append(f"no bound above {found['bounded_to_hz']:.4g} Hz")
    if response.get("error_left_out"):
        words.append(f"not in ±: {'; '.join(response['error_left_out'])}")
    return words


def print_response_error(console: Console, response: Json) -> None:
    """Print how far a frequency response may be off."""
    for words in response_error_words(response):
        console.print(f"  {words}", markup=False)


def accuracy_words(accuracy: Json) -> list[str]:
    """How settings were chosen for an accuracy: what was asked for, what is reached, and with which settings."""
    rounds, reached = accuracy["rounds"], accuracy["estimated"]
    if "owner" not in rounds[-1]:
        return [
            f"accuracy {100.0 * accuracy['asked']:g} %: nothing to choose, since no number has an error of a mesh or of modes left out"
        ]
    last = rounds[-1]["quantity"]
    known = "an unknown amount" if reached is None else f"{100.0 * reached:.2g} %"
    settings = "; ".join(f"{name}: {words}" for name, words in accuracy["settings"].items())
    state = "met" if accuracy["met"] else "not met"
    count = f"{len(rounds)} round{'s' if len(rounds) != 1 else ''}"
    words = (
        f"accuracy {100.0 * accuracy['asked']:g} % {state} in {count}: {last} within {known}, the others closer"
        " (± of meshes counted up to 1.8 times)"
    )
    return [words, *([settings] if settings else [])]
