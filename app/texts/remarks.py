"""Remarks and warnings as they are shown: those that differ in numbers only are one line."""

import re
from collections.abc import Sequence

FEW = 2  # alike that are shown one by one
NUMBERED_NAME = re.compile(r"\b[A-Za-z]\w*_\d+\b")
MOST_NAMED = 6
NUMBER = re.compile(r"(?<![A-Za-z])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?|(?<=_)\d+", re.IGNORECASE)


def fold_remarks(remarks: Sequence[str]) -> list[str]:
    """Return remarks with those that differ in numbers only, numbers of names included, as the first
    of them and their count.

    Args:
        remarks: In the order in which they are shown.
    """
    alike: dict[str, list[str]] = {}
    for remark in remarks:
        alike.setdefault(NUMBER.sub("#", remark), []).append(remark)
    return [
        line
        for group in alike.values()
        for line in (
            group
            if len(group) <= FEW
            else [f"{group[0]} ({len(group) - 1} more like this{_name_others(group)})"]
        )
    ]


def _name_others(group: Sequence[str]) -> str:
    """Return the numbered names that the first remark of a group lacks, where there are any."""
    own = set(NUMBERED_NAME.findall(group[0]))
    names = dict.fromkeys(name for each in group[1:] for name in NUMBERED_NAME.findall(each))
    others = [name for name in names if name not in own]
    if not others:
        return ", with other numbers"
    more = ", ..." if len(others) > MOST_NAMED else ""
    return f": {', '.join(others[:MOST_NAMED])}{more}"
