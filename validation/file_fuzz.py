"""Mesh, superelement, STEP, force and target files damaged at random: read, or refused by name; the process that asks never falls."""

import random
import resource
from collections.abc import Callable
from pathlib import Path

from headstock.geometry.components import Component
from headstock.geometry.errors import HeadstockError
from headstock.geometry.materials import Material
from headstock.geometry.solids import MeshFile, StepFile
from headstock.meshing.component_meshing import describe_component, mesh_component
from headstock.pipeline.force_files import read_forces
from headstock.pipeline.resources import peak_memory_mb
from headstock.pipeline.scene_errors import SceneError
from headstock.pipeline.superelement_files import read_superelement
from headstock.pipeline.target_files import load_targets
from headstock.validation.campaign_outcome import CampaignOutcome
from headstock.validation.errors import CampaignError
from headstock.validation.sample_files import write_samples
from headstock.validation.scene_fuzz import MACHINES
from headstock.validation.text_mutations import mutate_bytes, mutate_text

SECONDS_ALLOWED = 10.0
MB_ALLOWED = 1024.0
TARGETS = ".toml"
STEEL = Material("steel", 2.1e11, 0.3, 7850.0)
KINDS = (".msh", ".inp", ".bdf", ".h5", ".csv", TARGETS)
STEP_EVERY = 10  # the shipped STEP part takes a second to read


def run_file_fuzz(runs: int, *, seed: int, root: Path, on_trial: Callable[[CampaignOutcome], None]) -> CampaignOutcome:
    """Read damaged files of each kind in turn.

    A fault is anything but success or a named error, more than ``SECONDS_ALLOWED`` of processor time, or a process that grows beyond
    ``MB_ALLOWED``. Readers of superelements, forces and targets run in this process, the first once a child has survived the file.

    Args:
        runs: How many files.
        seed: Of the damage.
        root: Empty folder to work in.
        on_trial: Told after each file.

    Raises:
        CampaignError: A sound file is refused.
    """
    outcome, samples, earlier_mb = CampaignOutcome("files"), write_samples(root), _largest_child_mb()
    steps = sorted(MACHINES.glob("*.step"))
    if steps:
        samples[".step"] = steps[0].read_bytes()
    samples[TARGETS] = (MACHINES / "three_axis_targets.toml").read_bytes()
    for suffix, content in samples.items():
        ending = try_file(root / f"sound{suffix}", content)
        if ending != "read":
            raise CampaignError(f"a sound {suffix} file is not read: {ending}")
    for number in range(runs):
        suffix = ".step" if steps and number % STEP_EVERY == 0 else KINDS[number % len(KINDS)]
        damaged = _damage(suffix, samples[suffix], random.Random(f"{seed}/{number}"))
        before = _used_seconds()
        try:
            ending = try_file(root / f"damaged{suffix}", damaged)
        except Exception as error:
            ending = f"{type(error).__name__}: {str(error)[:300]}"
            outcome.faults.append(f"file {number} ({suffix}): {ending}")
        seconds = _used_seconds() - before
        outcome.note_trial(f"{suffix} {ending.partition(':')[0]}", seconds=seconds)
        if seconds > SECONDS_ALLOWED:
            outcome.faults.append(f"file {number} ({suffix}) took {seconds:.1f} s")
        on_trial(outcome)
    outcome.peak_mb = _largest_child_mb()
    # the largest of all children there ever were, each starting at the size of the process that forked it
    if outcome.peak_mb > max(MB_ALLOWED, earlier_mb, peak_memory_mb()):
        outcome.faults.append(f"a reader grew to {outcome.peak_mb:.0f} MB, {MB_ALLOWED:.0f} are allowed")
    return outcome


def try_file(path: Path, content: bytes) -> str:
    """Write and read a file as a scene would; how it ended.

    Raises:
        Exception: Whatever no reader should raise.
    """
    path.write_bytes(content)
    try:
        if path.suffix == ".h5":
            read_superelement(path)
        elif path.suffix == ".csv":
            read_forces(path)
        elif path.suffix == TARGETS:
            load_targets(path, MACHINES / "three_axis.toml")
        elif path.suffix == ".step":
            describe_component(Component("part", StepFile(path), STEEL))
        else:
            mesh_component(Component("part", MeshFile(path, 1.0), STEEL))
    except (HeadstockError, SceneError) as error:
        return f"refused: {error}"
    return "read"


def _damage(suffix: str, content: bytes, chance: random.Random) -> bytes:
    if suffix != TARGETS:
        return mutate_bytes(content, chance)
    text = content.decode()
    return mutate_text(text, (text,), chance).encode(errors="surrogatepass")


def _used_seconds() -> float:
    """Processor time of this process and of all children that ended."""
    usages = (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def _largest_child_mb() -> float:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0
