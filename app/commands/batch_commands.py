"""Options of commands that run a scene many times, or hold it against measurements: study, converge, sweep,
compare, correlate, identify.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import click

from headstock.app.commands.options import (
    AcceptDefaults,
    ClusterOptions,
    Debug,
    JsonFile,
    NoHost,
    NoWait,
    On,
    Overrides,
    Partition,
    PartOptions,
    Ranks,
    Sbatch,
    SceneFile,
    SceneOptions,
    TimeLimit,
    Variant,
    flag,
    load_action,
    option,
    output_option,
    read_percent,
)
from headstock.app.commands.plain_typer import typer

_Folder = Annotated[Path | None, output_option("DIR", "Folder of results [results/SCENE-NAME].")]


@dataclass(frozen=True, kw_only=True)
class StudyOptions(SceneOptions):
    """Vary keys of a scene and watch results; a stopped study continues."""

    action = "studying:study_command"
    collective = as_one_job = True
    scene: SceneFile
    name: Annotated[str, typer.Argument(metavar="NAME", help="One of the scene's [studies.NAME].")]
    output: _Folder = None
    variant: Variant = None
    set_: Overrides = None
    accept_defaults: AcceptDefaults = False
    ranks: Ranks = None
    cold: Annotated[
        bool,
        flag(
            "--cold", "Compute every point from an empty store, so that its seconds are complete."
        ),
    ] = False
    repeats: Annotated[
        int | None,
        option(
            "--repeats", "N", "Runs per point, for median and spread of the times.", min=1, max=100
        ),
    ] = None
    retry: Annotated[bool, flag("--retry", "Compute failed points again.")] = False
    no_host: NoHost = False
    json: JsonFile = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class ConvergeOptions(SceneOptions, PartOptions):
    """Find how fine the mesh of a part or a machine must be; a stopped series continues."""

    action = "converging:converge_command"
    collective = as_one_job = True
    scene: Annotated[
        Path, typer.Argument(metavar="FILE", help="Scene (.toml) or STEP part (.step, .stp).")
    ]
    output: Annotated[
        Path | None, output_option("DIR", "Folder of results [results/NAME-converge].")
    ] = None
    accuracy: Annotated[
        str, option("--accuracy", "SHARE", "Largest relative error of every number, as in 1%.")
    ] = "1 %"
    watch: Annotated[
        list[str] | None,
        option(
            "--watch",
            "NAME",
            "Numbers to watch, such as frequency or 'compliance(*point=tcp*)' [frequencies, compliances].",
        ),
    ] = None
    most_dofs: Annotated[
        int, option("--most-dofs", "N", "Approximate dofs of the finest mesh.", min=1000)
    ] = 300_000
    most_seconds: Annotated[
        float, option("--most-seconds", "S", "Approximate time of all meshes together.", min=1.0)
    ] = 600.0
    free: Annotated[
        bool, flag("--free", "Compute a STEP part without supports, not fixed at one end.")
    ] = False
    solid: Annotated[
        str | None, option("--solid", "NAME|N", "Which solid of a STEP file with several.")
    ] = None
    variant: Variant = None
    set_: Overrides = None
    accept_defaults: AcceptDefaults = False
    ranks: Ranks = None
    retry: Annotated[bool, flag("--retry", "Compute failed meshes again.")] = False
    no_host: NoHost = False
    json: JsonFile = None
    debug: Debug = False

    def __post_init__(self) -> None:
        """Refuse an accuracy that is no share, before anything is loaded."""
        read_percent(self.accuracy)


@dataclass(frozen=True, kw_only=True)
class SweepOptions(SceneOptions, ClusterOptions):
    """Repeat a scene's analyses in every pose of a sweep; a stopped sweep continues."""

    action = "sweeping:sweep_command"
    collective = True
    scene: SceneFile
    name: Annotated[str, typer.Argument(metavar="NAME", help="One of the scene's [sweeps.NAME].")]
    output: _Folder = None
    variant: Variant = None
    set_: Overrides = None
    accept_defaults: AcceptDefaults = False
    ranks: Ranks = None
    retry: Annotated[bool, flag("--retry", "Compute failed poses again.")] = False
    on: On = None
    tasks: Annotated[
        int | None, option("--tasks", "N", "With --on: array tasks [4].", min=1, max=1000)
    ] = None
    partition: Partition = None
    time_limit: TimeLimit = None
    sbatch: Sbatch = None
    no_wait: NoWait = False
    part: Annotated[
        str | None, typer.Option("--part", hidden=True, help="K/N: only this share of the poses.")
    ] = None
    key: Annotated[
        str | None, typer.Option("--key", hidden=True, help="Of the sweep that was submitted.")
    ] = None
    no_host: NoHost = False
    json: JsonFile = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class CompareOptions(SceneOptions):
    """Compare lumped models with finite elements, or variants of a scene: modes paired by shape,
    compliances, responses, weak links, seconds.
    """

    action = "comparing:compare_command"
    collective = as_one_job = True
    scene: SceneFile
    variants: Annotated[
        list[str] | None,
        option(
            "--variants",
            "A,B,C",
            "Variants [all]; A+B applies A, then B; 'as written' is the scene itself.",
        ),
    ] = None
    baseline: Annotated[
        bool,
        flag(
            "--baseline/--no-baseline",
            "Compare the variants with the scene as written, or not.",
        ),
    ] = True
    fidelity: Annotated[
        list[str] | None,
        option(
            "--fidelity",
            "A,B",
            "Fidelities of the elastic parts: rigid, segmented, elastic [all three without variants].",
        ),
    ] = None
    output: Annotated[
        Path | None, output_option("DIR", "Folder of results [results/SCENE-compare].")
    ] = None
    pose: Annotated[str | None, option("--pose", "NAME", "Pose [the first].")] = None
    reference: Annotated[
        str | None, option("--reference", "NAME", "Column to compare with [the most detailed].")
    ] = None
    effort: Annotated[
        bool, flag("--effort", "Start each variant from an empty store, and show its times.")
    ] = False
    change: Annotated[
        list[str] | None,
        option(
            "--change",
            "NAME",
            "With --effort: also the times after this variant or KEY=VALUE; repeatable.",
        ),
    ] = None
    set_: Overrides = None
    accept_defaults: AcceptDefaults = False
    ranks: Ranks = None
    no_host: NoHost = False
    json: JsonFile = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class CorrelateOptions(SceneOptions):
    """Compare a measured machine with its model: modes paired by shape, missing ones, channels that look
    wrong, frequency responses.
    """

    action = "correlating:correlate_command"
    collective = as_one_job = True
    scene: SceneFile
    test: Annotated[
        Path,
        typer.Argument(
            metavar="TEST", help="Test file, such as .uff: points, and modes or responses."
        ),
    ]
    output: Annotated[
        Path | None, output_option("DIR", "Folder of results [results/SCENE-TEST].")
    ] = None
    pose: Annotated[str | None, option("--pose", "NAME", "Pose of the test [the first].")] = None
    within: Annotated[
        str, option("--within", "SHARE", "Deviation up to which a frequency is met, as in 5%.")
    ] = "5 %"
    like: Annotated[
        Path | None,
        option(
            "--like",
            "TARGETS",
            "Targets (.toml) of a test before the machine was modified: its shapes name the modes.",
        ),
    ] = None
    expansion: Annotated[
        Literal["serep", "static", "dynamic"],
        typer.Option(
            "--expansion",
            click_type=click.Choice(["serep", "static", "dynamic"]),
            help="How measured shapes are expanded for the animation.",
        ),
    ] = "serep"
    variant: Variant = None
    set_: Overrides = None
    accept_defaults: AcceptDefaults = False
    ranks: Ranks = None
    no_host: NoHost = False
    json: JsonFile = None
    debug: Debug = False

    def __post_init__(self) -> None:
        """Refuse a deviation that is no share, before anything is loaded."""
        read_percent(self.within)


def _open_held_out(context: typer.Context, folder: Path | None) -> None:
    """Show what ``--hide-held-out`` hid; the command then needs no scene."""
    if folder is not None:
        json = context.params.get("json")
        raise typer.Exit(load_action("identifying:open_held_out")(folder, json))


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(SceneOptions):
    """Fit parameters of a scene to measured frequencies, shapes and compliances; the scene file is
    not changed.
    """

    action = "identifying:identify_command"
    collective = as_one_job = True
    scene: SceneFile
    targets: Annotated[
        Path,
        typer.Argument(
            metavar="TARGETS", help="Target file (.toml): what was measured, what may be fitted."
        ),
    ]
    output: Annotated[
        Path | None, output_option("DIR", "Folder of results [results/SCENE-TARGETS].")
    ] = None
    starts: Annotated[
        int | None, option("--starts", "N", "Number of starts [from the file].", min=1, max=4096)
    ] = None
    hide_held_out: Annotated[
        bool,
        flag("--hide-held-out", "Fit, and show nothing that was measured of held-out targets."),
    ] = False
    leave_out_each: Annotated[
        bool,
        flag("--leave-out-each", "Also predict each mode by a fit to all others."),
    ] = False
    open_: Annotated[
        Path | None,
        option(
            "--open",
            "FOLDER",
            "Compare the held-out targets of a folder of results with their predictions.",
            callback=_open_held_out,
        ),
    ] = None
    write: Annotated[
        str | None,
        option("--write", "NAME", "Also write variant NAME beside the scene, as SCENE.NAME.toml."),
    ] = None
    set_: Overrides = None
    accept_defaults: AcceptDefaults = False
    ranks: Ranks = None
    no_host: NoHost = False
    json: JsonFile = None
    debug: Debug = False
