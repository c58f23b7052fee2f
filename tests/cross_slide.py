"""A machine of rigid bodies and springs with all that can be computed of it: whole commands on it take
seconds.
"""

from fixture_machines import stored_scene

SCENE = stored_scene("cross_slide")
MILL = 'mill = { diameter = "10 mm", teeth = 2, helix = "30 deg" }\nmaterial = "al7075-t6"'
ANALYSES = {
    "static": ("static", ""),
    "modal": ("modal", ""),
    "frf": ("frf", 'inputs = [["tcp", "x"]]\nup_to = "300 Hz"\npoints = 11\nadaptive = false'),
    "lobes": ("lobes", f'speeds = ["3000 rpm", "6000 rpm", 3]\nradial_depth = "1 mm"\n{MILL}'),
    "path": (
        "path",
        'from = { X = "-20 mm" }\nto = { X = "20 mm" }\nfeeds = ["6 m/min"]\ntime_constant = "50 ms"\nlowpass = "300 Hz"\n'
        "estimate = false",
    ),
    "contouring": (
        "contouring",
        'polyline = [["0 mm", "0 mm", "0 mm"], ["30 mm", "0 mm", "0 mm"], ["30 mm", "30 mm", "0 mm"]]\naveraging = "20 ms"\n'
        f'feed = "6 m/min"\nspindle = "3000 rpm"\naxial_depth = "1 mm"\nradial_depth = "1 mm"\n{MILL}\nestimate = false',
    ),
    "transient": (
        "transient",
        'outputs = [["tcp", "x"]]\nloads.push = { at = ["tcp", "x"], shape = "step", size = "1 N" }\nduration = "50 ms"',
    ),
    "volumetric": ("volumetric", 'at = ["tcp"]\nsweep = "line"'),
}
TARGETS = """
name = "x drive"
[cases.a]
pose = "left"
tolerance = "2 %"
frequencies = ["60 Hz"]
[parameters.drive]
keys = ["joints.x_drive.stiffness.axial"]
bounds = ["10 N/um", "800 N/um"]
"""
