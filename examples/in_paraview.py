"""A mode in ParaView, drawn without a window. It writes `mode_01.png` into the folder of results.

./headstock run machines/cantilever.toml -o results/cantilever
pvpython examples/in_paraview.py results/cantilever  # of ParaView.
"""

import sys
from pathlib import Path

from paraview import simple

folder = Path(sys.argv[1])
machine = simple.OpenDataFile(str(folder / "modes" / "poses.pvd"))
machine.UpdatePipeline()
shape = "mode 01 shape [m/sqrt(kg)]"
moved = simple.WarpByVector(Input=machine, Vectors=["POINTS", shape], ScaleFactor=0.1)
view = simple.GetActiveViewOrCreate("RenderView")
display = simple.Show(moved, view)
simple.ColorBy(display, ("POINTS", shape, "Magnitude"))
simple.ResetCamera(view)
simple.SaveScreenshot(str(folder / "mode_01.png"), view)
