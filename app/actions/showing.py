"""``headstock show``: a part with numbered faces, or a machine with named components."""

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from headstock.app.actions.checking import load_chosen, use_defaults
from headstock.app.commands.tool_commands import ShowOptions
from headstock.app.pictures.exploded import label_exploded
from headstock.app.pictures.machine_sketch import label_machine
from headstock.app.pictures.numbered import LabelledSurface, draw_numbered, show_numbered
from headstock.app.terminal.console import (
    add_row,
    make_console,
    make_table,
    print_remarks,
    print_table,
)
from headstock.app.terminal.guard import DONE
from headstock.app.terminal.machine import list_machine, print_machine
from headstock.geometry.parts.cad_faces import (
    CadFace,
    Vector,
    find_holes,
    name_faces,
)
from headstock.geometry.parts.interface_suggestions import LikelyInterface, likely_interfaces
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.components.survey import CadSurvey, suggest_sets, survey_mesh, survey_step
from headstock.meshing.formats import MESH_SUFFIXES
from headstock.meshing.length_units import doubt_size
from headstock.meshing.process.strangers import files_beside
from headstock.pipeline.preview.doubts import doubt_machine, measure_joints
from headstock.pipeline.preview.rigid_view import view_rigid
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import check_output, prepare_output, write_output
from headstock.scene.reading.units import LENGTH, UnitError, parse_quantity
from headstock.scene.scene import Scene

STEP_SUFFIXES = (".step", ".stp")
PART_SUFFIXES = (*STEP_SUFFIXES, *MESH_SUFFIXES)
FACES_SHOWN = 40
SHORT_LINE = 100


def show_command(options: ShowOptions) -> int:
    """Show a STEP or mesh file, a component of a scene that is read from one, or a scene.

    Raises:
        SceneError: The scene has problems.
        MeshError: The file of the part cannot be read.
        click.UsageError: An option does not fit.
    """
    if options.output is not None:
        prepare_output(options.output.absolute().parent)
        check_output(options.output)
    if options.scene.suffix.lower() in PART_SUFFIXES:
        return _show_part_file(options)
    scene = load_chosen(use_defaults(options.chosen))
    if options.component is None:
        return _show_machine(scene, options)
    if options.pose is not None or options.window:
        raise click.UsageError("--pose and --window show the whole machine: leave --component out")
    component = scene.machine.components.get(options.component)
    if component is None or not isinstance(component.solid, StepFile | MeshFile):
        known = [
            name
            for name, part in scene.machine.components.items()
            if isinstance(part.solid, StepFile | MeshFile)
        ]
        raise click.UsageError(
            f"no component {options.component!r} is read from a STEP or mesh file; those are: {', '.join(known) or 'none'}"
        )
    part = component.solid
    survey = (
        survey_mesh(part, f"{part.unit:g} m") if isinstance(part, MeshFile) else survey_step(part)
    )
    return _show_part(part, survey, component.name, options)


def _show_part_file(options: ShowOptions) -> int:
    if options.component is not None:
        raise click.UsageError("--component goes with a scene; a STEP file takes --solid")
    of_scenes = {
        "--variant": options.variant,
        "--set": options.set_,
        "--pose": options.pose,
        "--window": options.window,
    }
    given = [name for name, value in of_scenes.items() if value]
    if given:
        raise click.UsageError(f"{given[0]} goes with a scene; {options.scene.name} is a part")
    solid, survey = survey_part(options.scene, options.solid_choice, options.unit)
    return _show_part(solid, survey, options.scene.stem, options)


def _show_machine(scene: Scene, options: ShowOptions) -> int:
    """List and draw components, joints, supports and points of a scene in a pose.

    Raises:
        click.UsageError: There is no such pose, or no display for a window.
        DrawingError: pyvista is missing, or finds no OpenGL.
        HeadstockError: A part cannot be read or placed.
    """
    pose = options.pose
    if pose is not None and pose not in scene.poses:
        raise click.UsageError(f"no pose {pose!r}; poses: {', '.join(scene.poses)}")
    if options.window and not os.environ.get("DISPLAY"):
        raise click.UsageError(
            "--window needs a display, and DISPLAY is not set (over ssh: ssh -X); "
            "without --window a picture is written"
        )
    chosen = scene.poses[pose or next(iter(scene.poses))]
    view, supports = view_rigid(scene, chosen)
    placed = view.poses[chosen.name]
    gaps = measure_joints(scene, chosen)
    print_machine(scene, chosen, view, supports, gaps)
    print_remarks(doubt_machine(scene))
    options.write_json(dump_summary(list_machine(scene, placed, supports, gaps)))
    if not view.skins:
        return DONE
    exploded = scene.questions and not options.window
    surface = (
        label_exploded(scene, view, placed)
        if exploded
        else label_machine(
            f"{scene.name}, pose {chosen.name}", view, placed, supports, scene.machine.components
        )
    )
    if options.window:
        show_numbered(surface)
    else:
        _write_picture(surface, options.output or Path(f"{scene.path.stem}_machine.png"))
    return DONE


def _write_picture(surface: LabelledSurface, path: Path) -> None:
    """Draw a surface with labels from four sides to a PNG file.

    Raises:
        DrawingError: pyvista is missing, or finds no OpenGL.
        OutputError: The file cannot be written.
    """
    image, labelled = draw_numbered(surface)
    write_output(path, image)
    hidden = len(surface.labels) - len(labelled)
    remark = f" ({hidden} too small or hidden for a label)" if hidden else ""
    make_console().say(f"\npicture: {path}{remark}")


def survey_part(
    path: Path, solid: int | str | None, unit: str | None
) -> tuple[StepFile | MeshFile, CadSurvey]:
    """A part's file and what it holds.

    Args:
        path: STEP or mesh file.
        solid: Which solid of a STEP file, or set of solid cells of a mesh file.
        unit: Length of one unit of a mesh file, such as ``1 mm``; None to guess it.

    Raises:
        MeshError: The file cannot be read.
        click.UsageError: An option does not fit.
    """
    if not path.is_file():
        raise click.UsageError(
            f"{path} is no regular file" if path.exists() else f"there is no file {path}"
        )
    if path.suffix.lower() in STEP_SUFFIXES:
        if unit is not None:
            raise click.UsageError("--unit goes with a mesh file; a STEP file names its unit")
        step = StepFile(path.absolute(), solid)
        return step, survey_step(step)
    try:
        length = 1.0 if unit is None else parse_quantity(unit, LENGTH).value
    except UnitError as error:
        raise click.UsageError(f"--unit {error}") from error
    beside = tuple(path.absolute().parent / name for name in files_beside(path))
    mesh = MeshFile(path.absolute(), length, beside, None if solid is None else str(solid))
    return mesh, survey_mesh(mesh, unit)


def part_suggestions(survey: CadSurvey) -> list[LikelyInterface]:
    """Named sets of a mesh file first, then what the faces suggest."""
    named = suggest_sets(survey)
    taken = {found.name for found in named}
    return [
        *named,
        *(found for found in likely_interfaces(survey.faces) if found.name not in taken),
    ]


def format_suggestions(name: str, suggestions: Sequence[LikelyInterface]) -> str:
    """Suggested interfaces as TOML to paste."""
    lines = [f"[components.{name}.interfaces]"]
    for found in suggestions:
        if len(found.faces) == 1:
            lines.append(f'{found.name} = {{ face = "{found.faces[0]}" }}  # {found.reason}')
            continue
        rows = patch_rows(found)
        short = f"{found.name} = {{ patches = [{', '.join(rows)}] }}  # {found.reason}"
        # arrays may run over several lines, inline tables may not
        spread = [f"{found.name}.patches = [  # {found.reason}", *(f"    {r}," for r in rows), "]"]
        lines += [short] if len(short) <= SHORT_LINE else spread
    return "\n".join(lines)


def patch_rows(found: LikelyInterface) -> list[str]:
    """The patches of an interface in TOML, four in a line."""
    patches = [f'{{ face = "{face}" }}' for face in found.faces]
    return [", ".join(patches[start : start + 4]) for start in range(0, len(patches), 4)]


def _show_part(
    solid: StepFile | MeshFile, survey: CadSurvey, name: str, options: ShowOptions
) -> int:
    console, meshed = make_console(), isinstance(solid, MeshFile)
    x, y, z = (1e3 * side for side in survey.size)
    unit = survey.unit or "not understood"
    title = f"{solid.path.name}: {len(survey.faces)} faces, {x:.4g} × {y:.4g} × {z:.4g} mm"
    console.say(f"{title} (unit of the file: {unit})", style="bold")
    doubt = None if meshed else doubt_size(solid.path, max(survey.size))
    remarks = [] if doubt is None else [f"warning: {doubt}"]
    if meshed and options.component is None and options.unit is None:
        remarks = [
            f"a mesh file names no unit: its lengths are taken as {unit}; --unit says otherwise"
        ]
    for remark in remarks:
        console.say(remark, style="yellow")
    _print_sets(survey)
    _print_faces(survey, options.every_face)
    suggestions = part_suggestions(survey)
    if suggestions:
        console.say("\nInterfaces to choose from, to paste into a scene:\n", style="bold")
        console.say(format_suggestions(name, suggestions), soft_wrap=True)
    numbers = {face.number: str(face.number) for face in survey.faces}
    surface = LabelledSurface(survey.points, survey.triangles, survey.owners, numbers, title)
    _write_picture(surface, options.output or Path(f"{name}_faces.png"))
    options.write_json(dump_summary(_list_part(solid.path.name, survey, doubt)))
    return DONE


def _list_part(file: str, survey: CadSurvey, doubt: str | None) -> dict[str, object]:
    return {
        "file": file,
        "unit": survey.unit,
        "warnings": [] if doubt is None else [doubt],
        "faces": [dataclasses.asdict(face) for face in survey.faces],
        "holes": [dataclasses.asdict(hole) for hole in find_holes(survey.faces)],
        "sets": [dataclasses.asdict(one) for one in survey.sets],
        "suggested_interfaces": {
            found.name: list(found.faces) for found in part_suggestions(survey)
        },
    }


def _print_sets(survey: CadSurvey) -> None:
    if not survey.sets:
        return
    table = make_table("set", ">facets", ">area cm²", ">centre mm")
    for one in survey.sets:
        add_row(table, one.name, str(one.facets), f"{1e4 * one.area:.4g}", _in_mm(one.center))
    print_table(make_console(), "Named sets", table)


def _print_faces(survey: CadSurvey, every_face: bool) -> None:
    console = make_console()
    largest = sorted(survey.faces, key=lambda face: -face.area)
    shown = (
        survey.faces if every_face else sorted(largest[:FACES_SHOWN], key=lambda face: face.number)
    )
    table = make_table(
        ">face", "<kind", ">area cm²", ">centre mm", "<looks to", ">size mm", ">radius mm"
    )
    names = name_faces(survey.faces)
    for face in shown:
        name = names[face.number]
        number = str(face.number) if name.startswith("face:") else f"{name}  {face.number}"
        radius = f"{1e3 * face.radius:.5g}" if face.radius else ""
        kind = "hollow cyl" if face.hollow else face.kind  # the wall of a hole, or an inner fillet
        area = f"{1e4 * face.area:.4g}"
        add_row(
            table,
            number,
            kind,
            area,
            _in_mm(face.center),
            _describe_normal(face),
            _in_mm(face.size),
            radius,
        )
    print_table(
        console,
        "Faces"
        if len(shown) == len(survey.faces)
        else f"The {len(shown)} largest faces (--all lists all)",
        table,
    )


def _describe_normal(face: CadFace) -> str:
    normal = np.array(face.normal)
    axis = int(np.argmax(np.abs(normal)))
    if abs(normal[axis]) > 1.0 - 1e-9:
        return f"{'+' if normal[axis] > 0 else '-'}{'xyz'[axis]}"
    return (
        " ".join(f"{round(float(value), 2) + 0.0:.2f}" for value in normal)
        if face.kind == "plane"
        else ""
    )


def _in_mm(values: Vector) -> str:
    return " ".join(f"{round(1e3 * value, 1) + 0.0:.1f}" for value in values)
