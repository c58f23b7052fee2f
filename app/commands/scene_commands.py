"""Options of commands on one scene: check, plan, run, effects, export."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from headstock.app.commands.options import (
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
from headstock.pipeline.exchange.names import BODIES, FMUS, MACHINES


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
    """Write one component as matrices or as a mesh, the machine's state space as a file or an FMU, or
    its modes and frequency responses as a universal file (UFF).
    """

    action = "exporting:export_command"
    collective = True
    scene: SceneFile
    component: Annotated[
        str | None, typer.Argument(metavar="[COMPONENT]", help="Component to reduce or to mesh.")
    ] = None
    mesh: Annotated[
        Path | None,
        option(
            "--mesh",
            "FILE",
            "Write the component's mesh with its patches: .xdmf, .exo, .med, .bdf or .msh.",
        ),
    ] = None
    output: Annotated[
        Path | None, output_option("FILE", "File to write [COMPONENT.h5, SCENE.mat, ...].")
    ] = None
    to: Annotated[
        str | None,
        option(
            "--to",
            "FORMAT",
            f"Of a component {', '.join(BODIES)}; of the machine {', '.join(MACHINES)}.",
        ),
    ] = None
    state_space: Annotated[
        str | None,
        option("--state-space", "HZ", 'State space with modes up to here, such as "500 Hz".'),
    ] = None
    uff: Annotated[
        Path | None,
        option(
            "--uff",
            "FILE",
            "Modes and frequency responses as a test would have them: UFF 55 and 58.",
        ),
    ] = None
    step: Annotated[
        str | None, option("--step", "TIME", "Of an FMU, which holds its inputs over it [1 ms].")
    ] = None
    pose: Annotated[
        str | None,
        option("--pose", "NAME", "Pose of the state space, or of modes and responses [the first]."),
    ] = None
    variant: Variant = None
    set_: Overrides = None
    ranks: Ranks = None
    no_host: NoHost = False
    debug: Debug = False

    def __post_init__(self) -> None:
        """Refuse options that do not go together.

        Raises:
            click.UsageError: They do not.
        """
        for name, file in (("--mesh", self.mesh), ("--uff", self.uff)):
            if file is not None and (self.output is not None or self.state_space is not None):
                raise click.UsageError(f"{name} FILE goes without -o and --state-space")
        if self.uff is not None and (self.mesh is not None or self.component is not None):
            raise click.UsageError(
                "--uff FILE is of the whole machine; leave out COMPONENT and --mesh"
            )
        if self.step is not None and self.to not in FMUS:
            raise click.UsageError("--step goes with --to fmu3 or --to fmu2")
        if self.to is not None:
            self._require_owner(self.to)
        alone = self.mesh is None and self.uff is None
        if alone and (self.component is None) == (self.state_space is None):
            raise click.UsageError(
                "name a component to reduce, write --mesh FILE for its mesh, or "
                '--state-space "500 Hz" or --uff FILE for the whole machine'
            )

    def _require_owner(self, form: str) -> None:
        """Refuse a form that is unknown, or that is not one of what is exported."""
        if form not in (*BODIES, *MACHINES):
            raise click.UsageError(
                f"--to {form!r} is unknown; components: {', '.join(BODIES)}; machines: {', '.join(MACHINES)}"
            )
        whole = form in MACHINES
        if self.mesh is not None or self.uff is not None or whole == (self.state_space is None):
            owner = '--state-space "500 Hz"' if whole else "a COMPONENT"
            raise click.UsageError(f"--to {form} goes with {owner}")
