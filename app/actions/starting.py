"""``headstock new``: a folder with a scene that runs as it is, for a box or for a part of the user's
own from a STEP or mesh file; for an assembly of parts a scene with questions.
"""

import os
import shlex
from collections.abc import Sequence
from pathlib import Path

import click

from headstock.app.actions.schemas import scene_schema
from headstock.app.actions.showing import (
    PART_SUFFIXES,
    STEP_SUFFIXES,
    format_suggestions,
    part_suggestions,
    patch_rows,
    survey_part,
)
from headstock.app.commands.tool_commands import NewOptions
from headstock.app.terminal.console import counted, make_console, print_remarks
from headstock.app.terminal.guard import DONE
from headstock.app.terminal.progress import show_progress
from headstock.geometry.errors import HeadstockError
from headstock.geometry.parts.interface_suggestions import LikelyInterface, likely_interfaces
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.components.survey import CadSurvey
from headstock.meshing.errors import MeshError, MeshTimeError
from headstock.meshing.length_units import doubt_size
from headstock.pipeline.preview.assemblies import AssemblyScene, draft_assembly
from headstock.pipeline.storage.json_texts import dump_json
from headstock.pipeline.storage.outputs import fill_new_folder, require_new_folder
from headstock.scene.building.loader import load_scene

PART_NAME = "part"
TRIAL_SECONDS = 8.0  # of processor time; most parts that cannot be meshed show it sooner
READING_SHARE = 0.5  # of these: a part whose faces take longer to list is not meshed in the rest

UNTRIED = "whether it succeeds is seen when it runs"
SCHEMA = "scene.schema.json"  # as the first line of a scene names it for editors
SCENE = """\
#:schema ./scene.schema.json
# {heading}
# Try it:   headstock check {scene}      headstock plan {scene}      headstock run {scene}
# Change a value for one run only:   headstock run {scene} --set materials.steel.E="190 GPa"
# Lengths, stiffnesses and so on are texts with a unit; docs/scene_reference.md lists every key.
name = "{name}"
{accuracy}
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"

[components.{part}]
solid = {solid}
material = "steel"
fidelity = "elastic"                # "rigid": six degrees of freedom and no mesh
{free}# mesh = {{ size = "{size}" }}{pad}{mesh}

{interfaces}
{clamp}
[analyses.modal]                    # natural frequencies and modes
count = {count}
{variant}"""
CLAMP = """
[joints.clamp]                      # {foot} is fixed to the ground: rigidly, or by the springs of a mount
between = ["ground", "{part}.{foot}"]
kind = "rigid"
# kind = "spring"
# stiffness = {{ x = "200 N/um", y = "200 N/um", z = "500 N/um", rx = "rigid", ry = "rigid", rz = "rigid" }}

[points]                            # where results are wanted: motion of tool relative to work
tcp = {{ tool = "{part}.{tip}", work = "ground" }}

[analyses.static]                   # compliance at the points, and which part of the machine it comes from
at = "tcp"
"""
SCREWED = """
[variants.screws]                   # run with --variant screws: fixed at {reason} alone
"joints.clamp.between" = ["ground", "{part}.{screws}"]
"components.{part}.interfaces.{foot}.coupling" = "average"
"components.{part}.interfaces.{screws}.patches" = [
{patches}
]
"""
ACCURACY = 'accuracy = "2 %"                    # meshes and modes are chosen so that no number is further off\n'
SHAPED = "# smaller is finer; left out, the size follows from the shape"
CHOSEN = "# counts without `accuracy`; smaller is finer"
FREE = "free = true                         # no support: six rigid-body modes come first\n"
FIXED_MODES, FREE_MODES = 6, 12
BOX_INTERFACES = """\
[components.part.interfaces]        # areas that joints hold on to
foot = { face = "z-" }
tip = { face = "z+", coupling = "average" }
# pad = { face = "x+", rect = { center = ["0 mm", "300 mm"], size = ["60 mm", "80 mm"] } }"""


def new_command(options: NewOptions) -> int:
    """Make a new folder with a scene, and with a copy of the part where one is given.

    Raises:
        click.UsageError: The folder is taken, or the part is no STEP or mesh file.
        HeadstockError: The part cannot be read or meshed, or has no two planes to hold it at.
    """
    folder = options.folder.absolute() if options.folder.name in ("", "..") else options.folder
    require_new_folder(folder)
    if options.assembly is not None:
        return _new_assembly(options, folder)
    if options.part is not None and options.part.suffix.lower() not in PART_SUFFIXES:
        raise click.UsageError(
            f"{options.part.name} is no STEP or mesh file ({', '.join(PART_SUFFIXES)})"
        )
    files: list[Path] = []
    choice = None
    before = _child_seconds()
    if options.part is None:
        text, doubt = _box_scene(folder), None
    else:
        solid, survey = survey_part(options.part, options.solid_choice, options.unit)
        unit = (options.unit or f"1 {survey.unit}") if isinstance(solid, MeshFile) else None
        text = write_part_scene(
            options.part, survey, _scene_name(folder), solid=options.solid_choice, unit=unit
        )
        choice = _describe_choice(likely_interfaces(survey.faces))
        files = [options.part]
        if isinstance(solid, MeshFile):
            files += solid.beside
            doubt = _name_guess(options, survey)
        else:
            doubt = doubt_size(options.part, max(survey.size))
    schema = dump_json(scene_schema())
    fill_new_folder(folder, {_scene_name(folder): text, SCHEMA: schema}, files)
    console = make_console()
    if doubt is not None:
        console.say(f"warning: {doubt}", style="yellow")
    scene = folder / _scene_name(folder)
    if choice is not None:
        console.say(choice)
        if _child_seconds() - before < READING_SHARE * TRIAL_SECONDS:
            _try_mesh(scene)
        else:
            console.print(f"listing its faces took long, and no mesh was tried: {UNTRIED}")
    _say_next(scene, "run")
    return DONE


def _say_next(scene: Path, verb: str) -> None:
    """Say what to type next, as the reader types it: the launcher says how it was called."""
    command = shlex.quote(os.environ.get("HEADSTOCK_COMMAND", "headstock"))
    words = f"{command} {verb} {shlex.quote(str(scene))}"
    make_console().say(f"{scene} is ready; next: {words}", soft_wrap=True)


def _child_seconds() -> float:
    """Return the processor time of processes that have ended, such as those that read files [s]."""
    spent = os.times()
    return spent.children_user + spent.children_system


def _name_guess(options: NewOptions, survey: CadSurvey) -> str | None:
    """A warning where the unit of a mesh file was guessed."""
    if options.unit is not None:
        return None
    longest = max(survey.size)
    return (
        f"a mesh file names no unit: lengths are taken as {survey.unit}, the part is {longest:.4g} m long; "
        "change `unit` in the scene, or use --unit, if that is wrong"
    )


def _try_mesh(path: Path) -> None:
    """Mesh the part as its scene has it, unless that takes long: what cannot be meshed is better
    known now.

    Raises:
        MeshError: It cannot; the folder stays, for a part that is mended.
    """
    scene = load_scene(path)
    (component,) = scene.machine.components.values()
    try:
        mesh_component(component, time_limit=TRIAL_SECONDS)
    except MeshTimeError:
        make_console().say(
            f"meshing takes more than {TRIAL_SECONDS:g} s of processor time: {UNTRIED}"
        )
    except MeshError as error:
        raise MeshError(
            f"{path} is written, but its part cannot be meshed as it is: {error}"
        ) from error


def _scene_name(folder: Path) -> str:
    """The scene is called like its folder, so that results of two scenes go to two folders."""
    return f"{folder.name}.toml"


def _box_scene(folder: Path) -> str:
    return SCENE.format(
        heading="A first scene: a steel block as a cantilever.",
        scene=_scene_name(folder),
        name="A block of steel",
        part=PART_NAME,
        solid='{ box = ["40 mm", "100 mm", "500 mm"] }   # x, y, z; or { step = "part.step" }',
        size="20 mm",
        pad="         ",
        accuracy="",
        mesh=SHAPED,
        interfaces=BOX_INTERFACES,
        free="",
        clamp=CLAMP.format(part=PART_NAME, foot="foot", tip="tip"),
        count=FIXED_MODES,
        variant="",
    )


def write_part_scene(
    part: Path,
    survey: CadSurvey,
    scene: str,
    *,
    solid: int | str | None,
    free: bool = False,
    unit: str | None = None,
    accuracy: bool = True,
) -> str:
    """The text of a scene around a part that lies beside it.

    Args:
        scene: Name of the scene's file.
        solid: Which solid of the file; None where it holds one.
        free: Without a support, and coupled nowhere in a way that would stiffen it; else at the first of
            its two ends.
        unit: Length unit of a mesh file; None of a STEP file.
        accuracy: Ask for one, of a STEP file.

    Raises:
        HeadstockError: It has no two planes to hold it at.
    """
    asked, mesh = (ACCURACY, CHOSEN) if accuracy and unit is None else ("", SHAPED)
    found = likely_interfaces(survey.faces)
    foot, tip = _choose_ends(found)
    screws = next((one for one in found if one.role == "screws" and not free), None)
    choice = "" if solid is None else f", solid = {_quote(solid)}"
    shape = f"{{ step = {_quote(part.name)}{choice} }}"
    if unit is not None:
        shape = f"{{ mesh = {_quote(part.name)}, unit = {_quote(unit)}{choice} }}"
    text = SCENE.format(
        heading=f"A first scene for {part.name}, whose faces `headstock show {part.name}` numbers and draws.",
        scene=scene,
        name=part.stem.replace('"', "'").replace("\\", "/"),
        part=PART_NAME,
        solid=shape,
        size=f"{1e3 * max(survey.size) / 25:.2g} mm",
        pad="         ",
        accuracy=asked,
        mesh=mesh,
        interfaces=_list_interfaces(survey, [tip] if free else [foot, tip], {foot, tip, screws}),
        free=FREE if free else "",
        clamp="" if free else CLAMP.format(part=PART_NAME, foot=foot.name, tip=tip.name),
        count=FREE_MODES if free else FIXED_MODES,
        variant="" if screws is None else _screwed(foot, screws),
    )
    if unit is None:
        return text
    # a finished mesh has the size it has
    lines = text.splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith("# mesh = "))


def _list_interfaces(
    survey: CadSurvey, chosen: list[LikelyInterface], used: set[LikelyInterface | None]
) -> str:
    """The interfaces of a part that are chosen, and as comments others than those that are used."""
    names, faces = {one.name for one in used if one}, [one.faces for one in used if one]
    others = [
        one for one in part_suggestions(survey) if one.faces not in faces and one.name not in names
    ]
    lines = format_suggestions(PART_NAME, chosen).splitlines()
    lines[-1] = lines[-1].replace(" }", ', coupling = "average" }', 1)
    if others:
        lines.append(
            "# others; an area stiffens the part unless its coupling is average, even where nothing acts on it:"
        )
    lines += [f"# {line}" for line in format_suggestions(PART_NAME, others).splitlines()[1:]]
    return "\n".join(lines)


def _choose_ends(found: Sequence[LikelyInterface]) -> tuple[LikelyInterface, LikelyInterface]:
    """What to hold and where to look.

    Raises:
        HeadstockError: There is no such pair.
    """
    ends = {one.role: one for one in found}
    if "foot" not in ends:
        raise HeadstockError(
            "the part has no two plane faces to hold it by; write the scene by hand, see docs/scene_reference.md"
        )
    return ends["foot"], ends["tip"]


def _describe_choice(found: Sequence[LikelyInterface]) -> str:
    """Where the part is held and loaded, which the reader may want to change."""
    foot, tip = _choose_ends(found)
    lines = [
        f"fixed at {foot.name}: {foot.reason}",
        f"loaded at {tip.name}: {tip.reason}",
        *(f"--variant {one.name}: fixed at {one.reason}" for one in found if one.role == "screws"),
        "other faces and holes are in the scene as comments",
    ]
    return "\n".join(lines)


def _screwed(foot: LikelyInterface, screws: LikelyInterface) -> str:
    patches = "\n".join(f"    {row}," for row in patch_rows(screws))
    return SCREWED.format(
        part=PART_NAME, foot=foot.name, screws=screws.name, reason=screws.reason, patches=patches
    )


def _quote(value: int | str) -> str:
    if isinstance(value, int):
        return str(value)
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _new_assembly(options: NewOptions, folder: Path) -> int:
    """Make a new folder with the scene of an assembly, and a copy of its file.

    Raises:
        click.UsageError: An option does not fit, or the file is no STEP file.
        HeadstockError: The file cannot be read, or the folder not be made.
    """
    file = options.assembly
    if file is None or file.suffix.lower() not in STEP_SUFFIXES:
        raise click.UsageError(f"{file} is no STEP file ({', '.join(STEP_SUFFIXES)})")
    given = {"--part": options.part, "--solid": options.solid, "--unit": options.unit}
    for name in [name for name, value in given.items() if value is not None]:
        raise click.UsageError(f"{name} does not go with --assembly")
    if not file.is_file():
        raise click.UsageError(f"there is no file {file}")
    scene = folder / f"{folder.name}.toml"
    with show_progress() as progress:

        def announce(text: str) -> None:
            progress.end()
            progress.begin(f"{text} of {file.name}")

        found = draft_assembly(file, scene.name, announce)
    texts = {**found.draft.texts, SCHEMA: dump_json(scene_schema())}
    texts[scene.name] = f"#:schema ./{SCHEMA}\n{texts[scene.name]}"
    fill_new_folder(folder, texts, [file])
    make_console().say(_describe_assembly(found))
    print_remarks(found.assembly.remarks)
    _say_next(scene, "check")
    return DONE


def _describe_assembly(found: AssemblyScene) -> str:
    """Return what was found, in a few lines."""
    kinds = [motion.likely for motion in found.motions]
    pairs = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    solids = counted(len(found.assembly.solids), "solid")
    shapes = counted(len(found.assembly.parts), "shape")
    left_out = counted(
        len(found.draft.left_out), "screw, nut or washer", "screws, nuts and washers"
    )
    return (
        f"{solids} of {shapes}; {counted(len(found.contacts), 'contact')} of "
        f"{counted(len(kinds), 'pair')}: {pairs or 'none'}\n"
        f"{left_out} left out, with their masses; {counted(found.draft.questions, 'question')}"
    )
