"""Peak memory as another process sees it."""

import subprocess

import numpy as np
import pytest

from common import approx
from headstock.pipeline.planning import resources
from headstock.pipeline.planning.resources import watch_memory

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
