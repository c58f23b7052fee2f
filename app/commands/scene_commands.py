"""Options of commands on one scene: check, plan, run, effects, export."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from headstock.app.commands.options import (
    AcceptDefaults,
    Accuracy,
    Debug,
    Fidelities,
    JsonFile,
    Names,
    NoHost,
    Overrides,
    Ranks,
    SceneFile,
    SceneOptions,
    Variant,
    flag,
    option,
    output_option,
)
from headstock.app.commands.plain_typer import typer
from headstock.scene.exports import MOTORS, list_formats


@dataclass(frozen=True, kw_only=True)
class CheckOptions(SceneOptions):
    """Check a scene and list every problem; nothing is computed."""

    action = "checking:check_command"
    scene: SceneFile
    variant: Variant = None
    set_: Overrides = None
    json: JsonFile = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class PlanOptions(SceneOptions):
    """Print the stages of a run, with reasons, dofs and memory."""

    action = "planning:plan_command"
    scene: SceneFile
    variant: Variant = None
    analysis: Names = None
    set_: Overrides = None
    accuracy: Accuracy = None
    fidelity: Fidelities = None
    json: JsonFile = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class RunOptions(SceneOptions):
    """Run a scene: static compliance with its budget, natural modes, frequency responses."""

    action = "running:run_command"
    collective = as_one_job = True
    scene: SceneFile
    output: Annotated[Path | None, output_option("DIR", "Folder of results [results/NAME].")] = None
    variant: Variant = None
    analysis: Names = None
    set_: Overrides = None
    accept_defaults: AcceptDefaults = False
    ranks: Ranks = None
    no_figures: Annotated[
        bool, flag("--no-figures", "Draw no pictures of the machine: saves about a second.")
    ] = False
    volume: Annotated[
        bool,
        flag(
            "--volume",
            "Write volume meshes with modes, static responses and stresses, too (volume/*.vtu).",
        ),
    ] = False
    accuracy: Accuracy = None
    fidelity: Fidelities = None
    no_host: NoHost = False
    json: JsonFile = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class EffectsOptions(SceneOptions):
    """Switch each effect on or off and change each part of the model: worth, price, verdict."""

    action = "effecting:effects_command"
    collective = as_one_job = True
    scene: SceneFile
    variant: Variant = None
    analysis: Names = None
    set_: Overrides = None
    accept_defaults: AcceptDefaults = False
    only: Annotated[
        list[str] | None,
        option(
            "--only",
            "A,B",
            "Try these only: effects, elasticity, interfaces, modes, mesh, pose.",
        ),
    ] = None
    list_: Annotated[bool, flag("--list", "List what would be tried; nothing is computed.")] = False
    write: Annotated[
        bool, flag("--write", "Write what may be dropped as a variant of the scene.")
    ] = False
    output: Annotated[
        Path | None, output_option("FILE", "Scene file of --write [SCENE_good_enough.toml].")
    ] = None
    force: Annotated[bool, flag("--force", "Let --write replace a file that is there.")] = False
    page: Annotated[
        Path | None, option("--page", "FILE", "Write a page with the chart as HTML.")
    ] = None
    report: Annotated[
        Path | None,
        option("--report", "DIR", "Show it in the report of a finished run of the scene."),
    ] = None
    ranks: Ranks = None
    no_host: NoHost = False
    json: JsonFile = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class ExportOptions(SceneOptions):
    """Write a component as matrices or as a mesh, or the machine as a state space, an FMU, or modes and
    frequency responses as a test has them.
    """

    action = "exporting:export_command"
    collective = True
    scene: SceneFile
    component: Annotated[
        str | None, typer.Argument(metavar="[COMPONENT]", help="Component to reduce or to mesh.")
    ] = None
    to: Annotated[
        str | None,
        option(
            "--to",
            "FORMAT",
            f"Matrices of a component: {list_formats('body')} [h5]; its mesh: {list_formats('mesh')}; "
            f"the machine: {list_formats('space')} [mat with --hz], {list_formats('test')}.",
        ),
    ] = None
    output: Annotated[
        Path | None, output_option("FILE", "File to write [COMPONENT.h5, SCENE.mat, ...].")
    ] = None
    hz: Annotated[
        str | None,
        typer.Option(
            "--hz",
            "--state-space",
            metavar="HZ",
            help='Of a state space: modes up to here, such as "500 Hz".',
        ),
    ] = None
    step: Annotated[
        str | None,
        option(
            "--step",
            "TIME",
            "Of a state space whose inputs are held over it [of an FMU 1 ms or less, else continuous].",
        ),
    ] = None
    balanced: Annotated[
        str | None,
        option(
            "--balanced",
            "ERROR",
            'Leave out states of a state space up to an error, such as "1 %" of the largest response.',
        ),
    ] = None
    motors: Annotated[
        str | None,
        option("--motors", "STATE", f"Of a state space: {', '.join(MOTORS)} [locked]."),
    ] = None
    travel: Annotated[
        list[str] | None,
        option(
            "--travel", "AXES", "Axes whose positions may change in a state space, such as X,Y."
        ),
    ] = None
    error: Annotated[
        str | None,
        option("--error", "ERROR", "Of the frequency response anywhere along the travel [1 %]."),
    ] = None
    pose: Annotated[str | None, option("--pose", "NAME", "Pose of the machine [the first].")] = None
    mesh: Annotated[
        Path | None,
        option("--mesh", "FILE", "The mesh of a component; the ending chooses the format."),
    ] = None
    uff: Annotated[
        Path | None, option("--uff", "FILE", "Modes and responses of the machine: UFF 55 and 58.")
    ] = None
    variant: Variant = None
    set_: Overrides = None
    accept_defaults: AcceptDefaults = False
    ranks: Ranks = None
    no_host: NoHost = False
    debug: Debug = False
