"""Machines with three linear axes, drawn by seed: X moves the table on a bed, Y the saddle along a
bridge over it, Z the head; bed, bridge and saddle are finite elements.
"""

import numpy as np

SCENE = """\
name = "three axes {seed}"
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[materials.iron]
E = "115 GPa"
nu = 0.26
rho = "7150 kg/m^3"

[components.bed]
solid = {{ box = ["{bed_x} mm", "{bed_y} mm", "{bed_z} mm"] }}
at = ["0 mm", "0 mm", "-{bed_z} mm"]
material = "{bed_material}"
fidelity = "elastic"
mesh = {{ size = "{bed_mesh} mm", cells = "{cells}", across_patches = {cells_across} }}
reduction = {{ modes = {modes} }}
[components.bed.interfaces]
foot_1 = {{ face = "z-", rect = {{ center = ["{foot_x} mm", "{foot_y} mm"], size = ["80 mm", "80 mm"] }} }}
foot_2 = {{ face = "z-", rect = {{ center = ["{foot_x} mm", "-{foot_y} mm"], size = ["80 mm", "80 mm"] }} }}
foot_3 = {{ face = "z-", rect = {{ center = ["-{foot_x} mm", "{foot_off} mm"], size = ["80 mm", "80 mm"] }} }}
pad_1 = {{ face = "z+", coupling = "average", rect = {{ center = ["240 mm", "{rail_y} mm"], size = ["60 mm", "40 mm"] }} }}
pad_2 = {{ face = "z+", coupling = "average", rect = {{ center = ["60 mm", "{rail_y} mm"], size = ["60 mm", "40 mm"] }} }}
pad_3 = {{ face = "z+", coupling = "average", rect = {{ center = ["240 mm", "-{rail_y} mm"], size = ["60 mm", "40 mm"] }} }}
pad_4 = {{ face = "z+", coupling = "average", rect = {{ center = ["60 mm", "-{rail_y} mm"], size = ["60 mm", "40 mm"] }} }}
post = {{ face = "z+", coupling = "{coupling}", rect = {{ center = ["-{post_x} mm", "0 mm"], size = ["{wall} mm", "{bridge_y} mm"] }} }}
bearing = {{ face = "z+", coupling = "average", rect = {{ center = ["-60 mm", "0 mm"], size = ["60 mm", "60 mm"] }} }}
[components.table]
solid = {{ box = ["300 mm", "{table_y} mm", "60 mm"] }}
at = ["150 mm", "0 mm", "20 mm"]
material = "iron"
fidelity = "rigid"
interfaces = {{ under = {{ face = "z-" }}, top = {{ face = "z+" }} }}
[components.bridge]
solid = {{ box = ["{wall} mm", "{bridge_y} mm", "{bridge_z} mm"] }}
at = ["-{post_x} mm", "0 mm", "0 mm"]
material = "{bridge_material}"
fidelity = "elastic"
mesh = {{ size = "{bridge_mesh} mm", cells = "{cells}", across_patches = {cells_across} }}
reduction = {{ modes = {modes} }}
[components.bridge.interfaces]
foot = {{ face = "z-", coupling = "{coupling}" }}
pad_1 = {{ face = "x+", coupling = "average", rect = {{ center = ["65 mm", "{high} mm"], size = ["40 mm", "30 mm"] }} }}
pad_2 = {{ face = "x+", coupling = "average", rect = {{ center = ["-65 mm", "{high} mm"], size = ["40 mm", "30 mm"] }} }}
pad_3 = {{ face = "x+", coupling = "average", rect = {{ center = ["65 mm", "{low} mm"], size = ["40 mm", "30 mm"] }} }}
pad_4 = {{ face = "x+", coupling = "average", rect = {{ center = ["-65 mm", "{low} mm"], size = ["40 mm", "30 mm"] }} }}
bearing = {{ face = "x+", coupling = "average", rect = {{ center = ["-{bearing_y} mm", "{middle} mm"], size = ["40 mm", "40 mm"] }} }}
[components.saddle]
solid = {{ box = ["{saddle_x} mm", "180 mm", "260 mm"] }}
at = ["{saddle_at} mm", "0 mm", "{saddle_z} mm"]
material = "steel"
fidelity = "elastic"
mesh = {{ size = "{saddle_mesh} mm", cells = "{cells}", across_patches = {cells_across} }}
reduction = {{ modes = {modes} }}
[components.saddle.interfaces]
block_1 = {{ face = "x-", coupling = "average", rect = {{ center = ["65 mm", "200 mm"], size = ["40 mm", "30 mm"] }} }}
block_2 = {{ face = "x-", coupling = "average", rect = {{ center = ["-65 mm", "200 mm"], size = ["40 mm", "30 mm"] }} }}
block_3 = {{ face = "x-", coupling = "average", rect = {{ center = ["65 mm", "60 mm"], size = ["40 mm", "30 mm"] }} }}
block_4 = {{ face = "x-", coupling = "average", rect = {{ center = ["-65 mm", "60 mm"], size = ["40 mm", "30 mm"] }} }}
nut = {{ face = "x-", coupling = "average", rect = {{ center = ["0 mm", "130 mm"], size = ["40 mm", "40 mm"] }} }}
pad_1 = {{ face = "x+", coupling = "average", rect = {{ center = ["50 mm", "175 mm"], size = ["30 mm", "40 mm"] }} }}
pad_2 = {{ face = "x+", coupling = "average", rect = {{ center = ["-50 mm", "175 mm"], size = ["30 mm", "40 mm"] }} }}
pad_3 = {{ face = "x+", coupling = "average", rect = {{ center = ["50 mm", "85 mm"], size = ["30 mm", "40 mm"] }} }}
pad_4 = {{ face = "x+", coupling = "average", rect = {{ center = ["-50 mm", "85 mm"], size = ["30 mm", "40 mm"] }} }}
drive = {{ face = "x+", coupling = "average", rect = {{ center = ["0 mm", "220 mm"], size = ["40 mm", "40 mm"] }} }}
[components.head]
solid = {{ box = ["60 mm", "140 mm", "{head_z} mm"] }}
at = ["{head_at} mm", "0 mm", "{head_low} mm"]
material = "steel"
mass = "{head_mass} kg"
fidelity = "rigid"
interfaces = {{ back = {{ face = "x-" }}, tool = {{ face = "z-" }} }}

[joints.mounts_1]
between = ["ground", "bed.foot_1"]
kind = "spring"
stiffness = {{ x = "{mount} N/um", y = "{mount} N/um", z = "{mount} N/um" }}
[joints.mounts_2]
between = ["ground", "bed.foot_2"]
kind = "spring"
stiffness = {{ x = "{mount} N/um", y = "{mount} N/um", z = "{mount} N/um" }}
[joints.mounts_3]
between = ["ground", "bed.foot_3"]
kind = "spring"
stiffness = {{ x = "{mount} N/um", y = "{mount} N/um", z = "{mount} N/um" }}
[joints.bolts]
between = ["bed.post", "bridge.foot"]
kind = "rigid"
[joints.x_guide]
between = ["table.under", "bed.pad_{{n}}"]
kind = "linear_guide"
axis = "x"
normal = "z"
carriages = {{ middle = ["150 mm", "0 mm", "0 mm"], along = "180 mm", across = "{rail_apart} mm" }}
stiffness = {{ lateral = "{guide} N/um", normal = "{guide} N/um" }}
errors = {{ length = "60 mm", normal = {{ waves = [{{ period = "{period} mm", amplitude = "3 um" }}] }} }}
each = {{ 1 = {{ "errors.normal.waves.0.period" = "310 mm" }} }}
[joints.x_drive]
between = ["table.under", "bed.bearing"]
kind = "ball_screw"
axis = "x"
at = ["-60 mm", "0 mm", "0 mm"]
stiffness = {{ axial = "{screw} N/um" }}
[joints.y_guide]
between = ["saddle.block_{{n}}", "bridge.pad_{{n}}"]
kind = "linear_guide"
axis = "y"
normal = "x"
carriages = {{ middle = ["{face} mm", "0 mm", "{middle} mm"], along = "130 mm", across = "140 mm" }}
stiffness = {{ lateral = "{guide} N/um", normal = "{guide} N/um" }}
errors = {{ length = "40 mm", lateral = {{ waves = [{{ period = "{period} mm", amplitude = "2 um" }}] }} }}
each = {{ 2 = {{ "errors.lateral.waves.0.amplitude" = "5 um" }} }}
[joints.y_drive]
between = ["saddle.nut", "bridge.bearing"]
kind = "ball_screw"
axis = "y"
at = ["{face} mm", "0 mm", "{middle} mm"]
stiffness = {{ axial = "{screw} N/um" }}
[joints.z_guide]
between = ["head.back", "saddle.pad_{{n}}"]
kind = "linear_guide"
axis = "z"
normal = "x"
carriages = {{ middle = ["{front} mm", "0 mm", "{middle} mm"], along = "90 mm", across = "100 mm" }}
stiffness = {{ lateral = "{guide} N/um", normal = "{guide} N/um" }}
[joints.z_drive]
between = ["head.back", "saddle.drive"]
kind = "ball_screw"
axis = "z"
at = ["{front} mm", "0 mm", "{middle} mm"]
stiffness = {{ axial = "{screw} N/um" }}

[axes]
X = {{ joints = ["x_guide", "x_drive"], direction = "x", limits = ["-100 mm", "100 mm"] }}
Y = {{ joints = ["y_guide", "y_drive"], direction = "y", limits = ["-70 mm", "70 mm"] }}
Z = {{ joints = ["z_guide", "z_drive"], direction = "z", limits = ["-50 mm", "50 mm"] }}
[points]
tcp = {{ tool = "head.tool", work = "table.top" }}
[probes]
bed = {{ component = "bed", at = ["150 mm", "{half_rail} mm", "{half_bed} mm"] }}
bridge = {{ component = "bridge", at = ["{quarter_wall} mm", "30 mm", "{low_bridge} mm"] }}
saddle = {{ component = "saddle", at = ["{quarter_saddle} mm", "35 mm", "120 mm"] }}
[loads.process]
at = "head.tool"
force = ["{force} N", "{across} N", "200 N"]
{drives}[effects]
gravity = true
guide_errors = true
damping = {{ modal = "2 %" }}
[sweeps.volume]
axes = {{ X = ["-100 mm", "100 mm", 3], Y = ["-70 mm", "70 mm", 3], Z = ["-50 mm", "50 mm", 3] }}
[analyses]
volumetric = {{ sweep = "volume" }}
[analyses.path]
from = {{ X = "-40 mm", Y = "-30 mm" }}
to = {{ X = "40 mm", Y = "30 mm" }}
feeds = ["6 m/min"]
time_constant = "50 ms"
outputs = [["tcp", "x"], ["tcp", "y"], ["tcp", "z"]]
sampling = "2 kHz"
[variants.controlled]
"effects.drive_control" = true
[variants.milling]
"effects.cutting_force" = true
"effects.regeneration" = true
[variants.milling."analyses.contouring"]
side = "{side} mm"
at = ["0 mm", "0 mm", "0 mm"]
feed = "1.5 m/min"
spindle = "{spindle} rpm"
mill = {{ diameter = "12 mm", teeth = 3, helix = "30 deg" }}
axial_depth = "0.5 mm"
radial_depth = "1 mm"
material = "al7075-t6"
steps_per_turn = 120
"""


DRIVE = """\
[drives.{axis}]
inertia = "2.6e-4 kg m^2"
lead = "10 mm"
kv = "50 1/s"
velocity_gain = "8e4 N s/m"
integral_time = "10 ms"
"""
# lowest and highest of what is drawn [mm], in the order of the draws
SIZES = {
    "bed_x": (820, 1000),
    "bed_y": (520, 700),
    "bed_z": (90, 200),
    "wall": (60, 130),
    "bridge_z": (480, 620),
    "bridge_y": (430, 560),
    "rail_y": (80, 160),
    "saddle_x": (45, 80),
}
# likewise, stiffnesses [N/um], forces [N] and a mass [kg]
PROPERTIES = {
    "foot_off": (-80, 80),
    "head_z": (220, 300),
    "head_below": (110, 170),
    "head_mass": (25, 70),
    "mount": (150, 600),
    "guide": (150, 500),
    "screw": (80, 250),
    "period": (150, 400),
    "force": (-500, 500),
    "across": (100, 500),
}


def draw_axes_scene(seed: int) -> str:
    """Return a scene with a volumetric map and a path, with motors that follow their set points
    and, as the variant ``controlled``, with drives under control, and as the variant ``milling``
    with a contour that is milled, as TOML.

    Args:
        seed: The same seed draws the same machine.
    """
    random = np.random.default_rng([29, seed])

    def draw(low: int, high: int) -> int:
        return int(random.integers(low, high + 1))

    kinds, materials = ("rigid", "average"), ("steel", "iron")
    drawn = {name: draw(*ends) for name, ends in SIZES.items()}
    drawn["bridge_y"] = min(drawn["bridge_y"], drawn["bed_y"] - 20)
    drawn |= {name: draw(*ends) for name, ends in PROPERTIES.items()}
    post_x = 0.5 * drawn["bed_x"] - 0.5 * drawn["wall"] - 20
    middle = drawn["bridge_z"] - 130
    face = -post_x + 0.5 * drawn["wall"]
    front = face + drawn["saddle_x"] + 20
    values: dict[str, float | str] = {
        "rail_apart": 2 * drawn["rail_y"],
        "foot_x": 0.5 * drawn["bed_x"] - 60,
        "foot_y": 0.5 * drawn["bed_y"] - 60,
        "post_x": post_x,
        "half_rail": 0.5 * drawn["rail_y"],
        "half_bed": 0.5 * drawn["bed_z"],
        "quarter_wall": 0.25 * drawn["wall"],
        "low_bridge": 0.3 * drawn["bridge_z"],
        "quarter_saddle": 0.25 * drawn["saddle_x"],
        "table_y": 2 * drawn["rail_y"] + 80,
        "high": middle + 70,
        "low": middle - 70,
        "middle": middle,
        "bearing_y": 0.5 * drawn["bridge_y"] - 45,
        "saddle_at": face + 20 + 0.5 * drawn["saddle_x"],
        "saddle_z": middle - 130,
        "face": face,
        "front": front,
        "head_at": front + 30,
        "head_low": middle - drawn["head_below"],
        "bed_mesh": round(random.uniform(0.5, 1.1) * drawn["bed_z"]),
        "bridge_mesh": round(random.uniform(0.6, 1.1) * drawn["wall"]),
        "saddle_mesh": round(random.uniform(0.6, 1.0) * drawn["saddle_x"]),
        "coupling": str(random.choice(kinds)),
        "modes": draw(4, 10),
        "cells": "hex" if seed % 3 else "tet",
        "cells_across": draw(2, 3),
        "bed_material": str(random.choice(materials)),
        "bridge_material": str(random.choice(materials)),
        "side": draw(24, 32),
        "spindle": draw(4000, 9000),
        "drives": "".join(DRIVE.format(axis=axis) for axis in "XYZ"),
    }
    return SCENE.format(seed=seed, **drawn, **values)
