"""Lobes of the mill: at which speed of the spindle does a mill of 16 mm cut deepest?

    ./headstock python examples/mill_lobes.py

The first argument is a variant of the machine: `thick`, `rollers`, `rigid`.
"""

import json
import sys
from pathlib import Path

import headstock as hs

scene = Path(__file__).resolve().parents[1] / "machines" / "mill.toml"
machine = hs.load(
    scene,
    variant=sys.argv[1] if len(sys.argv) > 1 else None,
    set={
        "analyses.lobes.speeds": ["4000 rpm", "10000 rpm", 13],
        "analyses.lobes.directions": ["x"],
        "analyses.lobes.material": "al7075-t6",
    },
)
hs.run(machine, analyses=["lobes"], output="results/mill_lobes")
summary = json.loads(Path("results/mill_lobes/summary.json").read_text())
(along_x,) = summary["lobes"]["reference"]["directions"]
lowest = along_x["lowest"]
print(
    f"lowest limit {lowest['limit_depth_mm']:.2f} mm at {lowest['rpm']:.0f} rpm: {lowest['mode']}"
)
series = along_x["series"]
for rpm, depth, limited in zip(
    series["rpm"], series["limit_depth_mm"], series["limited"], strict=True
):
    print(f"{rpm:6.0f} rpm  {'' if limited else 'above '}{depth:.2f} mm")
