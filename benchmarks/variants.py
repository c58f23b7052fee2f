"""Effort of a machine model at each fidelity: from scene to modes, for a changed part, and for many
values of a joint stiffness.

    HEADSTOCK_THREADS=1 ./headstock exec python3 benchmarks/variants.py [--values 1000] [--joint
    z_drive] [--json FILE]

The machine is machines/three_axis.toml with its columns and Y-base rigid, segmented or elastic.
Each fidelity begins with an empty store: first model, then columns 45 mm thick, then the joint's
stiffness from a tenth to ten times its value, with all modes up to 300 Hz and the compliance at the
tool for each value. Superelements are made once; each value couples them anew. Imports are apart.
"""

import argparse
import dataclasses
import json
import os
import tempfile
import time
from pathlib import Path
from typing import TypedDict

import numpy as np
from mpi4py import MPI

from headstock.geometry.machine.machine import Machine
from headstock.pipeline.answers.static import UM_PER_KN
from headstock.pipeline.storage.store import Store
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.compliance_budget import point_compliance
from headstock.scene.building.loader import load_scene
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.studies.comparison_summary import summarise_effort
from headstock.studies.variants import VariantChoice, VariantSolution, solve_variant

SCENE = Path(__file__).resolve().parents[1] / "machines" / "three_axis.toml"
PARTS = ("column_left", "column_right", "y_base")
FIDELITIES = ("rigid", "segmented", "elastic")
THICKER = tuple(f'components.{name}.solid.box=["45 mm", "100 mm", "500 mm"]' for name in PARTS[:2])
UP_TO_HZ, POINT = 300.0, "tcp"


class ManyValues(TypedDict):
    """What a joint's stiffnesses took and gave: seconds, modes in all, least and largest compliance
    [um/kN].
    """

    cpu: float
    wall: float
    modes: int
    compliance_um_per_kN: list[float]


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print its table."""
    options = _parse(arguments)
    print(
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {os.environ.get('OMP_NUM_THREADS', '?')} BLAS thread(s)"
    )
    print(
        f"imports {time.process_time():.2f} CPU s, and the finite element library where it is needed (below)"
    )
    print(
        f"\n| fidelity | dofs | first model CPU s (wall) | import s | thicker columns CPU s (wall) | {options.values} values CPU s (wall) |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    rows, stiffened = [], []
    for fidelity in FIDELITIES:
        with tempfile.TemporaryDirectory(prefix="headstock-benchmark-") as folder:
            store = Store(Path(folder))
            first, changed = _solve(fidelity, (), store), _solve(fidelity, THICKER, store)
        many = _vary_joint(first, fidelity, options.joint, options.values)
        stiffened.append(many)
        efforts = [
            f"{run.effort.cpu_total:.3f} ({run.effort.total:.3f})" for run in (first, changed)
        ]
        dofs = len(first.machine.system.labels)
        print(
            f"| {fidelity} | {dofs} | {efforts[0]} | {first.effort.import_seconds:.2f} | {efforts[1]} | {many['cpu']:.1f} ({many['wall']:.1f}) |",
            flush=True,
        )
        rows.append(
            {
                "fidelity": fidelity,
                "dofs": dofs,
                "first": summarise_effort(first.effort),
                "changed": summarise_effort(changed.effort),
                "values": many,
            }
        )
    for fidelity, many in zip(FIDELITIES, stiffened, strict=True):
        low, high = many["compliance_um_per_kN"]
        print(
            f"{fidelity}: dz/Fz at {POINT} from {high:.2f} to {low:.2f} um/kN as {options.joint} stiffens a hundredfold"
        )
    if options.json is not None:
        options.json.write_text(
            json.dumps({"values": options.values, "joint": options.joint, "rows": rows}, indent=1)
            + "\n"
        )
    return 0


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--values", type=int, default=1000, help="values of the joint's stiffness [1000]"
    )
    parser.add_argument("--joint", default="z_drive", help="a joint of the scene [z_drive]")
    parser.add_argument("--json", type=Path, help="write every number")
    return parser.parse_args(arguments)


def _overrides(fidelity: str) -> tuple[str, ...]:
    return tuple(f"components.{name}.fidelity={fidelity}" for name in PARTS)


def _solve(fidelity: str, more: tuple[str, ...], store: Store) -> VariantSolution:
    solution = solve_variant(
        SCENE,
        VariantChoice(fidelity, None, (*_overrides(fidelity), *more)),
        pose=None,
        comm=MPI.COMM_SELF,
        store=store,
    )
    if solution is None:
        raise SystemExit("run the benchmark on one rank")
    return solution


def _vary_joint(solution: VariantSolution, fidelity: str, joint: str, count: int) -> ManyValues:
    """Couple the superelements for many stiffnesses of a joint; modes and compliance for each."""
    scene = load_scene(SCENE, overrides=_overrides(fidelity))
    parts, pose = solution.machine.parts.superelements, scene.poses[solution.pose]
    start, cpu_start = time.perf_counter(), time.process_time()
    compliances, modes = [], 0
    for factor in np.geomspace(0.1, 10.0, count):
        coupled = couple(parts, _stiffen(scene.machine, joint, float(factor)), pose)
        modes += len(solve_modal(coupled.system, up_to_hz=UP_TO_HZ).frequencies_hz)
        compliances.append(UM_PER_KN * float(point_compliance(coupled, POINT)[2, 2]))
    cpu, wall = time.process_time() - cpu_start, time.perf_counter() - start
    return {
        "cpu": cpu,
        "wall": wall,
        "modes": modes,
        "compliance_um_per_kN": [min(compliances), max(compliances)],
    }


def _stiffen(machine: Machine, joint: str, factor: float) -> Machine:
    changed = dataclasses.replace(
        machine.joints[joint], stiffness=factor * machine.joints[joint].stiffness
    )
    return dataclasses.replace(machine, joints={**machine.joints, joint: changed})


if __name__ == "__main__":
    raise SystemExit(main())
