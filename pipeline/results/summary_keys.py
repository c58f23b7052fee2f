"""The keys that ``summary.json`` may have, so that a path into it can be checked before anything is computed.

They are written as texts: ``stages[](stage seconds) versions.* values.*.**`` has a list of tables, a
table with any keys, and one in which anything may follow.
"""

import functools
import re

from headstock.pipeline.planning.analyses import load_answer_types

ANY_KEY, ANY_NUMBER, ANYTHING = ".*", "[]", ".**"
RUN_KEYS = """
    format name status versions.* warnings[] failures[] assumptions[] files.*.*
    stages[](stage component pose reason seconds cpu_seconds cached peak_rss_mb)
    totals(mass_kg full_dofs reduced_dofs seconds peak_rss_mb)
    components.*(fidelity full_dofs reduced_dofs mass_kg cutoff_hz residual mesh_quality.* mesh_corrected)
    provenance(scene_file scene_sha256 scene_text variant overrides[] analyses[] version commit date
    ranks threads accepted_defaults[] command[] host)"""
# what a value holds: tables by key, what entries of a list or of a table with any keys hold, or nothing
type Shape = dict[str, Shape] | tuple[str, Shape] | None


@functools.cache
def list_summary_keys() -> dict[str, Shape]:
    """Return what every entry that ``summary.json`` may have holds, by its key."""
    return _parse_keys(" ".join([RUN_KEYS, *(kind.keys for kind in load_answer_types())]))


def _parse_keys(text: str) -> dict[str, Shape]:
    """Return keys with what they hold."""
    return _parse_table(re.findall(r"\w+|\[\]|\.\*+|[()]", text)[::-1])


def _parse_table(words: list[str]) -> dict[str, Shape]:
    """Return the keys up to the end of their table; takes its words from the end of the list."""
    table: dict[str, Shape] = {}
    while words and (name := words.pop()) != ")":
        marks = []
        while words and words[-1] in (ANY_KEY, ANY_NUMBER, ANYTHING):
            marks.append(words.pop())
        shape: Shape = None
        if words and words[-1] == "(":
            words.pop()
            shape = _parse_table(words)
        for mark in reversed(marks):
            shape = (mark, shape)
        table[name] = shape
    return table
