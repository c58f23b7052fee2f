"""Runs on a disk that fills up: a named error or a right result, and the old result as it was."""

import json
import random
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from headstock.validation.campaign_outcome import CampaignOutcome
from headstock.validation.campaign_runs import VARIANTS, Numbers, Places, finish_run, make_places, read_numbers
from headstock.validation.errors import CampaignError
from headstock.validation.file_checks import check_files
from headstock.validation.small_disks import enter_own_view, small_disk

DISK_BYTES = 64 << 20
NAMED = ("No space left", "File too large", "MB free")
MOST_ROOM = 1.2  # of what an undisturbed run writes
MODULE = "headstock.validation.disk_campaign"
# what lies on the small disk besides the results, in turn
TEMPORARY = "tmp"
SHARED = ((), ("store",), ("store", TEMPORARY))


def run_disk_campaign(runs: int, *, seed: int, root: Path, on_trial: Callable[[CampaignOutcome], None]) -> CampaignOutcome:
    """Run into a file system (tmpfs) with too little or just enough room left; where none can be made, with a file size limit.

    Args:
        runs: How many.
        seed: Of the random sizes, which go from no room to enough.
        root: Empty folder to work in.
        on_trial: Told at the end.

    Raises:
        CampaignError: Not even an undisturbed run works.
    """
    # in a process of its own, because one that has threads cannot change its view of the file system
    done = subprocess.run([sys.executable, "-P", "-m", MODULE, str(root), str(runs), str(seed)], capture_output=True, text=True)
    if done.returncode:
        raise CampaignError(f"the campaign ended with {done.returncode}: {done.stderr.strip()[-2000:]}")
    found = json.loads(done.stdout)
    outcome = CampaignOutcome("disk", found["trials"], faults=found["faults"], notes=found["notes"])
    outcome.happened.update(found["happened"])
    on_trial(outcome)
    return outcome


def _campaign(root: Path, runs: int, seed: int) -> CampaignOutcome:
    outcome, chance = CampaignOutcome("disk"), random.Random(seed)
    try:
        enter_own_view()
    except CampaignError as error:
        outcome.notes.append(f"{error}; a limit on the size of each file took its place")
    expected, old = _undisturbed(root / "sound")
    limited = bool(outcome.notes)
    needed = sum(path.stat().st_size for folder in (old, root / "sound" / "store") for path in folder.rglob("*") if path.is_file())
    for trial in range(runs):
        room, shared = int((trial + chance.random()) / runs * MOST_ROOM * needed), SHARED[trial % len(SHARED)]
        try:
            folder = root / f"trial-{trial}"
            attempt = _on_limited_files if limited else _on_small_disk
            outcome.note_trial(attempt(folder, old, expected, room, shared))
        except CampaignError as error:
            outcome.note_trial("fault")
            outcome.faults.append(f"run {trial + 1} with {room} bytes of room, {' '.join(shared) or 'results only'}: {error}")
    return outcome


def _undisturbed(root: Path) -> tuple[dict[str, Numbers], Path]:
    """Numbers of both variants, and a folder with the finished first one."""
    places, expected = make_places(root), {}
    for variant in reversed(VARIANTS):
        code, said = finish_run(places, variant)
        if code:
            raise CampaignError(f"an undisturbed run of {variant} ended with {code}: {said}")
        expected[variant] = read_numbers(places.results)
    return expected, places.results


def _on_small_disk(folder: Path, old: Path, expected: dict[str, Numbers], room: int, shared: tuple[str, ...]) -> str:
    # where temporary files are on the small disk, forms are compiled too: the compiler writes there
    places = make_places(folder, cache=folder / "cache" if TEMPORARY in shared else None)
    with small_disk(folder / "disk", DISK_BYTES) as disk:
        shutil.copytree(old, disk / "results")
        places.results.symlink_to(disk / "results")
        for name in shared:
            (disk / name).mkdir()
            (folder / name).rmdir()
            (folder / name).symlink_to(disk / name)
        ballast = disk / "ballast"
        _fill(ballast, room)
        return _judge(places, old, expected)


def _on_limited_files(folder: Path, old: Path, expected: dict[str, Numbers], room: int, _shared: tuple[str, ...]) -> str:
    places = make_places(folder)
    shutil.copytree(old, places.results)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        return _judge(places, old, expected)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def _fill(ballast: Path, room: int) -> None:
    """Fill the disk up to the room that is wanted."""
    free = shutil.disk_usage(ballast.parent).free
    with ballast.open("wb") as file:
        file.write(bytes(max(free - room, 0)))


def _judge(places: Places, old: Path, expected: dict[str, Numbers]) -> str:
    before = {path.relative_to(old): path.read_bytes() for path in old.rglob("*") if path.is_file()}
    code, said = finish_run(places, VARIANTS[1])
    if check_files(places.results):
        raise CampaignError(f"temporaries stayed behind: {check_files(places.results)}")
    found = read_numbers(places.results)
    if code == 0:
        if not found.equal(expected[VARIANTS[1]]):
            raise CampaignError("the run ended with 0 and other numbers")
        return "enough room: the right result"
    if code != 1 or "Traceback" in said or "internal error" in said or not any(words in said for words in NAMED):
        raise CampaignError(f"the run ended with {code} and said: {said.strip()[-500:]}")
    if found.equal(expected[VARIANTS[1]]):
        return "exit 1 for want of room for the report; the new result whole"
    for name in ("results.h5", "summary.json"):
        if (places.results / name).read_bytes() != before[Path(name)]:
            raise CampaignError(f"the run ended with 1 and changed {name}")
    return "exit 1: the old result as it was"


def main(arguments: list[str]) -> int:
    """Run the campaign in this process and print its outcome as JSON."""
    outcome = _campaign(Path(arguments[0]), int(arguments[1]), int(arguments[2]))
    fields = {"trials": outcome.trials, "happened": outcome.happened, "faults": outcome.faults, "notes": outcome.notes}
    sys.stdout.write(json.dumps(fields))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
