"""A machine of rigid bodies and springs with all that can be computed of it: whole commands on it take
seconds.
"""

SCENE = """
name = "A cross slide"
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.bed]
solid = { box = ["600 mm", "400 mm", "50 mm"] }
material = "steel"
fidelity = "rigid"
interfaces = { rail = { face = "z+" }, foot = { face = "z-" } }
[components.slide]
solid = { box = ["200 mm", "300 mm", "60 mm"] }
material = "steel"
at = ["0 mm", "0 mm", "60 mm"]
fidelity = "rigid"
interfaces = { bottom = { face = "z-" }, top = { face = "z+" } }
[components.table]
solid = { box = ["150 mm", "120 mm", "40 mm"] }
material = "steel"
at = ["0 mm", "0 mm", "130 mm"]
fidelity = "rigid"
interfaces = { bottom = { face = "z-" }, top = { face = "z+" } }
[joints.feet]
between = ["bed.foot", "ground"]
kind = "spring"
stiffness = { x = "50 N/um", y = "60 N/um", z = "70 N/um", rx = "1 kN m/mrad", ry = "1 kN m/mrad", rz = "1 kN m/mrad" }
[joints.x_guide]
between = ["slide.bottom", "bed.rail"]
kind = "linear_guide"
axis = "x"
stiffness = { lateral = "90 N/um", normal = "150 N/um", pitch = "200 N m/mrad", yaw = "150 N m/mrad", roll = "90 N m/mrad" }
[joints.x_drive]
between = ["slide.bottom", "bed.rail"]
kind = "ball_screw"
axis = "x"
at = ["0 mm", "0 mm", "50 mm"]
stiffness = { axial = "80 N/um" }
[joints.y_guide]
between = ["table.bottom", "slide.top"]
kind = "linear_guide"
axis = "y"
stiffness = { lateral = "90 N/um", normal = "150 N/um", pitch = "200 N m/mrad", yaw = "150 N m/mrad", roll = "90 N m/mrad" }
[joints.y_drive]
between = ["table.bottom", "slide.top"]
kind = "ball_screw"
axis = "y"
at = ["0 mm", "0 mm", "120 mm"]
stiffness = { axial = "60 N/um" }
[axes.X]
joints = ["x_guide", "x_drive"]
limits = ["-150 mm", "150 mm"]
errors = { at = ["0 mm", "0 mm", "60 mm"], EX = { polynomial = ["0 um", "15 um"], over = "150 mm" } }
[axes.Y]
joints = ["y_guide", "y_drive"]
limits = ["-80 mm", "80 mm"]
[points]
tcp = { tool = "table.top", work = "ground" }
[poses]
left = { X = "-100 mm" }
[sweeps.line]
axes = { X = ["-100 mm", "100 mm", 3], Y = ["-50 mm", "50 mm", 2] }
[variants.stiff]
"joints.x_drive.stiffness.axial" = "160 N/um"
[effects]
damping = { modal = "2 %" }
guide_errors = true
[studies.drive]
vary = { "joints.x_drive.stiffness.axial" = ["40 N/um", "80 N/um"] }
watch = ["modal.frequencies_hz[0]"]
[analyses]
static = { at = "tcp" }
modal = { count = 6 }
"""
MILL = 'mill = { diameter = "10 mm", teeth = 2, helix = "30 deg" }\nmaterial = "al7075-t6"'
ANALYSES = {
    "static": ("static", ""),
    "modal": ("modal", ""),
    "frf": (
        "frf",
        'inputs = [["tcp", "x"]]\nup_to = "300 Hz"\npoints = 11\nadaptive = false',
    ),
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
