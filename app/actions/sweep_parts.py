"""One task of an array job: its share of a sweep's poses, into journals; the files of the sweep are made when all are collected."""

import re

import click
from mpi4py import MPI

from headstock.app.terminal.console import counted, make_console, print_stage
from headstock.app.terminal.guard import DONE
from headstock.pipeline.storage.outputs import prepare_output
from headstock.solvers.rank_messages import share_from_root
from headstock.studies.sweeps.runs import Part, SweepJob, run_sweep, sweep_key
from headstock.studies.sweeps.slurm_tools import SlurmError


def parse_part(text: str) -> Part:
    """``2/3`` as the second of three parts; ``0/3`` has no poses.

    Raises:
        click.UsageError: The text is no part.
    """
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if found is None or not 0 <= int(found[1]) <= int(found[2]):
        raise click.UsageError(f"--part {text[:40]!r} is no part; write for example 2/3")
    return Part(int(found[1]), int(found[2]))


def compute_part(job: SweepJob, key: str | None, comm: MPI.Comm) -> int:
    """Compute the poses of one part that are in no journal yet.

    Raises:
        SlurmError: What is computed here is not what was submitted.
        HeadstockError: A component cannot be reduced, or a journal cannot be written.
    """
    if comm.rank == 0:
        prepare_output(job.folder)
        if key is not None and sweep_key(job.scene) != key:
            raise SlurmError(
                "the scene, its files, this program or its libraries have changed since the job was submitted, or are others on this "
                "node; submit again, from a checkout and an environment that the nodes share"
            )
    share_from_root(comm, True)
    outcome = run_sweep(job, comm=comm, observer=print_stage)
    if comm.rank == 0:
        poses = counted(outcome.computed, "pose")
        make_console().print(
            f"part {job.part.number} of {job.part.of}: {poses} computed, {counted(comm.size, 'rank')}", markup=False
        )
    return DONE
