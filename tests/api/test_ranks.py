"""A script on two ranks gets the answers of one process, on every rank."""

import shutil
import sys
from pathlib import Path

import pytest

from common import approx, read_json, run_on_ranks
from fixture_machines import machine, targets

SCENE = machine("""
machine = "block"
components.block.solid = { box = ["100 mm", "100 mm", "300 mm"] }
components.block.fidelity = "elastic"
components.block.mesh = { size = "100 mm" }
joints.mount.stiffness = { x = "10 N/um", y = "12 N/um", z = "40 N/um", rx = "1 MN m/rad", ry = "1 MN m/rad", rz = "1 MN m/rad" }
axes.X = { joints = ["mount"], direction = "x", limits = ["-50 mm", "50 mm"] }
sweeps.line = { axes = { X = ["0 mm", "10 mm", 3] } }
variants.heavy = { "materials.steel.rho" = "9000 kg/m^3" }
analyses.modal.count = 4
""")
TARGETS = targets(60, 70, mount="joints.mount.stiffness.x: 2 N/um, 50 N/um")
SCRIPT = """
import json, os, sys
import headstock as hs

stages = []
run = hs.run("scene.toml", output="out", progress=lambda done: stages.append(done.stage.kind))
study = hs.study(
    "scene.toml",
    vary={"joints.mount.stiffness.x": [8e6, 12e6]},
    watch=["modal.frequencies_hz[0]"],
    output="points",
)
sweep = hs.sweep("scene.toml", "line", output="swept")
rank = os.environ.get("OMPI_COMM_WORLD_RANK", "0")
answers = {
    "run": list(run.modes["reference"].frequencies_hz),
    "opened": list(hs.open("out").modes["reference"].frequencies_hz),
    "compliance": run.compliance["tcp"].tolist(),
    "study": [row.values["modal.frequencies_hz[0]"] for row in study.rows],
    "sweep": sweep.frequencies_hz.tolist(),
    "compare": [
        {name: cell.frequency_hz for name, cell in row.cells.items()}
        for row in hs.compare("scene.toml", ["heavy"]).rows
    ],
    "identify": hs.identify("scene.toml", "targets.toml").values,
    "made": len(stages) > 0 if rank == "0" else stages == [],
    "points": run.mesh("block").n_points > 0,
}
with open(f"answers{sys.argv[1]}_{rank}.json", "w") as file:
    json.dump(answers, file)
"""


@pytest.mark.trials
@pytest.mark.mpi
def test_every_rank_gets_what_one_process_gets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "targets.toml").write_text(TARGETS)
    (tmp_path / "script.py").write_text(SCRIPT)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HEADSTOCK_STORE", "store1")
    monkeypatch.setattr(sys, "argv", ["script.py", "1"])
    exec(SCRIPT, {})
    for folder in ("points", "swept"):
        shutil.rmtree(folder)
    # as ``./headstock python --ranks 2 script.py 2`` does
    done = run_on_ranks(2, tmp_path, "-m", "mpi4py", "script.py", "2")
    assert done.returncode == 0, done.stderr[-3000:]
    alone, first, second = (
        read_json(Path(f"answers{name}.json")) for name in ("1_0", "2_0", "2_1")
    )
    assert alone["made"]
    assert first == second
    assert first.keys() == alone.keys()
    for key in ("run", "opened", "study"):
        assert first[key] == approx(alone[key], rel=1e-8)
    assert first["identify"]["mount"] == approx(alone["identify"]["mount"], rel=1e-5)
    assert len(first["sweep"]) == len(alone["sweep"]) == 3
    for found, wanted in zip(first["sweep"], alone["sweep"], strict=True):
        assert found == approx(wanted, rel=1e-8)
    assert first["compare"][0].keys() == alone["compare"][0].keys()
