"""Markdown tables of the reduction benchmark."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

MODES = 20


@dataclass
class Run:
    """One process of one contender: what each stage and all of it took, the frequencies it found,
    or why there are none.
    """

    name: str
    size: str
    modes: int
    stages: dict[str, dict[str, float]] = field(default_factory=dict)
    total: dict[str, float] = field(default_factory=dict)
    fixed_hz: list[float] = field(default_factory=list)
    free_hz: list[float] = field(default_factory=list)
    poses_per_second: dict[str, float] = field(default_factory=dict)
    failure: str = ""
    dofs: int = 0


def environment_lines(machine: dict[str, Any]) -> list[str]:
    """What the numbers were measured on."""
    return [
        f"Machine: {machine['cpu']}, {machine['cores']} cores, {machine['memory_gib']} GiB, {machine['system']}; "
        f"Python {machine['python']}, numpy {machine['numpy']}.",
        f"{machine['threads']} BLAS thread(s), {machine['ranks']} rank; load average before the run {machine['load_before']}.",
    ]


def summary_table(runs: Sequence[Run], size: str) -> list[str]:
    """One row per contender: dofs, modes, seconds with their spread, CPU seconds, peak memory."""
    rows = []
    for name, modes in _contenders(runs, size):
        chosen = _chosen(runs, size, name, modes)
        good = [run for run in chosen if not run.failure]
        if good:
            cells = [
                _seconds(good, "seconds"),
                _seconds(good, "cpu"),
                f"{max(run.total['peak_mb'] for run in good) / 1024:.2f}",
            ]
        else:
            cells = [chosen[0].failure, "", ""]
        rows.append([name, str(chosen[0].dofs), str(modes), *cells, str(len(good))])
    return _table(
        [
            "contender",
            "dofs",
            "modes",
            "seconds (min–max)",
            "CPU seconds (min–max)",
            "peak GiB",
            "runs",
        ],
        rows,
    )


def stage_table(runs: Sequence[Run], size: str) -> list[str]:
    """One row per stage of each contender: median seconds and the peak memory at its end."""
    rows = []
    for name, modes in _contenders(runs, size):
        good = [run for run in _chosen(runs, size, name, modes) if not run.failure]
        for stage in good[0].stages if good else ():
            entries = [run.stages[stage] for run in good]
            middle = [
                statistics.median(entry[key] for entry in entries)
                for key in ("seconds", "cpu", "peak_mb")
            ]
            rows.append(
                [
                    name,
                    str(modes),
                    stage,
                    f"{middle[0]:.2f}",
                    f"{middle[1]:.2f}",
                    f"{middle[2] / 1024:.2f}",
                ]
            )
    return _table(
        ["contender", "modes", "stage", "seconds", "CPU seconds", "peak GiB at its end"], rows
    )


def ratio_lines(runs: Sequence[Run], size: str) -> list[str]:
    """Ratios of medians within this run, by wall time and by CPU time."""
    own = _middle(runs, size, "headstock", MODES)
    if own is None:
        return ["no ratios: Headstock's own run failed"]
    rows = []
    for name, modes in _contenders(runs, size):
        if name == "headstock" and modes == MODES:
            continue
        other = _middle(runs, size, name, modes)
        if other is None:
            rows.append(
                [f"{name} / headstock", _chosen(runs, size, name, modes)[0].failure, "", ""]
            )
        elif name == "minimum":
            rows.append(
                [
                    "headstock / minimum",
                    *(f"{own[key] / other[key]:.2f}" for key in ("seconds", "cpu", "peak_mb")),
                ]
            )
        else:
            label = (
                f"{modes} modes / {MODES} modes" if name == "headstock" else f"{name} / headstock"
            )
            rows.append(
                [label, *(f"{other[key] / own[key]:.2f}" for key in ("seconds", "cpu", "peak_mb"))]
            )
    return _table(["ratio", "seconds", "CPU seconds", "peak memory"], rows)


def agreement_table(runs: Sequence[Run], size: str, reference: str) -> list[str]:
    """Largest relative difference of frequencies from the reference contender."""
    tight = next(
        (
            run
            for run in runs
            if (run.name, run.size, run.modes, run.failure) == (reference, size, MODES, "")
        ),
        None,
    )
    if tight is None:
        return [f"frequencies not compared: {reference} did not run"]
    rows = []
    for name, modes in _contenders(runs, size):
        for run in _chosen(runs, size, name, modes)[:1]:
            if run.failure or not run.fixed_hz or modes != MODES or name == reference:
                continue
            differences = [
                max(
                    abs(mine / theirs - 1.0)
                    for mine, theirs in zip(getattr(run, key), getattr(tight, key), strict=True)
                )
                for key in ("fixed_hz", "free_hz")
            ]
            rows.append([name, *(f"{difference:.1e}" for difference in differences)])
    return _table(
        [
            f"against {reference}",
            "fixed-interface frequencies",
            "free-free frequencies of the reduced model",
        ],
        rows,
    )


def pose_lines(run: Run) -> list[str]:
    """Poses per second."""
    rows = [[size, f"{rate:.0f}"] for size, rate in run.poses_per_second.items()]
    return _table(
        ["dofs of the reduced machine", "poses per second, all frequencies and shapes"], rows
    )


def _contenders(runs: Sequence[Run], size: str) -> list[tuple[str, int]]:
    return list(dict.fromkeys((run.name, run.modes) for run in runs if run.size == size))


def _chosen(runs: Sequence[Run], size: str, name: str, modes: int) -> list[Run]:
    return [run for run in runs if (run.size, run.name, run.modes) == (size, name, modes)]


def _middle(runs: Sequence[Run], size: str, name: str, modes: int) -> dict[str, float] | None:
    good = [run.total for run in _chosen(runs, size, name, modes) if not run.failure]
    return (
        {key: statistics.median(total[key] for total in good) for key in good[0]} if good else None
    )


def _seconds(runs: Sequence[Run], key: str) -> str:
    values = [run.total[key] for run in runs]
    return f"{statistics.median(values):.2f} ({min(values):.2f}–{max(values):.2f})"


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (headings, ["---"] * len(headings), *rows)]
