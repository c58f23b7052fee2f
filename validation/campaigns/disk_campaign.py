"""Runs, sweeps and studies on a disk that fills up: a named error or a right result, nothing torn, nothing lost."""

import json
import random
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from headstock.validation.campaigns.campaign_outcome import CampaignError, CampaignOutcome
from headstock.validation.campaigns.disk import RESUMED, ResumeTrials
from headstock.validation.campaigns.disk_run_trials import RunTrials
from headstock.validation.campaigns.small_disks import enter_own_view

MODULE = "headstock.validation.campaigns.disk_campaign"
# what fills its disk, in turn; the last on two ranks
KINDS = ("run", *RESUMED)


def run_disk_campaign(
    runs: int, *, seed: int, root: Path, on_trial: Callable[[CampaignOutcome], None], kinds: Sequence[str] = KINDS
) -> CampaignOutcome:
    """Work into a file system (tmpfs) with too little or just enough room left; where none can be made, with a file size limit.

    Args:
        runs: How many.
        seed: Of the random sizes, which go from no room to enough.
        root: Empty folder to work in.
        on_trial: Told at the end.
        kinds: Which of ``KINDS`` are tried in turn.

    Raises:
        CampaignError: Not even undisturbed ones work.
    """
    # in a process of its own, because one that has threads cannot change its view of the file system
    command = [sys.executable, "-P", "-m", MODULE, str(root), str(runs), str(seed), *kinds]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise CampaignError(f"the campaign ended with {done.returncode}: {done.stderr.strip()[-2000:]}")
    found = json.loads(done.stdout)
    outcome = CampaignOutcome("disk", found["trials"], faults=found["faults"], notes=found["notes"])
    outcome.happened.update(found["happened"])
    on_trial(outcome)
    return outcome


def _campaign(root: Path, runs: int, seed: int, kinds: Sequence[str]) -> CampaignOutcome:
    outcome, chance = CampaignOutcome("disk"), random.Random(seed)
    try:
        enter_own_view()
    except CampaignError as error:
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
            outcome.note_trial(f"{kind}: {trials[kind].attempt(root / f'trial-{trial}', share, turn)}")
        except CampaignError as error:
            outcome.note_trial(f"{kind}: fault")
            outcome.faults.append(f"trial {trial + 1} ({kind}, {share:.3f} of all room): {error}")
    return outcome


def main(arguments: list[str]) -> int:
    """Run the campaign in this process and print its outcome as JSON."""
    outcome = _campaign(Path(arguments[0]), int(arguments[1]), int(arguments[2]), arguments[3:])
    fields = {"trials": outcome.trials, "happened": outcome.happened, "faults": outcome.faults, "notes": outcome.notes}
    sys.stdout.write(json.dumps(fields))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
