"""What a study watches, compared with what a summary can hold, before any point is computed."""

import types
from collections.abc import Collection, Sequence
from typing import Union, get_args, get_origin, get_type_hints, is_typeddict

from headstock.pipeline.preview.watched_numbers import find_name_fault
from headstock.pipeline.results.summary import RunSummary
from headstock.scene.reading.findings import suggest_names
from headstock.scene.reading.names import NAMES, RESULT_KEYS
from headstock.scene.reading.watch_paths import MEASURED_NAMES, POSE_NAME, Step, parse_watch
from headstock.scene.scene import Scene

RENAMED = RESULT_KEYS["summary.json"]


def find_watch_fault(text: str, scenes: Sequence[Scene]) -> str:
    """Say why a watched path leads nowhere in any point of a study; empty where it may lead
    somewhere.

    Args:
        text: The path, or the name of numbers.
        scenes: Of the points, with the analyses that they run.
    """
    path = parse_watch(text)
    if path.names_numbers:
        return find_name_fault(text, scenes)
    steps = path.steps
    root = str(steps[0])
    if root in MEASURED_NAMES:
        return "" if len(steps) == 1 else f"{text}: {root} is a number; write {root}"
    analyses = {name for scene in scenes for name in scene.analyses.names}
    if root in NAMES and root not in analyses:
        return f"{text}: no point runs the analysis {root}; {suggest_names(root, analyses, what='analyses')}"
    poses = {pose for scene in scenes for pose in scene.poses}
    fault = _find_fault(steps, RunSummary, "", poses)
    return f"{text}: {fault}" if fault else ""


def _find_fault(steps: Sequence[Step], hint: object, label: str, poses: Collection[str]) -> str:
    """Say where steps leave what a type can hold; empty where they do not.

    Args:
        hint: Type of the value that they start at.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        options = [option for option in arguments if option is not type(None)]
        faults = [_find_fault(steps, option, label, poses) for option in options]
        return "" if "" in faults else faults[0]
    keys = get_type_hints(hint) if isinstance(hint, type) and is_typeddict(hint) else None
    if not steps:
        if origin is list:
            return _find_fault(steps, arguments[0], f"{label}[0]", poses)
        if keys is not None:
            return f"{label} is a table; name one of {', '.join(keys)}"
        return f"{label} is a table; name one of its entries" if origin is dict else ""
    step, rest = steps[0], steps[1:]
    if keys is not None and isinstance(step, str):
        name = step if step in keys else RENAMED.get(step, step)
        if name not in keys:
            return f"{label or 'the summary'} has no {step!r}; {suggest_names(step, keys, what='keys')}"
        return _find_fault(rest, keys[name], f"{label}.{name}" if label else name, poses)
    if origin is dict and isinstance(step, str):
        return _find_fault(rest, arguments[1], f"{label}.{step}", poses)
    if origin is list and not isinstance(step, str):
        return _find_fault(rest, arguments[0], f"{label}[{step}]", poses)
    if origin is list and POSE_NAME in getattr(arguments[0], "__annotations__", ()):
        # an entry per pose: by the name of the pose, or the first one's
        return _find_fault(rest if step in poses else steps, arguments[0], label, poses)
    if keys is not None or origin is dict:
        return f"{label} is a table, not a list"
    if origin is list:
        return f"{label} is a list; write {label}[0]"
    return f"{label} is a single value, without {step!r}"
