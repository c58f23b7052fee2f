"""A study with a plot: how thick should the walls of the bed be?

./headstock python examples/study_plot.py
"""

from pathlib import Path

import matplotlib.pyplot as plt

import headstock as hs

scene = Path(__file__).parent / "own_machine.toml"
walls = [10, 15, 20]  # mm
watch = ["modal.frequencies_hz[6]", "static.tcp.compliance_um_per_kN[2][2]"]
table = hs.study(
    hs.load(scene), vary={"parameters.wall": [f"{wall} mm" for wall in walls]}, watch=watch
)

figure, panels = plt.subplots(2, sharex=True)
for panel, name, label in zip(panels, watch, ["mode 7 [Hz]", "z [µm/kN]"], strict=True):
    panel.plot(walls, [row.values[name] for row in table.rows], "o-")
    panel.set_ylabel(label)
panels[-1].set_xlabel("wall [mm]")
figure.savefig("walls.png")
print(table.to_pandas())
