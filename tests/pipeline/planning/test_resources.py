"""Peak memory and room as a plan and another process see them, on nodes too."""

import dataclasses
import subprocess
from pathlib import Path

import numpy as np
import pytest

from cases import cases
from common import approx
from headstock.pipeline.planning import resources
from headstock.pipeline.planning.budgets import BASE_MB, BudgetError
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.planning.resources import (
    RanksOnNodes,
    _memory_on_node,
    check_memory,
    node_memory_bytes,
    watch_memory,
)

MEGABYTES = 400


def hold_memory(megabytes: int) -> None:
    assert np.ones(megabytes << 17).sum() > 0.0


def test_a_peak_is_that_of_the_work_watched_not_of_earlier_work() -> None:
    with watch_memory() as large:
        hold_memory(MEGABYTES)
    with watch_memory() as small:
        hold_memory(1)
    assert large.megabytes is not None and small.megabytes is not None
    assert large.megabytes - small.megabytes == approx(MEGABYTES, rel=0.1)


def test_what_is_raised_within_is_passed_on_and_no_watcher_stays() -> None:
    with pytest.raises(ZeroDivisionError), watch_memory() as peak:
        raise ZeroDivisionError
    assert peak.megabytes is not None


@pytest.mark.parametrize(
    "script", ["raise SystemExit(1)", "print('ready', flush=True)\nprint('nothing to say')"]
)
def test_where_nobody_can_look_nothing_is_claimed(
    script: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resources, "WATCHER", script)
    with watch_memory() as peak:
        pass
    assert peak.megabytes is None


def test_a_watcher_that_cannot_be_started_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*args: object, **options: object) -> None:
        raise OSError("no more processes")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    with watch_memory() as peak:
        pass
    assert peak.megabytes is None


REDUCE = Stage(
    "reduce", "bed", "", estimated_dofs=2_000_000, estimated_memory_mb=40_000.0 + BASE_MB
)


@cases
def test_memory_of_a_job_is_what_slurm_gives_it_on_a_node(
    variables: dict[str, str], expected: float, tmp_path: Path
) -> None:
    assert node_memory_bytes(variables, tmp_path / "none", tmp_path) == expected


def test_the_tightest_control_group_above_this_process_counts(tmp_path: Path) -> None:
    (tmp_path / "own").write_text("0::/system.slice/job_7/step_0\n")
    job = tmp_path / "system.slice" / "job_7"
    (job / "step_0").mkdir(parents=True)
    (job / "step_0" / "memory.max").write_text("max\n")
    (job / "memory.max").write_text("1000000\n")
    (job.parent / "memory.max").write_text("3000000\n")
    assert node_memory_bytes({}, tmp_path / "own", tmp_path) == 1e6


def test_a_component_that_is_split_counts_by_the_ranks_of_a_node_and_the_others_wait() -> None:
    two_nodes = RanksOnNodes(ranks=8, together=4, memory_mb=24_000.0)
    assert _memory_on_node(REDUCE, two_nodes, split=True) == approx(20_000 + 4 * BASE_MB)
    assert _memory_on_node(REDUCE, two_nodes, split=False) == approx(40_000 + 4 * BASE_MB)


def test_a_component_too_large_for_a_node_is_refused_unless_it_is_split_over_several() -> None:
    two_nodes = RanksOnNodes(ranks=8, together=4, memory_mb=24_000.0)
    check_memory([REDUCE], None, held=two_nodes, split_dofs=1e6)
    with pytest.raises(BudgetError, match=r"'bed'.* 4 of 8 ranks.*this machine has 2.4e\+04 MB"):
        check_memory([REDUCE], None, held=two_nodes)
    with pytest.raises(BudgetError, match=r"'bed'.*limits\.memory allows 1e\+04 MB"):
        check_memory([REDUCE], 1e10, held=two_nodes, split_dofs=1e6)
    mesh = dataclasses.replace(REDUCE, kind="mesh")
    with pytest.raises(BudgetError, match=r"mesh of component 'bed'.*of which one has"):
        check_memory([mesh], None, held=two_nodes, split_dofs=1e6)
    one_node = RanksOnNodes(ranks=4, together=4, memory_mb=24_000.0)
    with pytest.raises(BudgetError, match="share the component"):
        check_memory([REDUCE], None, held=one_node, split_dofs=1e6)
