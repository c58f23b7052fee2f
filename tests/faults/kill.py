"""Runs killed at random times: no torn file, nothing left running, and the next run right."""

import os
import random
import shutil
import signal
import time
from pathlib import Path

from faults.file_checks import check_files
from faults.runs import (
    VARIANTS,
    FaultError,
    Numbers,
    Outcome,
    Places,
    finish_run,
    make_places,
    read_numbers,
    read_results,
    read_summary_numbers,
    start_run,
    wait_for_end,
)

SETTLE_SECONDS = 10.0
POLL_SECONDS = 0.0005
# how the moment of a kill is chosen, in turn: at any time of a run, or while one of its files is
# being written
AIMS = ("any time", "any time", "while a file is written")
FORMS_EVERY = 20  # this often the compiled forms are cleared too, since compiling takes long


def kill_runs(runs: int, *, seed: int, root: Path) -> Outcome:
    """Kill ``headstock run`` with signal 9 again and again; after each kill look at every file and
    let a run end."""
    chance = random.Random(seed)
    # the user's forms stay: those that are cleared are the runs' own
    cache = root / "cache" if runs >= FORMS_EVERY else None
    places, outcome = make_places(root, cache=cache), Outcome()
    expected, seconds = _undisturbed(places)
    for trial in range(runs):
        variant = VARIANTS[trial % 2]
        if chance.random() < 0.5:
            shutil.rmtree(places.store, ignore_errors=True)
        if cache and trial % FORMS_EVERY == FORMS_EVERY - 1:
            shutil.rmtree(cache, ignore_errors=True)
        try:
            ending = _kill_one(places, variant, AIMS[trial % len(AIMS)], seconds, chance)
            outcome.note_trial(ending)
            check_remains(places, expected)
            _check_next(places, variant, expected[variant])
        except FaultError as error:
            outcome.faults.append(f"kill {trial + 1}: {error}")
    return outcome


def _undisturbed(places: Places) -> tuple[dict[str, Numbers], float]:
    expected: dict[str, Numbers] = {}
    seconds = 0.0
    for variant in VARIANTS:
        start = time.perf_counter()
        code, said = finish_run(places, variant)
        # the last one, with forms compiled and nothing stored
        seconds = time.perf_counter() - start
        if code:
            raise FaultError(f"an undisturbed run of {variant} ended with {code}: {said}")
        expected[variant] = read_numbers(places.results)
    return expected, seconds


def _kill_one(places: Places, variant: str, aim: str, seconds: float, chance: random.Random) -> str:
    process = start_run(places, variant)
    delay = chance.uniform(0.0, seconds) if aim == "any time" else chance.uniform(0.0, 0.003)
    if aim != "any time":
        while process.poll() is None and not _someone_writes(places):
            time.sleep(POLL_SECONDS)
    time.sleep(delay)
    ended = process.poll() is not None
    process.kill()
    # a child that outlived the run would keep this pipe open
    wait_for_end(process, seconds=SETTLE_SECONDS)
    _require_nothing_runs(process.pid)
    return "had ended before the kill" if ended else f"killed {aim}"


def _someone_writes(places: Places) -> bool:
    return any(
        name.startswith(".")
        for folder in (places.results, places.store)
        for _, _, names in os.walk(folder)
        for name in names
    )


def _require_nothing_runs(group: int) -> None:
    end = time.monotonic() + SETTLE_SECONDS
    while True:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        if time.monotonic() > end:
            os.killpg(group, signal.SIGKILL)
            raise FaultError("a child of the killed run was still running after 10 s")
        time.sleep(0.01)


def check_remains(places: Places, expected: dict[str, Numbers]) -> None:
    """Check that each file a killed run leaves is whole and one of the two results."""
    check_files(places.results)
    for numbers in (
        read_results(places.results / "results.h5"),
        read_summary_numbers(places.results / "summary.json"),
    ):
        if not any(numbers.equal(known) for known in expected.values()):
            raise FaultError("a file holds numbers of neither variant")


def _check_next(places: Places, variant: str, expected: Numbers) -> None:
    """The next run ends well, gives the numbers of an undisturbed one, and clears what the killed
    one left.
    """
    code, said = finish_run(places, variant)
    if code:
        raise FaultError(f"the next run ended with {code}: {said}")
    if not read_numbers(places.results).equal(expected):
        raise FaultError("the next run found other numbers")
    end = time.monotonic() + SETTLE_SECONDS
    while (
        left := check_files(places.results)
        + check_files(places.store)
        + _foreign_names(places.temporary)
    ):
        # a picture that was being drawn when the run was killed may still be drawn, and cleared
        # after that
        if time.monotonic() > end:
            raise FaultError(f"the next run left behind: {', '.join(left)}")
        time.sleep(0.1)


def _foreign_names(temporary: Path) -> list[str]:
    # a killed Open MPI leaves its session folder, which its next start clears by itself
    return [path.name for path in temporary.iterdir() if not path.name.startswith("ompi.")]
