"""Every table of a run, for its CSV files."""

from headstock.app.tables.components import COMPONENT_COLUMNS, JOINT_COLUMNS, MODEL_COLUMNS
from headstock.app.tables.contouring import (
    FACE_COLUMNS,
    list_faces,
    tabulate_contour,
    tabulate_profiles,
)
from headstock.app.tables.control import POLE_COLUMNS
from headstock.app.tables.lobes import LOBE_COLUMNS, list_lobes, tabulate_limits
from headstock.app.tables.map import tabulate_map
from headstock.app.tables.modes import tabulate_modes
from headstock.app.tables.motion_forces import MOTOR_COLUMNS, tabulate_joint_forces
from headstock.app.tables.path import path_stem
from headstock.app.tables.probes import (
    PROBE_COLUMNS,
    PROBE_MOTION_PEAKS,
    PROBE_PEAK_COLUMNS,
    list_probe_peaks,
)
from headstock.app.tables.static import (
    DEVIATION_COLUMNS,
    list_displacements,
    static_by_pose,
    tabulate_budget,
    tabulate_compliance,
    tabulate_whole_compliance,
)
from headstock.app.tables.table import PlainTable, tabulate
from headstock.app.tables.transient import MOVED_COLUMNS, list_moved
from headstock.app.tables.volumetric import LINE_COLUMNS, list_lines
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.summary import RunSummary


def list_tables(summary: RunSummary) -> list[PlainTable]:
    """Every table of a summary."""
    tables = [
        tabulate("components", COMPONENT_COLUMNS, summary["components"].items()),
        _stage_table(summary),
    ]
    for pose, points in static_by_pose(summary).items():
        for name, point in points.items():
            stem = f"{file_stem(pose)}_{file_stem(name)}"
            tables += [
                tabulate_compliance(f"compliance_{stem}", point),
                tabulate_whole_compliance(f"compliance_6x6_{stem}", point),
            ]
            tables.append(tabulate_budget(f"budget_{stem}", point["budget"]))
            if rows := list_displacements(point):
                tables.append(tabulate(f"displacement_{stem}", DEVIATION_COLUMNS, rows))
    tables += [tabulate_modes(modes) for modes in summary["modal"]]
    for pose, probes in summary.get("probes", {}).items():
        tables.append(tabulate(f"probes_{file_stem(pose)}", PROBE_COLUMNS, probes.items()))
    for pose, response in summary.get("frf", {}).items():
        if peaks := list_probe_peaks(response):
            tables.append(tabulate(f"probe_peaks_{file_stem(pose)}", PROBE_PEAK_COLUMNS, peaks))
    if "model_errors" in summary:
        bodies = summary["model_errors"]["bodies"]
        tables.append(tabulate("model_errors", MODEL_COLUMNS, bodies.items()))
    if "interface_errors" in summary:
        joints = summary["interface_errors"]["joints"]
        tables.append(tabulate("interface_errors", JOINT_COLUMNS, joints.items()))
    if "contouring" in summary:
        contour = summary["contouring"]
        tables += [
            tabulate_contour(contour),
            tabulate("contour_faces", FACE_COLUMNS, list_faces(contour)),
        ]
        if contour["probes"]:
            tables.append(tabulate("probes_contour", PROBE_MOTION_PEAKS, contour["probes"].items()))
        tables += [
            table for face in contour.get("milled_faces", []) for table in tabulate_profiles(face)
        ]
    for feed in summary["path"]["feeds"] if "path" in summary else ():
        stem = path_stem(feed["name"])
        if feed["drives"]:
            tables.append(tabulate(f"motors_{stem}", MOTOR_COLUMNS, feed["drives"].items()))
        if feed["probes"]:
            name = f"probes_{stem}"
            tables.append(tabulate(name, PROBE_MOTION_PEAKS, feed["probes"].items()))
        if feed["joints"]:
            tables.append(tabulate_joint_forces(f"joint_forces_{stem}", feed["joints"]))
    for pose, control in summary.get("control", {}).items():
        tables.append(
            tabulate(
                f"poles_{file_stem(pose)}", POLE_COLUMNS, list(enumerate(control["poles"], start=1))
            )
        )
    for pose, found in summary.get("lobes", {}).items():
        tables.append(tabulate(f"lobes_{file_stem(pose)}", LOBE_COLUMNS, list_lobes(pose, found)))
        tables.append(tabulate_limits(pose, found))
    for pose, transient in summary.get("transient", {}).items():
        stem = file_stem(pose)
        tables.append(tabulate(f"peaks_{stem}", MOVED_COLUMNS, list_moved(transient)))
        if transient["drives"]:
            tables.append(tabulate(f"motors_{stem}", MOTOR_COLUMNS, transient["drives"].items()))
        if transient["probes"]:
            name = f"probes_over_time_{stem}"
            tables.append(tabulate(name, PROBE_MOTION_PEAKS, transient["probes"].items()))
        if transient["joints"]:
            tables.append(tabulate_joint_forces(f"joint_forces_{stem}", transient["joints"]))
    if "map" in summary:
        tables.append(tabulate_map("map", summary["map"]))
    for place, volume in summary.get("volumetric", {}).items():
        stem = file_stem(place)
        tables += [
            tabulate_map(f"volumetric_{stem}", volume),
            tabulate(f"error_motions_{stem}", LINE_COLUMNS, list_lines(volume)),
            tabulate_budget(f"volumetric_budget_{stem}", volume["budget"]),
        ]
    return tables


def _stage_table(summary: RunSummary) -> PlainTable:
    headings = (
        "stage",
        "component",
        "pose",
        "seconds",
        "peak memory [MB]",
        "from the store",
        "reason",
    )
    rows = tuple(
        (
            row["stage"],
            row["component"],
            row["pose"],
            row["seconds"],
            row["peak_rss_mb"],
            row["cached"],
            row["reason"],
        )
        for row in summary["stages"]
    )
    return PlainTable("stages", headings, rows)
