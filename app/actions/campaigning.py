"""``headstock campaign``: faults on purpose, again and again, and what came of them."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import click

from headstock.app.terminal.console import make_console
from headstock.app.terminal.guard import DONE, FAILED
from headstock.pipeline.storage.json_texts import dump_json
from headstock.pipeline.storage.outputs import write_output
from headstock.validation.campaigns.disk import run_disk_campaign
from headstock.validation.campaigns.file_fuzz import run_file_fuzz
from headstock.validation.campaigns.kill import run_kill_campaign
from headstock.validation.campaigns.resume import run_resume_campaign
from headstock.validation.campaigns.runs import CampaignOutcome
from headstock.validation.campaigns.scene_fuzz import run_scene_fuzz
from headstock.validation.campaigns.slurm import run_slurm_campaign

Campaign = Callable[..., CampaignOutcome]
# what each does, and how many trials it makes unless told otherwise
CAMPAIGNS: dict[str, tuple[Campaign, int]] = {
    "kill": (run_kill_campaign, 200),
    "disk": (run_disk_campaign, 20),
    "fuzz": (run_scene_fuzz, 100_000),
    "files": (run_file_fuzz, 500),
    "resume": (run_resume_campaign, 60),
    "slurm": (run_slurm_campaign, 4),
}
PROGRESS_SECONDS = 20.0


def run_campaign(name: str, trials: int | None, seed: int, json_file: Path | None) -> int:
    """Run one campaign and print how its trials ended.

    Args:
        name: Which kind of faults.
        trials: How many; as many as its kind has by default where it is None.
        seed: Of everything random.
        json_file: Where what is printed goes too.

    Raises:
        click.UsageError: There is no such campaign.
    """
    if name not in CAMPAIGNS:
        raise click.UsageError(f"no campaign {name!r}; there are: {', '.join(CAMPAIGNS)}")
    campaign, usual = CAMPAIGNS[name]
    wanted = usual if trials is None else trials
    start = told = time.perf_counter()
    progress = make_console(stderr=True)

    def tell(outcome: CampaignOutcome) -> None:
        nonlocal told
        if time.perf_counter() - told > PROGRESS_SECONDS:
            told = time.perf_counter()
            progress.print(f"{outcome.trials} of {wanted}, {len(outcome.faults)} faults, {told - start:.0f} s")

    with tempfile.TemporaryDirectory(prefix="headstock-campaign-") as folder:
        outcome = campaign(wanted, seed=seed, root=Path(folder), on_trial=tell)
    seconds = time.perf_counter() - start
    _print_outcome(outcome, seconds)
    if json_file is not None:
        content = {**vars(outcome), "seed": seed, "seconds": seconds}
        write_output(json_file, dump_json(content).encode())
    return FAILED if outcome.faults else DONE


def _print_outcome(outcome: CampaignOutcome, seconds: float) -> None:
    console = make_console()
    console.print(f"{outcome.name}: {outcome.trials} trials in {seconds:.0f} s, {len(outcome.faults)} faults")
    for ending, count in outcome.happened.most_common():
        console.print(f"  {count:7d}  {ending}", markup=False)
    if outcome.slowest_seconds:
        console.print(f"  slowest trial {outcome.slowest_seconds:.2f} s, largest {outcome.peak_mb:.0f} MB")
    for text in (*outcome.notes, *outcome.faults):
        console.print(f"  {text}", markup=False)
