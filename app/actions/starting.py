"""``headstock new``: a folder with a scene that runs as it is, for a box or for a part of the user's
own from a STEP or mesh file.
"""

import os
import shlex
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

from headstock.app.actions.schemas import scene_schema
from headstock.app.actions.showing import (
    PART_SUFFIXES,
    format_suggestions,
    part_suggestions,
    patch_rows,
    survey_part,
)
from headstock.app.commands.tool_commands import NewOptions
from headstock.app.terminal.console import make_console
from headstock.app.terminal.guard import DONE
from headstock.geometry.errors import HeadstockError
from headstock.geometry.parts.interface_suggestions import LikelyInterface, likely_interfaces
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.components.survey import CadSurvey
from headstock.meshing.errors import MeshError, MeshTimeError
from headstock.meshing.length_units import doubt_size
from headstock.pipeline.storage.json_texts import dump_json
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
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise click.UsageError(
            f"{folder} exists and is not an empty folder; nothing was changed: choose another name"
        )
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
    try:
        _fill_folder(folder, text, files)
    except OSError as error:
        raise click.UsageError(f"{folder} cannot be made: {error.strerror or error}") from error
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
    # as the reader types it: the launcher says how it was called
    command = shlex.quote(os.environ.get("HEADSTOCK_COMMAND", "headstock"))
    console.say(
        f"{scene} is ready; next: {command} run {shlex.quote(str(scene))}",
        soft_wrap=True,
    )
    return DONE


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


def _fill_folder(folder: Path, text: str, files: Sequence[Path]) -> None:
    """All or nothing: the folder appears when it is complete."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".headstock-new-", dir=folder.parent) as made:
        scene = Path(made, folder.name)
        scene.mkdir()
        (scene / _scene_name(folder)).write_text(text)
        (scene / SCHEMA).write_text(dump_json(scene_schema()))
        for file in files:
            shutil.copyfile(file, scene / file.name)
        scene.replace(folder)  # an empty folder of that name gives way


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
