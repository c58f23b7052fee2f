"""Runs, sweeps and studies on a disk that fills up: a named error or a right result, and the old
result as it was. Those that go on when there is more room lose nothing that was finished, and end as
undisturbed ones do.
"""

import os
import random
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from faults.file_checks import check_file, check_files
from faults.resume import SCENE as LONG_SCENE
from faults.resume import find_difference, read_content, start_resumable
from faults.runs import (
    VARIANTS,
    FaultError,
    Numbers,
    Outcome,
    Places,
    finish_run,
    in_own_process,
    make_places,
    read_numbers,
    wait_for_end,
)
from faults.small_disks import enter_own_view, limited_room
from headstock.pipeline.storage.outputs import LIST_FILE

NAMED = ("No space left", "File too large", "MB free", "disk is full")
MOST_ROOM = 1.2  # of what an undisturbed one writes
# what lies on the small disk besides the results, in turn
TEMPORARY = "tmp"
SHARED = ((), ("store",), ("store", TEMPORARY))
RESUMED = ("sweep", "study", "sweep on 2 ranks")
OLD = "old"
# an elastic part, so that the store has something to keep; fewer poses; and another material for
# the result that was there before
SCENE = (
    LONG_SCENE.replace('fidelity = "rigid"', 'mesh = { size = "75 mm" }')
    .replace('"200 mm", 500]', '"200 mm", 60]')
    .replace(
        "[6, 7, 8, 9, 10, 11, 12, 13]",
        '[6, 7, 8], "components.slide.mesh.size" = ["75 mm", "60 mm"]',
    )
    + f'[variants.{OLD}]\n"materials.steel.rho" = "7000 kg/m^3"\n'
)
# written while poses and points are finished, one whole record after the other
GROWING = (".journal", ".jsonl")
# hold seconds
TIMED = ("points.jsonl", "study.csv", "study.json")
EXTRA_ROOM = 0.5  # of what is needed, from one start of a trial to the next
MOST_STARTS = 4
ENOUGH = "enough room: the right result"
Bytes = dict[str, bytes]
# folder of scene and store, folder of results, kind, variant, environment; exit code and what was
# said on standard error
Start = Callable[[Path, Path, str, str | None, Mapping[str, str]], tuple[int, str]]
# what fills its disk, in turn; the last on two ranks
KINDS = ("run", *RESUMED)


def require_named(code: int, said: str) -> None:
    """Check that what did not end well ended with 1 and with words about the disk."""
    fault = "Traceback" in said or "internal error" in said
    if code != 1 or fault or not any(words in said for words in NAMED):
        raise FaultError(f"it ended with {code} and said: {said.strip()[-500:]}")


class RunTrials:
    """Runs of one variant over the finished result of another."""

    def __init__(self, root: Path, *, limited_files: bool) -> None:
        """Run both variants undisturbed."""
        places = make_places(root)
        self._limited_files, self._old = limited_files, places.results
        self._expected: dict[str, Numbers] = {}
        for variant in reversed(VARIANTS):
            code, said = finish_run(places, variant)
            if code:
                raise FaultError(f"an undisturbed run of {variant} ended with {code}: {said}")
            self._expected[variant] = read_numbers(places.results)
        self._needed = _size_of(places.results) + _size_of(places.store)

    def attempt(self, folder: Path, share: float, turn: int) -> str:
        """Run with a share of the room needed, in a folder of its own; how it ended, in words."""
        shared = SHARED[turn % len(SHARED)]
        # where temporary files are on the small disk, forms are compiled too: the compiler writes
        # there
        places = make_places(folder, cache=folder / "cache" if TEMPORARY in shared else None)
        names = ("results", *shared)
        with limited_room(folder, names, limited_files=self._limited_files) as set_room:
            shutil.copytree(self._old, places.results, dirs_exist_ok=True)
            set_room(int(MOST_ROOM * share * self._needed))
            return self._judge(places)

    def _judge(self, places: Places) -> str:
        before, wanted = _read_files(self._old), self._expected[VARIANTS[1]]
        code, said = finish_run(places, VARIANTS[1])
        if check_files(places.results):
            raise FaultError(f"temporaries stayed behind: {check_files(places.results)}")
        found = read_numbers(places.results)
        if code == 0:
            if not found.equal(wanted):
                raise FaultError("the run ended with 0 and other numbers")
            return ENOUGH
        require_named(code, said)
        if found.equal(wanted):
            return "exit 1 for want of room for the report; the new result whole"
        for name in ("results.h5", "summary.json"):
            if (places.results / name).read_bytes() != before[name]:
                raise FaultError(f"the run ended with 1 and changed {name}")
        return "exit 1: the old result as it was"


class ResumeTrials:
    """Sweeps or studies over the finished result of another variant."""

    def __init__(
        self,
        root: Path,
        kind: str,
        *,
        limited_files: bool,
        scene: str = SCENE,
        start: Start | None = None,
    ) -> None:
        """Leave both variants undisturbed once."""
        self._kind, self._scene = kind, scene
        self._limited_files, self._run = limited_files, start or _run_process
        self._old, self.results = root / "old", root / "results"
        root.mkdir(parents=True)
        for variant, folder in ((OLD, self._old), (None, self.results)):
            if variant is None:
                shutil.copytree(self._old, self.results)
            code, said = self._start(root, folder, variant)
            if code:
                raise FaultError(f"an undisturbed {kind} ended with {code}: {said}")
        self._expected, self._content = _read_files(self.results), read_content(self.results)
        self._before = _read_files(self._old)
        self._growing = sum(len(content) for content in _read_growing(self.results).values())
        self._needed = _size_of(self.results) + _size_of(root / "store", "*.h5")

    def attempt(self, folder: Path, share: float, turn: int) -> str:
        """Start with a share of the room needed, and again with more until it ends well; how it
        ended, in words."""
        # Open MPI keeps files of its own where temporary files are
        ranks = "ranks" in self._kind
        choices = [names for names in SHARED if not (ranks and TEMPORARY in names)]
        shared = choices[turn % len(choices)]
        (folder / "store").mkdir(parents=True)
        (folder / TEMPORARY).mkdir()
        # every other disk is full while poses and points are finished, the others at any time
        room = int(share * (1.1 * self._growing if turn % 2 else MOST_ROOM * self._needed))
        names = ("results", *shared)
        with limited_room(folder, names, limited_files=self._limited_files) as set_room:
            shutil.copytree(self._old, folder / "results", dirs_exist_ok=True)
            said_before: list[str] = []
            for start in range(MOST_STARTS):
                last = start == MOST_STARTS - 1
                set_room(None if last else room + int(start * EXTRA_ROOM * self._needed))
                finished = _read_growing(folder / "results")
                code, said = self._start(
                    folder, folder / "results", None, own_cache=TEMPORARY in shared
                )
                self._check_remains(folder / "results", finished)
                if code == 0:
                    self._require_whole(folder / "results")
                    after = f"after {', '.join(said_before)}"
                    return f"the right result {after}" if start else ENOUGH
                require_named(code, said)
                said_before.append(said.partition(":")[0].splitlines()[-1])
        raise FaultError("it ended with 1 and enough room")

    def _start(
        self, root: Path, folder: Path, variant: str | None, *, own_cache: bool = False
    ) -> tuple[int, str]:
        (root / "scene.toml").write_text(self._scene)
        (root / TEMPORARY).mkdir(exist_ok=True)
        places = {"TMPDIR": str(root / TEMPORARY)} | (
            {"XDG_CACHE_HOME": str(root / TEMPORARY / "cache")} if own_cache else {}
        )
        return self._run(root, folder, self._kind, variant, places)

    def _check_remains(self, results: Path, finished: Bytes) -> None:
        """Every file is whole, and the old or the new one; what was finished before the start is
        there still.
        """
        for name, content in _read_files(results).items():
            if Path(name).name.startswith("."):
                raise FaultError(f"a temporary stayed behind: {name}")
            if name in TIMED:
                check_file(results / name)
            elif content not in (self._before.get(name), self._expected.get(name)):
                raise FaultError(f"{name} is neither the old nor the new one")
        growing = _read_growing(results)
        for name, content in finished.items():
            if name in growing and not growing[name].startswith(content):
                raise FaultError(f"{name} lost what was finished before")

    def _require_whole(self, results: Path) -> None:
        found = _read_files(results)
        if found.keys() != self._expected.keys():
            others = sorted(found.keys() ^ self._expected.keys())
            raise FaultError(f"other files than those of an undisturbed one: {others}")
        for name, content in self._expected.items():
            if name not in TIMED and found[name] != content:
                raise FaultError(f"{name} differs from that of an undisturbed one")
        if self._kind == "study" and (
            difference := find_difference(read_content(results), self._content)
        ):
            raise FaultError(f"the content is not that of an undisturbed one: {difference}")


def _size_of(folder: Path, pattern: str = "*") -> int:
    return sum(path.stat().st_size for path in folder.rglob(pattern) if path.is_file())


def _read_files(folder: Path) -> Bytes:
    """Content of every file that does not grow by records, by its name."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != LIST_FILE and path.suffix not in GROWING
    }


def _read_growing(folder: Path) -> Bytes:
    return {
        path.name: path.read_bytes()
        for suffix in GROWING
        for path in sorted(folder.rglob(f"*{suffix}"))
    }


def _run_process(
    root: Path, folder: Path, kind: str, variant: str | None, places: Mapping[str, str]
) -> tuple[int, str]:
    environment = {**os.environ, **places}
    process = start_resumable(root, folder, kind, variant=variant, environment=environment)
    said = wait_for_end(process)
    return process.returncode, said


def fill_disks(runs: int, *, seed: int, root: Path, kinds: Sequence[str] = KINDS) -> Outcome:
    """Work into a file system (tmpfs) with too little or just enough room left; where none can be
    made, with a file size limit."""
    # one that has threads cannot change its view of the file system
    return in_own_process(_fill_disks, root, runs, seed, kinds)


def _fill_disks(root: Path, runs: int, seed: int, kinds: Sequence[str]) -> Outcome:
    outcome, chance = Outcome(), random.Random(seed)
    try:
        enter_own_view()
    except FaultError as error:
        outcome.notes.append(f"{error}; a limit on the size of each file took its place")
    limited = bool(outcome.notes)
    kinds = [kind for kind in kinds if shutil.which("mpirun") or "ranks" not in kind]
    trials = {
        kind: RunTrials(root / "sound", limited_files=limited)
        if kind == "run"
        else ResumeTrials(root / kind.replace(" ", "-"), kind, limited_files=limited)
        for kind in kinds
    }
    for trial in range(runs):
        kind, turn = kinds[trial % len(kinds)], trial // len(kinds)
        # of each kind the room grows from trial to trial
        share = (turn + chance.random()) / -(-runs // len(kinds))
        try:
            ending = trials[kind].attempt(root / f"trial-{trial}", share, turn)
            outcome.note_trial(f"{kind}: {ending}")
        except FaultError as error:
            outcome.note_trial(f"{kind}: fault")
            outcome.faults.append(f"trial {trial + 1} ({kind}, {share:.3f} of all room): {error}")
    return outcome
