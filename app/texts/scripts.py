"""Data that scripts of a page read."""

import json
from collections.abc import Mapping


def script_json(content: Mapping[str, object]) -> str:
    """JSON that no browser takes for the end of the script element it stands in, nor for a line
    break in a script.
    """
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text
