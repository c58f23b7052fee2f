"""``headstock effects``: a scene run with each effect switched the other way, and with each part of
its model changed; what each moves and costs, as blocks and sentences.
"""

import os
import tempfile
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path

import click

from headstock.app.actions.checking import load_chosen
from headstock.app.actions.publishing import is_same_scene, renew_report
from headstock.app.actions.running import require_ranks
from headstock.app.charts.effects import draw_worth
from headstock.app.commands.options import split_list
from headstock.app.commands.scene_commands import EffectsOptions
from headstock.app.report.marks import EFFECTS_FILE
from headstock.app.report.pages import render_effects
from headstock.app.report.report import Worth
from headstock.app.terminal.guard import DONE
from headstock.app.terminal.progress import show_progress
from headstock.geometry.errors import HeadstockError
from headstock.pipeline.numbers.estimates import show_share
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import write_output
from headstock.pipeline.storage.provenance import Provenance, SceneChoice
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.scene.expansion.overrides import VARIANT_JOINER
from headstock.scene.reading.findings import SceneError, suggest_names
from headstock.scene.scene import Scene
from headstock.scene.schema.effects import EFFECT_NAMES
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.effects import (
    EffectTrial,
    rank_trials,
    summarise_effects,
    try_effects,
)
from headstock.studies.good_enough import (
    VARIANT,
    Drop,
    append_variant,
    choose_drops,
    keep_within,
    name_variant,
)
from headstock.studies.kind_changes import MUCH, Change
from headstock.studies.model_influence import (
    CLEARLY,
    ModelFinding,
    RunPrice,
    rank_findings,
    try_models,
)
from headstock.studies.model_trials import MODEL_KINDS, ModelTrial, list_model_trials

EFFECTS = "effects"
KINDS = (EFFECTS, *MODEL_KINDS)  # what may be tried
SHOWN = 3  # kinds of numbers per effect


def _print_trials(trials: Sequence[EffectTrial]) -> None:
    """A block per effect that moves anything, those that matter most first, then a line per
    effect.
    """
    for trial in [trial for trial in trials if trial.largest > 0.0]:
        beside = f", in both runs beside {trial.together_with}" if trial.together_with else ""
        times = f"{_show_seconds(trial.seconds_with)} with, {_show_seconds(trial.seconds_without)} without"
        print(f"\n{trial.effect} ({'named' if trial.active else 'not named'}{beside}; {times})")
        for change in [change for change in trial.changes if change.share > 0.0][:SHOWN]:
            print(f"  {change.label:<24} {show_share(change.share):>9}   {_describe(change)}")
    print("\nSummary of effects")
    for trial in trials:
        print(f"  {_tell_trial(trial)}")


def _tell_trial(trial: EffectTrial) -> str:
    """One sentence: what it moves most, what it costs, what to do."""
    if trial.obstacle:
        return f"{trial.effect}: not tried: {trial.obstacle}"
    name = f"{trial.effect} beside {trial.together_with}" if trial.together_with else trial.effect
    if trial.largest == 0.0:
        times = f"{_show_seconds(trial.seconds_with)} with, {_show_seconds(trial.seconds_without)} without"
        return f"{name}: {trial.advice} ({times})"
    moved = trial.changes[0]
    cost = (
        f"{100.0 * trial.time_share:.0f} % of run time"
        if trial.time_share >= CLEARLY
        else f"less than {100.0 * CLEARLY:.0f} % of run time"
    )
    return f"{name}: {show_share(moved.share)} of {moved.label}, {cost}: {trial.advice}"


def _show_seconds(seconds: float) -> str:
    """Processor time with two digits."""
    return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"


def _describe(change: Change) -> str:
    shown = change.summarise()
    before, after = (
        "none" if value is None else f"{value:.5g}"
        for value in (shown["without"], shown["present"])
    )
    return f"{before} → {after} {shown['unit']} ({change.place})"


def effects_command(options: EffectsOptions, comm: MPI.Comm) -> int:
    """Try every effect of a scene and every change of its model on all ranks and print them, those
    that matter most first.

    Raises:
        SceneError: The scene has problems.
        click.UsageError: An option does not fit.
        HeadstockError: The scene cannot be run as written.
    """
    origin = options.trace(comm.size)
    require_ranks(options.ranks, comm)
    only = split_list(options.only) or KINDS
    scene = make_on_root(comm, lambda: _load(options, only, origin))
    if options.list_:
        return make_on_root(comm, lambda: _print_list(only, scene))
    if comm.rank > 0:
        _try_all(options.chosen, only, comm)
        return make_on_root(comm, lambda: DONE)
    print(f"{scene.name}: one change at a time")
    with show_progress() as progress:
        trials, findings = _try_all(
            options.chosen, only, comm, lambda text: progress.begin(text, 0.0)
        )
    return make_on_root(
        comm,
        lambda: _publish(options, scene, rank_trials(trials), rank_findings(findings), origin),
    )


def _try_all(
    chosen: SceneChoice,
    only: Sequence[str],
    comm: MPI.Comm,
    announce: Callable[[str], None] = lambda text: None,
) -> tuple[list[EffectTrial], list[ModelFinding]]:
    store, kinds = Store(default_store_root()), [kind for kind in MODEL_KINDS if kind in only]
    trials, findings = [], []
    if EFFECTS in only:
        trials = try_effects(chosen, store, comm=comm, announce=announce)
    if kinds:
        findings = try_models(chosen, store, kinds=kinds, comm=comm, announce=announce)
    return trials, findings


def _load(options: EffectsOptions, only: Sequence[str], origin: Provenance | None) -> Scene:
    unknown = [kind for kind in only if kind not in KINDS]
    if unknown:
        raise click.UsageError(f"--only: {suggest_names(unknown[0], KINDS, what='kinds')}")
    for file, option in ((options.json, "--json"), (options.page, "--page")):
        if file is not None and not file.absolute().parent.is_dir():
            raise click.UsageError(f"there is no folder {file.parent} for {option}")
    if options.report is not None:
        _check_results(options.report, origin)
    if (options.output is not None or options.force) and not options.write:
        raise click.UsageError("-o FILE and --force go with --write")
    if options.write:
        _check_target(options.chosen, options.output, force=options.force)
    return load_chosen(options.chosen)


def _check_results(folder: Path, origin: Provenance | None) -> None:
    """Refuse results of another scene, before anything is computed.

    Raises:
        UnusableOutputError: There are none.
        click.UsageError: They are of another scene.
    """
    known = read_summary(folder).get("provenance")
    if (
        origin is None
        or not isinstance(known, dict)
        or not is_same_scene(origin.summarise(), known)
    ):
        raise click.UsageError(
            f"--report: {folder} holds results of another scene, variant or --set; run this one with -o {folder}"
        )


def _print_list(only: Sequence[str], scene: Scene) -> int:
    """Print what would be tried; nothing is computed."""
    for effect in EFFECT_NAMES if EFFECTS in only else ():
        print(f"{effect}: {'off' if effect in scene.effects else 'on'}")
    kinds = [kind for kind in MODEL_KINDS if kind in only]
    for trial in list_model_trials(scene, plan_scene(scene), kinds):
        print(trial.name)
    return DONE


def _publish(
    options: EffectsOptions,
    scene: Scene,
    ranked: Sequence[EffectTrial],
    findings: Sequence[ModelFinding],
    origin: Provenance | None,
) -> int:
    if ranked:
        print("\nEffects switched on or off; processor seconds without meshing and reduction")
        _print_trials(ranked)
    _print_findings(findings)
    if scene.accuracy is not None:
        print(
            "\nNo models are tried: with an accuracy they are chosen by their errors, which"
            " summary.json of a run tells body by body"
        )
    summary = summarise_effects(scene.name, ranked, findings)
    if origin is not None:
        summary["provenance"] = origin.summarise()
    text = dump_summary(summary)
    options.write_json(text)
    if options.page is not None:
        page = render_effects(Worth(summary, draw_worth(summary)))
        write_output(options.page, page.encode())
    if options.report is not None:
        write_output(options.report / EFFECTS_FILE, text.encode())
        print(f"\n{renew_report(options.report)}")
    if options.write:
        _write_good_enough(options.chosen, scene, ranked, findings, options.output)
    return DONE


def _check_target(choice: SceneChoice, output: Path | None, *, force: bool) -> None:
    """Refuse a file that is there, before anything is computed.

    Raises:
        click.UsageError: It is the scene itself, or is there without ``force``.
    """
    target = _target(choice, output)
    if target.absolute() == choice.path.absolute():
        raise click.UsageError("--write leaves the scene as it is; name another file with -o")
    if target.exists() and not force:
        raise click.UsageError(f"{target} is there; name another file with -o, or add --force")
    if not target.absolute().parent.is_dir():
        raise click.UsageError(f"there is no folder {target.parent} for -o")


def _write_good_enough(
    choice: SceneChoice,
    scene: Scene,
    trials: Sequence[EffectTrial],
    findings: Sequence[ModelFinding],
    output: Path | None,
) -> None:
    """Try together what moves little alone, and write it as a variant.

    Args:
        output: File to write; None for one beside the scene.

    Raises:
        HeadstockError: The variant cannot be read where the file is to lie.
    """
    drops = choose_drops(scene, trials, findings)
    tried: dict[tuple[str, ...], ModelFinding] = {}

    def try_together(some: Sequence[Drop]) -> float:
        settings = tuple(setting for drop in some for setting in drop.settings)
        trial = ModelTrial("several", (), "all", "without", settings, "simpler")
        found = try_models(choice, Store(default_store_root()), trials=[trial])[0]
        if found.obstacle:
            raise HeadstockError(
                f"what may be dropped cannot be dropped together: {found.obstacle}"
            )
        tried[settings] = found
        return found.influence

    # of a lumped mechanism, effects alone can be dropped, each for less than a tenth of that
    kept = drops if scene.is_lumped else keep_within(drops, MUCH, try_together)
    if not kept:
        print("\nNothing may be dropped; no file is written")
        return
    target, name = _target(choice, output), name_variant(scene)
    content = append_variant(
        choice.path.read_bytes().decode(), kept, name=name, overrides=choice.overrides
    )
    whole = name if choice.variant is None else f"{choice.variant}{VARIANT_JOINER}{name}"
    _write_checked(target, content, whole)
    print(f"\n{target}: {len(kept)} of {len(drops)} that may be dropped, as a variant")
    settings = tuple(setting for drop in kept for setting in drop.settings)
    if settings in tried:
        found = tried[settings]
        print(
            f"together they move {found.changes[0].label} by {show_share(found.influence)}:"
            f" {found.written.cpu_seconds:.2g} s become {found.tried.cpu_seconds:.2g} s"
        )
    print(f"  ./headstock run {target} --variant {whole}")


def _target(choice: SceneChoice, output: Path | None) -> Path:
    return output or choice.path.with_name(f"{choice.path.stem}_{VARIANT}.toml")


def _write_checked(target: Path, content: str, variant: str) -> None:
    """Put the file in its place once it has been read with its variant beside that."""
    handle, place = tempfile.mkstemp(suffix=".toml", dir=target.absolute().parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode())
        plan_scene(load_scene(Path(place), variant=variant))
        Path(place).chmod(0o644)
        Path(place).replace(target)
    except SceneError as error:
        raise HeadstockError(
            f"{target} is not written: {error.problems[0].message}; write [variants] as a table"
            " of its own, and the file beside the scene"
        ) from error
    finally:
        Path(place).unlink(missing_ok=True)


COLUMNS = 100
MODES_SHOWN = 4  # answers per change
IDLE = 1e-5  # largest change of what is listed together at the end


def _print_findings(findings: Sequence[ModelFinding]) -> None:
    """A block per change of the model that moves anything, those that move most for their price
    first, then a line per change; those that move nothing to speak of share one.
    """
    tried = [each for each in findings if not each.obstacle]
    if not findings:
        return
    print("\nModels, one change at a time; processor seconds with meshing and reduction")
    if tried:
        print(f"as written: {_show_price(tried[0].written)}")
    idle = [each for each in tried if each.influence < IDLE]
    for each in [each for each in tried if each not in idle]:
        _print_finding(each)
    print("\nSummary of models, worth over price")
    for each in [each for each in findings if each not in idle]:
        _print_entry(each.trial.name, each.verdict)
    if idle:
        _print_entry(f"less than {show_share(IDLE)}", "; ".join(each.trial.name for each in idle))


def _print_finding(finding: ModelFinding) -> None:
    print(f"\n{finding.trial.name} ({_show_price(finding.tried)})")
    for what, modes in (("lacks", finding.missing), ("adds", finding.added)):
        more = [f"{len(modes) - MODES_SHOWN} more"] if len(modes) > MODES_SHOWN else []
        for words in [*modes[:MODES_SHOWN], *more]:
            print(f"  {what} {words}")
    for change in [change for change in finding.changes if change.share > IDLE][:MODES_SHOWN]:
        # its modes are named above
        if change.without is not None and change.present is not None:
            print(f"  {change.label:<28} {show_share(change.share):>9}   {_describe_model(change)}")


def _print_entry(head: str, words: str) -> None:
    """A line, or a head with indented lines below it where one would be too long."""
    line = f"  {head}: {words}"
    print(line if len(line) <= COLUMNS else f"  {head}:\n{_indent(words)}")


def _indent(words: str) -> str:
    return textwrap.fill(words, COLUMNS, initial_indent="      ", subsequent_indent="      ")


def _show_price(price: RunPrice) -> str:
    """Processor time with two digits, and peak memory."""
    seconds = price.cpu_seconds
    time = f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"
    return f"{time}, {price.peak_memory_mb:.0f} MB"


def _describe_model(change: Change) -> str:
    shown = change.summarise()
    written, tried = (
        f"{value:.5g}" for value in (shown["present"], shown["without"]) if value is not None
    )
    return f"{written} → {tried} {shown['unit']} ({change.place})"
