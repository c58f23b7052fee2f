"""What a run says of its errors: interfaces whose kind matters, numbers that are no more than guesses."""

from types import SimpleNamespace

import numpy as np
from mpi4py import MPI

from headstock.pipeline.error_estimates import DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.result_warnings import find_warnings
from headstock.pipeline.runner import run_scene
from headstock.pipeline.scene_loader import load_scene
from headstock.pipeline.store import Store

SCENE = """
name = "two halves"
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.lower]
solid = { box = ["40 mm", "60 mm", "200 mm"] }
material = "steel"
mesh = { size = "20 mm", cells = "hex" }
interfaces = { foot = { face = "z-", coupling = "average" }, top = { face = "z+" } }
[components.upper]
solid = { box = ["40 mm", "60 mm", "200 mm"] }
material = "steel"
at = ["0 mm", "0 mm", "200 mm"]
mesh = { size = "20 mm", cells = "hex" }
interfaces = { foot = { face = "z-" }, top = { face = "z+", coupling = "average" } }
[joints.clamp]
between = ["ground", "lower.foot"]
kind = "rigid"
[joints.glue]
between = ["lower.top", "upper.foot"]
kind = "rigid"
[analyses.modal]
count = 6
spread = true
"""


def test_interfaces_whose_kind_matters_are_named_with_about_the_range_that_both_kinds_span(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    store = Store(tmp_path / "store")
    results = run_scene(load_scene(tmp_path / "scene.toml"), tmp_path / "out", comm=MPI.COMM_SELF, store=store)
    modes = results.modal[0]
    words = next(words for words in modes.errors[-1].left_out if "interfaces" in words)
    assert "lower.top" in words
    assert "upper.foot" in words
    assert "upper.top" not in words  # a free end passes no force on
    named = float(words.split("about ")[1].split(" Hz")[0])
    widest = max(high - low for low, high in modes.spread_hz)
    assert widest / 3.0 < named < 3.0 * widest


def test_a_number_that_is_less_than_twice_its_error_is_warned_of_with_its_owner_and_a_remedy():
    def guess(source, size):
        return Estimate({source: size}, (), {source: {"column": size, "base": 0.1 * size}})

    point = SimpleNamespace(
        compliance=np.diag([1.0, 0.885, 1.0]), errors={"x": guess(DISCRETISATION, 0.1), "y": guess(DISCRETISATION, 8.0)}
    )
    modes = SimpleNamespace(frequencies_hz=np.array([0.0, 50.0]), rigid_count=1, errors=(Estimate(), guess(REDUCTION, 30.0)))
    frf = SimpleNamespace(frf=None)
    state = SimpleNamespace(scene=SimpleNamespace(analyses=frf), reduced={}, modal=[modes], static={"reference": {"tcp": point}})
    found = find_warnings(state)
    assert len(found) == 2
    assert "component 'column': frequency 2 (50 Hz)" in found[0]
    assert "reduction.modes_to" in found[0]
    assert "the y compliance at tcp" in found[1]
    assert "9 times its value" in found[1]
    assert "smaller mesh size" in found[1]
