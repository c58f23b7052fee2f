"""Names of numbers that a scene watches, compared with the kinds that exist and with its poses and
points, before anything is computed.
"""

import re
from collections.abc import Mapping, Sequence

from headstock.pipeline.numbers.kinds import KINDS
from headstock.scene.reading.findings import Problem, suggest_names
from headstock.scene.reading.watch_paths import parse_watch
from headstock.scene.scene import Scene

_WHOLE_PAIR = re.compile(r"(?<=[(,])([a-z]+)=([^,*?\"()]+)(?=[,)])")


def find_unknown_numbers(scene: Scene) -> list[Problem]:
    """Return a problem for every name in a study of the scene that no number can have."""
    return [
        scene.findings.describe(("studies", name, "watch", place), fault)
        for name, study in scene.studies.items()
        for place, text in enumerate(study.watch)
        if parse_watch(text).names_numbers and (fault := find_name_fault(text, [scene]))
    ]


def find_name_fault(pattern: str, scenes: Sequence[Scene]) -> str:
    """Say why no number of any scene can have a name; empty where one may.

    Args:
        pattern: Name of numbers, a kind, or a name with ``*`` and ``?``.
    """
    kind, _, at = pattern.partition("(")
    if "*" in kind or "?" in kind:
        return ""
    if kind not in KINDS:
        return f"{kind} is no result and no kind of numbers; {suggest_names(kind, KINDS, what='kinds of numbers')}"
    known: Mapping[str, set[str]] = {
        "pose": {pose for scene in scenes for pose in scene.poses},
        "point": {
            name for scene in scenes for name in (*scene.machine.points, *scene.machine.sensors)
        },
    }
    roles = KINDS[kind].roles
    for role, value in _WHOLE_PAIR.findall(f"({at}"):
        if role not in roles:
            return f"{pattern}: {kind} has no {role}; {suggest_names(role, roles, what='roles')}"
        # a point may also be an interface, such as column.tip
        if role in known and value not in known[role] and "." not in value:
            return f"{pattern}: {suggest_names(value, known[role], what=f'{role}s')}"
    return ""
