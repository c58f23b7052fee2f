"""Names of scene keys and of results that have changed, old to new: the one table of them.

An old scene key is an error that says the new one.
"""

# by table of the schema and key, as in ``key_notes.py``
SCENE_KEYS = {
    "Interface.force": "allow_singular",
    "Mesh.force": "allow_locking",
    "Path.pose_changes": "pose_model",
    "Path.ring_down": "residual_time",
    "Rail.stations": "control_points",
    "Screw.far": "second_end",
    "Screw.far_bearing": "second_bearing",
    "Screw.reach": "floating_end",
    "Study.truth": "reference_run",
}
