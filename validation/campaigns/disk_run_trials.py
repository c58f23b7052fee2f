"""One run after the other on a disk that fills up: a named error or a right result, and the old result as it was."""

import shutil
from pathlib import Path

from headstock.validation.campaigns.campaign_outcome import CampaignError
from headstock.validation.campaigns.file_checks import check_files
from headstock.validation.campaigns.limited_rooms import limited_room
from headstock.validation.campaigns.runs import VARIANTS, Numbers, Places, finish_run, make_places, read_numbers

NAMED = ("No space left", "File too large", "MB free", "disk is full")
MOST_ROOM = 1.2  # of what an undisturbed one writes
# what lies on the small disk besides the results, in turn
TEMPORARY = "tmp"
SHARED = ((), ("store",), ("store", TEMPORARY))


def require_named(code: int, said: str) -> None:
    """Check that what did not end well ended with 1 and with words about the disk.

    Raises:
        CampaignError: It did not.
    """
    if code != 1 or "Traceback" in said or "internal error" in said or not any(words in said for words in NAMED):
        raise CampaignError(f"it ended with {code} and said: {said.strip()[-500:]}")


class RunTrials:
    """Runs of one variant over the finished result of another."""

    def __init__(self, root: Path, *, limited_files: bool) -> None:
        """Run both variants undisturbed.

        Raises:
            CampaignError: One of them does not work.
        """
        places = make_places(root)
        self._limited_files, self._old = limited_files, places.results
        self._expected: dict[str, Numbers] = {}
        for variant in reversed(VARIANTS):
            code, said = finish_run(places, variant)
            if code:
                raise CampaignError(f"an undisturbed run of {variant} ended with {code}: {said}")
            self._expected[variant] = read_numbers(places.results)
        folders = (places.results, places.store)
        self._needed = sum(path.stat().st_size for folder in folders for path in folder.rglob("*") if path.is_file())

    def attempt(self, folder: Path, share: float, turn: int) -> str:
        """Run with a share of the room needed, in a folder of its own; how it ended, in words.

        Raises:
            CampaignError: An end without a named error, a changed old result, a temporary left behind, other numbers.
        """
        shared = SHARED[turn % len(SHARED)]
        # where temporary files are on the small disk, forms are compiled too: the compiler writes there
        places = make_places(folder, cache=folder / "cache" if TEMPORARY in shared else None)
        with limited_room(folder, ("results", *shared), limited_files=self._limited_files) as set_room:
            shutil.copytree(self._old, places.results, dirs_exist_ok=True)
            set_room(int(MOST_ROOM * share * self._needed))
            return self._judge(places)

    def _judge(self, places: Places) -> str:
        before = {path.relative_to(self._old): path.read_bytes() for path in self._old.rglob("*") if path.is_file()}
        wanted = self._expected[VARIANTS[1]]
        code, said = finish_run(places, VARIANTS[1])
        if check_files(places.results):
            raise CampaignError(f"temporaries stayed behind: {check_files(places.results)}")
        found = read_numbers(places.results)
        if code == 0:
            if not found.equal(wanted):
                raise CampaignError("the run ended with 0 and other numbers")
            return "enough room: the right result"
        require_named(code, said)
        if found.equal(wanted):
            return "exit 1 for want of room for the report; the new result whole"
        for name in ("results.h5", "summary.json"):
            if (places.results / name).read_bytes() != before[Path(name)]:
                raise CampaignError(f"the run ended with 1 and changed {name}")
        return "exit 1: the old result as it was"
