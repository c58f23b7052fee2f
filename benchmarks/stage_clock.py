"""Wall seconds, CPU seconds and peak memory of the stages of one process."""

import functools
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


class StageClock:
    """Adds up what each named stage takes; time inside an inner stage counts for the inner one
    only.
    """

    def __init__(self) -> None:
        self.stages: dict[str, dict[str, float]] = {}
        self._inside: list[list[float]] = []
        self.start = (time.perf_counter(), time.process_time())

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count what happens inside for a stage."""
        self._inside.append([0.0, 0.0])
        start = (time.perf_counter(), time.process_time())
        yield
        spent = (time.perf_counter() - start[0], time.process_time() - start[1])
        inner = self._inside.pop()
        if self._inside:
            self._inside[-1][0] += spent[0]
            self._inside[-1][1] += spent[1]
        entry = self.stages.setdefault(name, {"seconds": 0.0, "cpu": 0.0, "peak_mb": 0.0})
        entry["seconds"] += spent[0] - inner[0]
        entry["cpu"] += spent[1] - inner[1]
        entry["peak_mb"] = peak_mb()

    def watch(self, owner: Any, attribute: str, name: str) -> None:
        """Count every call of a function or method of a module or class for a stage."""
        function: Callable[..., Any] = getattr(owner, attribute)

        @functools.wraps(function)
        def timed(*arguments: Any, **options: Any) -> Any:
            with self.stage(name):
                return function(*arguments, **options)

        setattr(owner, attribute, timed)

    def restart(self) -> None:
        """Begin to count the total."""
        self.start = (time.perf_counter(), time.process_time())

    def total(self) -> dict[str, float]:
        """Seconds since the start of counting, and the peak memory of the process."""
        return {
            "seconds": time.perf_counter() - self.start[0],
            "cpu": time.process_time() - self.start[1],
            "peak_mb": peak_mb(),
        }


def peak_mb() -> float:
    """Largest resident memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
