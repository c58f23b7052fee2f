"""Names of the analyses, and names of scene keys and results that have changed."""

NAMES = (
    "static",
    "modal",
    "frf",
    "map",
    "contouring",
    "path",
    "control",
    "volumetric",
    "lobes",
    "transient",
)


# by table of the schema, without ``Table``, and key
SCENE_KEYS = {
    "Frf.to": "up_to",
    "Interface.force": "allow_singular",
    "Mesh.force": "allow_locking",
    "Modal.to": "up_to",
    "Path.pose_changes": "pose_model",
    "Path.ring_down": "residual_time",
    "Rail.stations": "control_points",
    "Screw.far": "second_end",
    "Screw.far_bearing": "second_bearing",
    "Screw.reach": "floating_end",
    "Study.truth": "reference_run",
}

# keys that are gone, and why
REMOVED_KEYS = {
    "Lobes.low_immersion": "every speed is evaluated by Floquet multipliers at any immersion; remove the key",
}

RESULT_FORMAT = 2  # the number ``format`` of JSON files of results
# keys of format 1, by file; ``effects`` writes its own with ``--json`` only
RESULT_KEYS = {
    "summary.json": {
        "asked": "requested",
        "assumed": "assumptions",
        "because": "reason",
        "chatter_stiffness_N_per_um": "chatter_limit_N_per_um",
        "chatter_stiffness_SI": "chatter_limit_SI",
        "least": "minimum",
        "least_likeness": "least_mac",
        "marks_s": "face_times_s",
        "most": "maximum",
        "plain_sum_error": "truncation_share",
        "port": "dof",
        "ports": "drive_points",
        "sag_um": "gravity_deflection_um",
        "sentence": "text",
        "slow_count": "low_frequency_modes",
        "slow_hz": "low_frequency_limit_hz",
        "softest_N_per_um": "minimum_dynamic_stiffness_N_per_um",
        "softest_SI": "minimum_dynamic_stiffness_SI",
        "softest_hz": "minimum_dynamic_stiffness_hz",
        "softest_mode": "minimum_dynamic_stiffness_mode",
        "stations": "sampled_poses",
        "torn": "tracking_breaks",
        "turn_error": "rotation_error",
        "worst_real_SI": "most_negative_real_SI",
        "worst_real_error_SI": "most_negative_real_error_SI",
        "worst_real_error_share": "most_negative_real_error_share",
        "worst_real_error_um_per_kN": "most_negative_real_error_um_per_kN",
        "worst_real_hz": "most_negative_real_hz",
        "worst_real_um_per_kN": "most_negative_real_um_per_kN",
    },
    "sweep.json": {
        "worst_real_um_per_kN": "most_negative_real_um_per_kN",
        "worst_real_hz": "most_negative_real_hz",
        "chatter_stiffness_N_per_um": "chatter_limit_N_per_um",
        "softest_N_per_um": "minimum_dynamic_stiffness_N_per_um",
        "softest_hz": "minimum_dynamic_stiffness_hz",
        "torn": "tracking_breaks",
    },
    "compare.json": {
        "same_from": "mac_threshold",
        "cannot": "not_computed",
        "frf.cannot": "reason",
        "worst": "peak",
        "worst_hz": "peak_hz",
        "worst_mode": "peak_mode",
        "worst_real": "most_negative_real",
        "worst_real_hz": "most_negative_real_hz",
        "worst_real_error": "most_negative_real_error",
        "holds_to_hz": "agrees_to_hz",
        "holds": "agreement",
        "held": "agreeing",
        "held_within": "agreeing_within",
        "off": "deviating",
        "missed": "missing",
    },
    "study.json": {
        "held": "confirmed",
    },
    "identification.json": {
        "seen_by_data": "data_share",
        "unobservable": "unidentifiable",
        "kept": "best",
    },
    "effects": {
        "named": "active",
        "beside": "together_with",
        "little": "small_change",
        "much": "large_change",
    },
    "convergence.json": {
        "sentence": "text",
    },
}
