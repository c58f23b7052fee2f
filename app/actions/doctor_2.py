"""Is everything there that Headstock needs, and if not, what to do."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from headstock.app.actions.doctor import Check, check_environment
from headstock.pipeline.storage.outputs import write_output


def run_doctor(json_file: Path | None, examine: Callable[[], list[Check]] = check_environment) -> int:
    """Print each check with its remedy and write them to a file if one is asked for.

    Args:
        json_file: Where to write ``{"healthy": bool, "checks": [{name, found, status, remedy}]}``.
        examine: What makes the checks.

    Returns:
        0 when nothing needed is missing, else 1.
    """
    checks = examine()
    missing = [check.name for check in checks if check.status == "missing"]
    print(describe_checks(checks))
    print("all there" if not missing else f"missing: {', '.join(missing)}")
    if json_file is not None:
        content = {"healthy": not missing, "checks": [asdict(check) for check in checks]}
        write_output(json_file, (json.dumps(content, indent=2) + "\n").encode())
    return 1 if missing else 0


def describe_checks(checks: list[Check]) -> str:
    """The checks as aligned lines, each remedy below its line."""
    width = max(len(check.name) for check in checks)
    lines = []
    for check in checks:
        lines.append(f"{check.status:8}{check.name:{width}}  {check.found}")
        if check.remedy:
            lines.append(f"{'':8}{'':{width}}  -> {check.remedy}")
    return "\n".join(lines)
