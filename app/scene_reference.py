"""The scene reference as Markdown, made from the schema: ``headstock schema --markdown > docs/scene_reference.md``."""

from collections.abc import Iterator
from typing import Any

from headstock.geometry.frames import DOF_NAMES
from headstock.pipeline.joint_kinds import KINDS

Json = dict[str, Any]

INTRODUCTION = """\
# Scene reference

Made from the schema by `./headstock schema --markdown > docs/scene_reference.md`; a test asserts that it is up to date.

A scene is a TOML file. Keys that are not listed here are errors, with a suggestion. Quantities are texts with a unit (`"210 GPa"`,
`"380 N/um"`, `"12.5 mm"`, `"30 deg"`); plain numbers are for what has no dimension. Names are letters, digits, `_` and `-`. A key in
square brackets names a table; `NAME` is yours to choose. `component.interface` and `ground` name the ends of joints. Files that a
scene names lie in its folder or below.
"""

# table.key: what a type alone does not say
NOTES = {
    "Scene.name": "heading of the results; the file's name unless given",
    "Scene.variants": 'named sets of overrides, keys in quotes: `"components.column.fidelity" = "rigid"`; chosen by `--variant`; '
    "`--variant A+B` applies `A`, then `B`",
    "Scene.compare": "see [variants side by side](comparing.md)",
    "Compare.variants": 'columns, `A+B` for joined variants, `as written` for none; all unless given',
    "Compare.fidelity": "each variant once with its elastic and segmented components at each of them",
    "Compare.pose": "the first unless given",
    "Compare.reference": "column the others are held against; the richest unless given",
    "Scene.poses": 'axis positions: `X = "10 mm"`; axes left out are at zero; without any pose there is one, `reference`, at zero',
    "Scene.sweeps": "poses in which `headstock sweep` repeats the analyses ([sweeps](sweeps.md))",
    "Sweep.axes": "a grid: first and last position and how many, of each axis; axes left out are at zero",
    "Sweep.poses": 'names of poses and positions, one by one: `["reference", { X = "10 mm" }]`',
    "Sweep.path": 'corners of a way: `[{ X = "-100 mm" }, { X = "100 mm", Y = "50 mm" }]`',
    "Sweep.variant": "variant of the scene that is swept, `A+B` for several; it applies after one of the command line",
    "Sweep.step": "longest way between two poses of a path, of the axes that are measured like it",
    "Scene.drives": "motors, screws and controllers of axes, see [drives and control](drives.md); used with the effect `drive_control`",
    "Drive.axis": "the axis it moves; the drive's own name unless given",
    "Drive.joint": "its ball screw, nut at the first end, motor at the second; needless where the axis has only one",
    "Drive.inertia": "of rotor and coupling",
    "Drive.lead": "travel per turn, unless the joint's `screw` gives it",
    "Drive.screw_inertia": "of the screw about its axis; used with the effect `screw_inertia`",
    "Drive.coupling": "torsional stiffness between motor and screw, unless the joint's `screw` gives it; rigid unless given",
    "Drive.kv": 'gain of the P position control, `"50 1/s"` or `"3 m/min/mm"`',
    "Drive.velocity_gain": "of the PI velocity control: force per speed along the axis, or torque per turning speed of the motor",
    "Drive.integral_time": "of the PI velocity control; without it P only",
    "Drive.feed_forward": 'such as `{ velocity = "100 %", acceleration = "100 %" }`',
    "Drive.encoder": "what the position control sees: the motor, or a linear scale; velocity control sees the motor",
    "Drive.scale": "point where the scale is, tool against work; beside the screw unless given",
    "Drive.sampling": "cycle of the controller: a dead time of 1.5 cycles",
    "Drive.dead_time": "the same, given itself",
    "Drive.current_loop": "time constant of the current control",
    "Drive.friction": "used with the effect `friction`",
    "FeedForward.velocity": "share of the commanded velocity that does not wait for an error",
    "FeedForward.acceleration": "share of the force that the axis' inertia needs",
    "Friction.coulomb": "while sliding",
    "Friction.breakaway": "from rest; as while sliding unless given",
    "Friction.stribeck_speed": "at which it has fallen from one to the other, to 1/e",
    "Friction.viscous": "per speed",
    "Friction.smoothing": "speed below which it grows in proportion: tanh(v / smoothing)",
    "PathCut.at": "point where the tool is; the first one unless given",
    "PathCut.up": "from the tool's tip to its holder",
    "Control.up_to": "highest frequency of the poles listed",
    "Control.speed": "at which the lag is told",
    "Control.poses": "all of them unless given",
    "Scene.effects": "`gravity = true` (or an acceleration); `damping = true` (of joints and materials), or `damping = { modal = 0.02 }` "
    "(besides that a damping ratio on every mode, or a list of the first ones, the last for all others); for `[analyses.contouring]` "
    "`cutting_force = true` (also along `[analyses.path]`), "
    "`regeneration = true` (each tooth meets the wave the last ones left), `coriolis = true`; for a lumped mechanism "
    "`gravity_stiffening = true`; `drive_control = true` puts the motors "
    "of `[drives]` under control, `screw_inertia = true` and `friction = true` add to it; all off unless named",
    "Scene.free": "the whole machine floats on purpose: no error for missing connections to ground",
    "Material.E": "Young's modulus",
    "Material.nu": "Poisson's ratio, above -1 and below 0.495",
    "Material.rho": "density",
    "Material.loss_factor": "structural damping: the modulus is `E (1 + i loss_factor)`; used with the effect `damping`",
    "Component.solid": "its shape, in its own frame: parametric solids stand on `z = 0`, centred in x and y",
    "Component.material": "name of a material; needless where a mass file or superelement brings its own",
    "Component.mass": "scales the density so that this mass comes out",
    "Component.at": "where its origin lies in the machine frame, all axes at zero",
    "Component.rotate": "rotations about its origin, one after the other",
    "Component.fidelity": "`rigid`: 6 dofs, no mesh; `segmented`: a row of rigid segments on beam springs; `elastic`: FE and Craig–Bampton",
    "Component.mesh": "for elastic components",
    "Component.reduction": "for elastic components; without it the planner keeps modes as far as the analyses need them",
    "Component.interfaces": "areas that joints hold on to",
    "Component.free": "this body floats on purpose",
    "Solid.box": "sizes x, y, z",
    "Solid.step": "STEP file; the unit is the file's own; `headstock show` numbers its faces",
    "Solid.solid": "which solid of a STEP file with several, by number from 1 or by name",
    "Solid.mesh": "finished mesh: gmsh `.msh`, Abaqus `.inp`, Nastran `.bdf`",
    "Solid.unit": "length of one unit of a mesh file",
    "Solid.superelement": "reduced matrices in Headstock's own HDF5 layout",
    "Interface.face": "`x- x+ y- y+ z- z+` (plane faces at that end), `face:N` (as `headstock show` numbers them), `outer`, `inner` (tubes), "
    "`set:NAME` (of a mesh file)",
    "Interface.coupling": "`rigid`: the area moves as a rigid body (RBE2); `average`: the frame follows the area's mean motion (RBE3)",
    "Interface.force": "accept a point- or line-like area although its compliance depends on the mesh",
    "Interface.patches": "several areas as one interface: `[{ face = \"face:10\" }, { face = \"face:11\" }]`",
    "Interface.rail": "carriages hold on to it at any place along an axis, see [guideways](guideways.md)",
    "Rail.along": "axis of the component it runs along",
    "Rail.stations": "control points of the spline its motion is fitted by, 4 dofs each; 2.5 intervals per length of the shortest "
    "carriage unless given",
    "Mesh.size": "target element size; from the solid's shape unless given",
    "Mesh.order": "1 locks in bending and is refused or warned of",
    "Mesh.across_patches": "least number of elements across a patch on a face; elements grow from there",
    "Mesh.force": "accept elements of order 1 where they lock grossly (drawn out, or in a thin part), to study just that",
    "Mesh.cells": "`hex` for boxes only",
    "Reduction.modes_to": "keep fixed-interface modes up to this frequency",
    "Reduction.modes": "keep this many",
    "Reduction.verify": "count the modes below the highest by a Sturm sequence, to prove that none is missing",
    "Joint.between": "two ends",
    "Joint.kind": "see the table of kinds below",
    "Joint.axis": "direction of motion, or of a bolt",
    "Joint.normal": "second direction, square to the first",
    "Joint.at": "where it acts, in the machine frame, all axes at zero; the middle of its first interface unless given",
    "Joint.length": "length of the carriage (or nut) on a rail; it stands beside `at`, wherever the axes carry that",
    "Joint.screw": "shaft of a ball screw: the stiffness follows the distance of the nut (first end) from the fixed bearing (second end)",
    "Screw.diameter": "of the area that carries: the root diameter, or the catalogue's effective one",
    "Screw.bore": "diameter of a hollow screw's bore",
    "Screw.E": "Young's modulus; 210 GPa unless given",
    "Screw.nu": "Poisson's ratio; 0.3 unless given",
    "Screw.lead": "travel per turn; with it the shaft's twist and the coupling give way along the thread",
    "Screw.bearing": "axial stiffness of the fixed bearing; rigid unless given",
    "Screw.coupling": "torsional stiffness between shaft and motor; rigid unless given",
    "Screw.far": "interface of a second fixed bearing; that end floats unless given",
    "Screw.far_bearing": "its axial stiffness; rigid unless given",
    "Screw.length": "of the shaft between both fixed bearings",
    "Joint.stiffness": "keys by kind, see below; `\"rigid\"` holds a direction",
    "Joint.damping": "viscous, the same keys; used with the effect `damping`",
    "Joint.loss_factor": "structural damping as a share of its stiffness; used with the effect `damping`",
    "Joint.allow_negative": "accept a negative stiffness or damping",
    "Axis.joints": "joints across which the axis moves",
    "Axis.joint": "the same, for one",
    "Axis.direction": "of travel; the joint's own axis unless given",
    "Axis.limits": "lowest and highest position",
    "Axis.moves": "components that move; worked out from the joints unless given",
    "Point.tool": "where the tool is",
    "Point.work": "where the workpiece is; results are tool relative to work",
    "Support.face": "`component.face`",
    "Support.at": "`component.interface`: the same area",
    "Support.fix": "directions held at every node",
    "Static.at": "points; all of them unless given",
    "Static.poses": "all of them unless given",
    "Modal.count": "how many; 6 unless `up_to` is given",
    "Modal.up_to": "all up to this frequency",
    "Modal.spread": "also with every interface rigid and with every one averaging: the range of each frequency",
    "Modal.poses": "all of them unless given",
    "Study.vary": 'keys of the scene and their values, `{ "components.column.mesh.size" = ["50 mm", "25 mm"] }`: every combination is a '
    'point; `variant = ["", "soft"]` varies the variant',
    "Study.set": "keys that have the same other value in every point",
    "Study.pairwise": "take the first values of all lists together, then the second ones, in place of every combination",
    "Study.families": "several parts with settings of their own, in place of `vary`",
    "Study.watch": 'paths into `summary.json`: `"modal.frequencies_hz[0:6]"`, `"static.tcp.compliance_um_per_kN[0][0]"`, `"seconds"`, '
    '`"cpu_seconds"`',
    "Study.analyses": "which analyses are run; all of the scene's unless given",
    "Study.store": "`cold`: every point starts from an empty store, so that seconds are those of the whole computation",
    "Study.repeats": "runs per point, for the median and spread of seconds",
    "Study.truth": "settings of a run that all others are held against: makes it a [cost study](studies.md#what-accuracy-costs)",
    "Study.reference": "published study of this beam that the results are held against",
    "Family.label": "name in tables and figures",
    "Family.set": "as in the study, for this part only",
    "Family.vary": "as in the study",
    "Family.pairwise": "as in the study",
    "Family.analyses": "as in the study",
    "Scene.mechanism": "a closed-loop mechanism; poses and sweeps then give the tool: `X Y Z` of its point, `A B` its turns about x, y",
    "Contouring.side": "of the finished block",
    "Contouring.at": "centre of the block, and height of the tool point",
    "Contouring.feed": "feed rate",
    "Contouring.spindle": "speed of the spindle",
    "Contouring.material": "what is cut; coefficients and their source stand in `solvers/cutting_materials.py`",
    "Contouring.forces": "measured forces in place of computed ones: CSV with the columns `time,fx,fy,fz` in s and N, on the tool, machine frame;"
    " each time step takes their mean over it",
    "Contouring.lead": "straight way before and after the block",
    "Contouring.averaging": "length of each of three moving averages that limit the jerk",
    "Contouring.model": "`linear`: matrices along the path; `nonlinear`: the full equations",
    "Contouring.steps_per_turn": "time steps per turn of the spindle",
    "Mill.helix": "positive pulls the tool down",
    "Mill.runout": "distance of the tool's axis from the spindle's",
    "Map.sweep": "a sweep of `axes` in which two or three have several positions, at most 40 000 poses",
    "Map.count": "how many frequencies; each is one mode, followed by its shape",
    "Mechanism.kind": "`exechon`: two UPR legs on a common first axis, one SPR leg, a two-axis wrist",
    "Mechanism.model": "`lumped`: every component is rigid, the legs' springs are the only compliance",
    "Mechanism.at": "where its base stands in the machine frame: y along the common axis of legs 1 and 2, x to leg 3, z to the platform",
    "Mechanism.rotate": "how its base is turned, one rotation after the other",
    "Mechanism.tool": "direction of the tool, from the wrist to its tip, in poses that do not turn it",
    "Mechanism.carries": "components by the body they are fixed to, in whose frame they are placed: `leg_1` turns with leg 1, `tip_1` is its"
    " sliding end, then `platform`, `wrist_4`, `wrist_5`",
    "Mechanism.limits": "lowest and highest value of coordinates: lengths `q1 q2 q3`, wrist angles `g4 g5`, passive angles `phi th1 ps1 th2"
    " ps2 a1 a2 a3 ps3`",
    "Mechanism.springs": "for the lumped model",
    "Mechanism.screw_lead": "travel of a leg per turn of its motor; contours then tell motor torques",
    "Exechon.base": "places of the base joints: y of legs 1 and 2, x of leg 3",
    "Exechon.platform": "places of the platform joints: y of legs 1 and 2, x of leg 3",
    "Exechon.universal_offsets": "distance between the two axes of the universal joints of legs 1 and 2",
    "Exechon.platform_heights": "z of the platform joints of legs 1 and 2",
    "Exechon.wrist": "x and z of the wrist centre on the platform",
    "Exechon.tool_length": "from the wrist centre to the tool point",
    "Springs.joint": "of the joint between leg and platform, along and across the leg",
    "Springs.drive": "of nut and bearings, along the leg",
    "Springs.screw": "Young's modulus times section of the screw: its stiffness is that over its free length",
    "Springs.screw_offset": "free length of the screw less the length of the leg",
    "Frf.inputs": "where loads act: `[[\"tcp\", \"x\"]]`, a point or `component.interface` and one of `x y z rx ry rz`; a name alone "
    "means x, y and z; all points unless given",
    "Frf.outputs": "where motion is wanted, the same way; the inputs unless given",
    "Frf.from": "lowest frequency; at 0 Hz stands the static compliance",
    "Frf.to": "highest frequency; fixed-interface modes are kept up to twelve times this",
    "Frf.points": "of the even grid",
    "Frf.spacing": "of the even grid",
    "Frf.adaptive": "adds points around every resonance, from its half-power width outwards",
    "Frf.motion": "what tables and charts show; `results.h5` holds receptances",
    "Frf.poses": "all of them unless given",
    "Path.from": 'where the axes of the path begin: `{ X = "-40 mm" }`',
    "Path.to": "where they end, in a straight line",
    "Path.pose": "where all other axes stand; at zero unless given",
    "Path.feeds": "the move is made once at each",
    "Path.time_constant": "feed over acceleration; of exponential ramps their lag",
    "Path.ramp": "`linear`: constant acceleration; `s_curve`: its jerk limited too; `exponential`: a first-order lag",
    "Path.jerk_time": "of an S-curve: acceleration over jerk",
    "Path.outputs": "where the deviation is wanted: `[[\"tcp\", \"z\"]]`; all points in x, y and z unless given",
    "Path.sampling": "samples a second",
    "Path.lowpass": "cut-off of a Butterworth low-pass of fourth order over the deviation; none unless given",
    "Path.filter": "`zero_phase`: forwards and backwards, without delay; `causal`: once, as an instrument does",
    "Path.ring_down": "how long after a ramp its ringing is looked at, and recorded after the end",
    "Static.on_request": "run only when named: `--analysis static`",
    "Modal.on_request": "run only when named: `--analysis modal`",
    "Map.on_request": "run only when named: `--analysis map`",
    "Frf.on_request": "run only when named: `--analysis frf`",
    "Contouring.on_request": "run only when named: `--analysis contouring`",
    "Path.pose_changes": "`followed`: the machine's matrices change along the way; `frozen`: those of its middle hold, "
    "as they do with drives under control; `followed` without these unless given",
    "Path.on_request": "run only when named: `--analysis path`",
    "Limits.elements": "most elements a component may have",
    "Limits.memory": "most memory a stage may take, by estimate",
    "Limits.time": "most time the mesh of a component may take",
}  # fmt: skip


def render_reference(schema: Json) -> str:
    """The reference of all keys as Markdown."""
    parts = [INTRODUCTION, "## The file", "", schema.get("description", ""), "", *_key_table("Scene", schema)]
    seen: set[str] = set()
    for key, rule in schema["properties"].items():
        name = _table_of(rule)
        if name is not None:
            named = "additionalProperties" in rule
            parts += _section(schema, name, f"{key}.NAME" if named else key, seen, level=2)
    parts += ["## Kinds of joints", "", *_joint_table()]
    return "\n".join(parts).rstrip() + "\n"


def _section(schema: Json, name: str, path: str, seen: set[str], *, level: int) -> Iterator[str]:
    """A table, then the tables inside it that have not been written yet."""
    if name in seen:
        return
    seen.add(name)
    table = schema["$defs"][name]
    label = name.removesuffix("Table")
    yield from [f"{'#' * level} `[{path}]`", "", table.get("description", ""), "", *_key_table(label, table)]
    for key, rule in table["properties"].items():
        inner = _table_of(rule)
        if inner is not None:
            below = f"{path}.{key}.NAME" if "additionalProperties" in rule else f"{path}.{key}"
            yield from _section(schema, inner, below, seen, level=3)


def _key_table(label: str, table: Json) -> Iterator[str]:
    required = set(table.get("required", ()))
    yield from ["| key | value | unless given | |", "|---|---|---|---|"]
    for key, rule in table["properties"].items():
        note = NOTES.get(f"{label}.{key}", "")
        default = "**required**" if key in required else _describe_default(rule)
        yield f"| `{key}` | {_describe_value(rule)} | {default} | {note} |"
    yield ""


def _table_of(rule: Json) -> str | None:
    """Name of the table a key holds, in whatever wrapping."""
    if "$ref" in rule:
        return str(rule["$ref"]).rsplit("/", 1)[-1]
    for inner in (*rule.get("anyOf", ()), rule.get("additionalProperties"), rule.get("items")):
        if isinstance(inner, dict) and (found := _table_of(inner)):
            return found
    return None


def _describe_value(rule: Json) -> str:
    if "anyOf" in rule:
        return " or ".join(_describe_value(option) for option in rule["anyOf"] if option.get("type") != "null")
    if "$ref" in rule:
        return "table"
    if "enum" in rule:
        return ", ".join(f"`{option}`" for option in rule["enum"])
    if "description" in rule:
        examples = ", ".join(f"`{_show(example)}`" for example in rule.get("examples", ()))
        return f"{rule['description']}, such as {examples}" if examples else str(rule["description"])
    if rule.get("type") == "array":
        inner = rule.get("items", {})
        low, high = rule.get("minItems"), rule.get("maxItems")
        count = f"{low} × " if low is not None and low == high else ""
        if "examples" in rule:
            return f"list, such as `{_show(rule['examples'][0])}`"
        return f"list of {count}({_describe_value(inner)})" if inner else "list"
    if rule.get("type") == "object":
        inner = rule.get("additionalProperties")
        return f"table of names: {_describe_value(inner)}" if isinstance(inner, dict) and inner else "table"
    return {"string": "text", "boolean": "`true`, `false`", "integer": "whole number", "number": "number"}.get(
        rule.get("type", ""), ""
    )


def _describe_default(rule: Json) -> str:
    default = rule.get("default")
    return "" if default is None or isinstance(default, dict) or default == [] else f"`{_show(default)}`"


def _show(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(_show(item) for item in value)}]"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)


def _joint_table() -> Iterator[str]:
    yield "Directions are those of the joint: x along `axis` (z for bolted joints and mounts), z along `normal`."
    yield ""
    yield from ["| kind | keys of `stiffness` and `damping` | always held | needs |", "|---|---|---|---|"]
    for kind, rule in KINDS.items():
        keys = ", ".join(
            f"`{key}`"
            if (key,) == tuple(DOF_NAMES[dof] for dof in dofs)
            else f"`{key}` ({' '.join(DOF_NAMES[dof] for dof in dofs)})"
            for key, dofs in rule.keys.items()
        )
        held = " ".join(DOF_NAMES[dof] for dof in rule.held)
        needs = [f"`{key}`" for key in rule.required]
        needs += ["`axis`"] if rule.needs_axis else []
        needs += ["`normal`"] if rule.needs_normal else []
        yield f"| `{kind}` | {keys or 'none'} | {held} | {', '.join(needs)} |"
