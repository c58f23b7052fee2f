"""What the ranks on a node hold together, against the memory of that node."""

import contextlib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from headstock.pipeline.planning.budgets import BASE_MB, WAY_KEYS, BudgetError
from headstock.pipeline.planning.plan import Stage

OWN_GROUP, GROUPS = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class RanksOnNodes:
    """Where the ranks of a run are.

    Attributes:
        ranks: How many there are.
        together: The most that are on one node.
        memory_mb: The least that a node has for them.
    """

    ranks: int
    together: int
    memory_mb: float


def node_memory_bytes(
    variables: Mapping[str, str] = os.environ, own_group: Path = OWN_GROUP, groups: Path = GROUPS
) -> float:
    """Memory [byte] that this node has for this job: the machine's, or less where Slurm or a control
    group allows less.

    Args:
        variables: Of the environment, with what Slurm says of the job.
        own_group: File with the control group of this process.
    """
    limits = [float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))]
    # 0 is all memory of the node
    with contextlib.suppress(KeyError, ValueError):
        limits.append(float(variables["SLURM_MEM_PER_NODE"]) * 2**20)
    with contextlib.suppress(KeyError, ValueError):
        cpus = float(variables["SLURM_CPUS_ON_NODE"])
        limits.append(float(variables["SLURM_MEM_PER_CPU"]) * cpus * 2**20)
    with contextlib.suppress(OSError):
        own = own_group.read_text().rpartition("::")[2].strip().strip("/")
        for group in (groups / own, *(groups / own).parents):
            if not group.is_relative_to(groups):
                break
            with contextlib.suppress(OSError, ValueError):  # "max" is none
                limits.append(float((group / "memory.max").read_text()))
    return min(limit for limit in limits if limit > 0.0)


def memory_on_node(stage: Stage, held: RanksOnNodes, *, split: bool) -> float:
    """Peak memory [MB] of all ranks on a node while a component is meshed or reduced.

    Args:
        stage: With its estimate for one rank.
        split: Whether all ranks share the stage, or one does it and the others wait.
    """
    waiting = BASE_MB * (held.together - 1)
    alone = stage.estimated_memory_mb or 0.0
    if not split:
        return alone + waiting
    return BASE_MB + waiting + max(0.0, alone - BASE_MB) * held.together / held.ranks


def check_memory(
    stages: Sequence[Stage],
    limit_bytes: float | None,
    *,
    held: RanksOnNodes | None = None,
    split_dofs: float = math.inf,
) -> None:
    """Refuse stages that would need more memory than the scene allows, or than a node has.

    Args:
        limit_bytes: ``limits.memory`` of the scene; None for what the node has.
        held: Where the ranks are; None for one rank on this machine.
        split_dofs: Larger components are split over all ranks.

    Raises:
        BudgetError: Names the stage, its estimate and the limit.
    """
    held = held or RanksOnNodes(1, 1, node_memory_bytes() / 1e6)
    limit_mb = held.memory_mb if limit_bytes is None else limit_bytes / 1e6
    for stage in stages:
        # meshing is rank 0's
        split = stage.kind == "reduce" and (stage.estimated_dofs or 0) > split_dofs
        need_mb = memory_on_node(stage, held, split=split)
        if stage.estimated_memory_mb is not None and need_mb > limit_mb:
            whose = "this machine has" if limit_bytes is None else "limits.memory allows"
            where, remedy = "", "write a larger mesh size or keep fewer modes"
            what = (
                f" of component {stage.component!r} with about {stage.estimated_dofs or 0:.3g} dofs"
            )
            whole = "component"
            if stage.component is None:
                what, whole = "", stage.kind
                remedy = WAY_KEYS.get(stage.kind, "write a lower sampling")
            if held.ranks > 1:
                how = f"that share the {whole}" if split else f"of which one has the {whole}"
                where = f" on a node with {held.together} of {held.ranks} ranks, {how}"
                remedy += ", or start fewer ranks on a node"
            raise BudgetError(
                f"{stage.kind}{what} would need about {need_mb:.3g} MB{where}; {whose} {limit_mb:.3g} MB; {remedy}"
            )
