"""Mesh convergence on the terminal, as CSV and as JSON: a row per mesh, limits and orders of every
number, the mesh that an accuracy takes, and all of it in one sentence.
"""

import shlex
from collections.abc import Sequence
from pathlib import Path

from headstock.app.tables.table import Cell, PlainTable, encode_csv
from headstock.app.terminal.console import (
    Screen,
    add_row,
    counted,
    make_console,
    make_table,
    print_remarks,
    print_table,
    spaced,
)
from headstock.app.texts.bounded_values import show_bound, show_bounded
from headstock.scene.reading.keys import write_size
from headstock.scene.studies import describe_point
from headstock.studies.parameters.convergence import (
    Convergence,
    MeshSeries,
    show_count,
)
from headstock.studies.parameters.features import FeatureTrial, MeshAdvice
from headstock.studies.parameters.limits import Limit, MeshedNumber, MeshNeed, list_deviations
from headstock.studies.parameters.runs import StudyProgress
from headstock.studies.parameters.tables import median_seconds

ERROR_LENGTH = 300
SETTINGS_SHOWN = 6
BESIDE_MESHES, PER_MESH, FEWEST_SHOWN = 48, 11, 2  # columns of the table of numbers
FILES = ("convergence.csv", "convergence.json")


def print_mesh(progress: StudyProgress) -> None:
    """Print one line per mesh, when it is finished."""
    _print_run(progress, f"mesh {progress.number + 1}", describe_point(progress.point))


def print_feature_trial(progress: StudyProgress) -> None:
    """Print one line per mesh without small features, when it is finished."""
    radius = next(iter(progress.point.varied.values()))
    _print_run(progress, "again ", f"without fillets and holes up to {radius}")


def _print_run(progress: StudyProgress, head: str, words: str) -> None:
    record, seconds = progress.record, median_seconds(progress.record)
    spent = f"{seconds[0]:8.2f} s" if seconds else f"{'':8}  "
    dofs = 0 if record.summary is None else record.summary["totals"]["full_dofs"]
    state = f"  {spaced(dofs)} dofs" if record.status == "done" else f"  failed: {record.error}"
    known = "  finished before" if progress.known else ""
    line = f"  {head}  {spent}  {words}{state[:ERROR_LENGTH]}{known}"
    make_console().say(line, soft_wrap=True)


def print_convergence(advice: MeshAdvice, *, folder: Path, files: Sequence[str]) -> None:
    """Meshes, numbers, needs, small features, the sentence, and where it all is.

    Args:
        advice: What the meshes say.
        files: Names of what was written there.
    """
    console, found = make_console(), advice.found
    console.print()
    _print_meshes(console, found)
    _print_numbers(console, found)
    _print_needs(console, found.series, advice.needs)
    _print_trials(console, advice.trials)
    print_remarks([f"left out: {failure[:ERROR_LENGTH]}" for failure in found.failures])
    console.say(f"no finer mesh: {found.end[:ERROR_LENGTH]}")
    console.say(_sum_up(advice), style="bold")
    meshes = counted(len(found.records), "mesh", "meshes")
    console.say(f"{meshes}, results in {folder} ({', '.join(files)})")


def _sum_up(advice: MeshAdvice) -> str:
    """One sentence: the first number, what an accuracy takes, and what may be left out."""
    found, need = advice.found, advice.needs[0]
    first, limit = found.watched[0], found.limits[0]
    bounded = f"{show_bounded(limit.value, limit.error)} {show_bound(limit.value, limit.error)}"
    seen = "" if limit.order is not None else f" ({limit.remark})"
    every = " in every number" if len(found.watched) > 1 else ""
    cost = f"{_show_seconds(need.seconds)} s, {show_count(need.memory_mb)} MB"
    mesh = f"about {show_count(need.dofs)} dofs ({_show_sizes(found.series, need.factor)})"
    ways = {
        "coarsest": f"{mesh} are enough",
        "between": f"you need {mesh}",
        "beyond": f"you need {mesh}, beyond the finest mesh,",
    }
    target = f"{100.0 * need.accuracy:g} %{every}"
    unknown = [
        watched.name
        for watched, reached in zip(found.watched, found.limits, strict=True)
        if reached.error is None
    ]
    if need.reach != "far":
        answer = f"{ways[need.reach]} for {target}: {cost}"
    elif unknown:
        answer = (
            f"the mesh for {target} is not known, since {unknown[0]} has no error estimate;"
            " --most-dofs allows finer meshes"
        )
    else:
        answer = f"{target} takes far more than {show_count(found.costs.dofs[-1])} dofs"
    return "; ".join(
        [f"{first.name} = {bounded} {first.unit}{seen}", answer, *_sum_features(advice)]
    )


def _sum_features(advice: MeshAdvice) -> list[str]:
    """What may be left out, as the last trial found it; nothing where none was made."""
    if not advice.trials:
        return []
    last = advice.trials[-1]
    radius, change = write_size(last.radius), _show_percent(last.change, signed=False)
    if last.matters:
        return [f"even fillets and holes up to {radius} matter ({change} of {last.decisive})"]
    return [f"fillets and holes up to {radius} do not matter ({change} at most)"]


def _show_sizes(series: MeshSeries, factor: float) -> str:
    """The element size, or those of several components, at a factor."""
    sizes = series.sizes(factor)
    if len(set(sizes.values())) == 1:
        return f"size {next(iter(sizes.values()))}"
    if len(sizes) <= 3:
        return "sizes " + ", ".join(f"{name} {size}" for name, size in sizes.items())
    return f"{factor:.2g} times the sizes in convergence.json"


def _errors(found: Convergence) -> list[list[float | None]]:
    """Of each watched number, the distances of its values from the limit."""
    return [
        list_deviations(series, limit)
        for series, limit in zip(found.watched, found.limits, strict=True)
    ]


def _print_meshes(console: Screen, found: Convergence) -> None:
    first, limit = found.watched[0], found.limits[0]
    own = list_deviations(first, limit)
    every = _errors(found)
    table = make_table(
        ">size", ">dofs", ">s", ">MB", f">{first.name} [{first.unit}]", ">from limit", "<furthest"
    )
    costs = found.costs
    for number, factor in enumerate(costs.factors):
        value, bound = first.values[number], first.bounds[number]
        shown = "-" if value is None else f"{show_bounded(value, bound)} {show_bound(value, bound)}"
        errors = {
            each.name: abs(error)
            for each, errors in zip(found.watched, every, strict=True)
            if (error := errors[number]) is not None
        }
        worst = max(errors, key=lambda name: errors[name]) if errors else ""
        sizes = set(found.series.sizes(factor).values())
        add_row(
            table,
            sizes.pop() if len(sizes) == 1 else f"× {factor:.2g}",
            spaced(costs.dofs[number]),
            _show_seconds(costs.seconds[number]),
            spaced(round(costs.memory_mb[number])),
            shown,
            _show_percent(own[number]),
            f"{_show_percent(errors[worst], signed=False)} {worst}" if worst else "",
        )
    print_table(console, "Meshes: cost of a run, and difference from the limit", table)


def _print_numbers(console: Screen, found: Convergence) -> None:
    count = len(found.costs.factors)
    shown = min(count, max(FEWEST_SHOWN, (console.width - BESIDE_MESHES) // PER_MESH))
    sizes = [
        _head(found.series, factor, finest=place == count - 1)
        for place, factor in enumerate(found.costs.factors)
    ][-shown:]
    table = make_table("<number", ">limit", ">order", *(f">{size}" for size in sizes), "")
    for each, limit in zip(found.watched, found.limits, strict=True):
        errors = list_deviations(each, limit)[-shown:]
        value = f"{show_bounded(limit.value, limit.error)} {show_bound(limit.value, limit.error)} {each.unit}"
        order = "-" if limit.order is None else f"{limit.order:.1f}"
        add_row(table, each.name, value, order, *map(_show_percent, errors), limit.remark)
    print_table(
        console,
        "Numbers: limit of an infinitely fine mesh, observed order, difference of each mesh from it",
        table,
    )


def _head(series: MeshSeries, factor: float, *, finest: bool) -> str:
    sizes = set(series.sizes(factor).values())
    return sizes.pop() if len(sizes) == 1 else "finest" if finest else f"× {factor:.2g}"


def _print_needs(console: Screen, series: MeshSeries, needs: Sequence[MeshNeed]) -> None:
    table = make_table(">for", ">dofs", ">s", ">MB", "size", "decided by")
    ways = {
        "coarsest": "the coarsest mesh is enough",
        "between": "",
        "beyond": ", beyond the finest mesh",
    }
    for need in sorted(needs, key=lambda need: -need.accuracy):
        by = "" if need.reach == "coarsest" else need.decisive
        if need.reach == "far":
            accuracy = f"{100.0 * need.accuracy:g} %"
            add_row(table, accuracy, "-", "-", "-", "-", f"{by}, too far beyond to estimate")
            continue
        add_row(
            table,
            f"{100.0 * need.accuracy:g} %",
            show_count(need.dofs),
            _show_seconds(need.seconds),
            show_count(need.memory_mb),
            _show_sizes(series, need.factor).removeprefix("size ").removeprefix("sizes "),
            f"{by}{ways[need.reach]}",
        )
    print_table(console, "Mesh needed for an accuracy of all numbers", table)
    asked = needs[0]
    if asked.reach != "far":
        written = [f"{key}={value}" for key, value in series.settings(asked.factor).items()]
        shown = " ".join(f"--set {shlex.quote(text)}" for text in written[:SETTINGS_SHOWN])
        more = " … (convergence.json)" if len(written) > SETTINGS_SHOWN else ""
        target = f"for {100.0 * asked.accuracy:g} %: {shown}{more}"
        console.say(target, soft_wrap=True)


def _print_trials(console: Screen, trials: Sequence[FeatureTrial]) -> None:
    if not trials:
        return
    table = make_table(">radius up to", ">dofs", ">with them", ">change", "<of", "")
    for trial in trials:
        add_row(
            table,
            write_size(trial.radius),
            spaced(trial.dofs),
            spaced(trial.dofs_with),
            _show_percent(trial.change, signed=False),
            trial.decisive,
            "matters" if trial.matters else "does not matter",
        )
    title = "Without fillets, holes and pins (mesh.leave_out): largest change of a number"
    print_table(console, title, table)


def _show_seconds(seconds: float) -> str:
    return f"{seconds:.2g}" if seconds < 100.0 else show_count(seconds)


def _show_percent(share: float | None, *, signed: bool = True) -> str:
    if share is None:
        return "-"
    text = f"{100.0 * share:+.2g}" if abs(share) < 0.1 else f"{100.0 * share:+.0f}"
    return f"{text if signed else text.lstrip('+')} %"


def list_convergence(advice: MeshAdvice, scene: Path) -> dict[str, object]:
    """Return the content of ``convergence.json``: everything that is printed, meshes from coarse to fine."""
    found, costs, series = advice.found, advice.found.costs, advice.found.series

    def list_mesh(
        factor: float, dofs: float, seconds: float, memory_mb: float
    ) -> dict[str, object]:
        return {
            "sizes": series.sizes(factor),
            "settings": dict(series.settings(factor)),
            "dofs": dofs,
            "seconds": seconds,
            "memory_mb": memory_mb,
        }

    return {
        "scene": scene.name,
        "text": _sum_up(advice),
        "meshes": [
            list_mesh(*mesh)
            for mesh in zip(costs.factors, costs.dofs, costs.seconds, costs.memory_mb, strict=True)
        ],
        "numbers": [
            _list_number(each, limit)
            for each, limit in zip(found.watched, found.limits, strict=True)
        ],
        "needs": [
            {
                "accuracy": need.accuracy,
                **list_mesh(need.factor, need.dofs, need.seconds, need.memory_mb),
                "decided_by": need.decisive,
                "reach": need.reach,
            }
            for need in advice.needs
        ],
        "features": [
            {
                "radius_m": trial.radius,
                "change": trial.change,
                "decided_by": trial.decisive,
                "dofs": trial.dofs,
                "dofs_with": trial.dofs_with,
                "matters": trial.matters,
            }
            for trial in advice.trials
        ],
        "end": found.end,
        "failures": list(found.failures),
    }


def _list_number(each: MeshedNumber, limit: Limit) -> dict[str, object]:
    return {
        "name": each.name,
        "title": each.title,
        "unit": each.unit,
        "values": list(each.values),
        "error_estimates": list(each.bounds),
        "from_limit": list_deviations(each, limit),
        "limit": limit.value,
        "limit_error": limit.error,
        "order": limit.order,
        "remark": limit.remark,
    }


def convergence_csv(found: Convergence) -> bytes:
    """Tabulate a row per mesh; of each number its value, what stands behind ±, and how far from the
    limit.
    """
    costs = found.costs
    errors = _errors(found)
    names = [
        head
        for each in found.watched
        for head in (f"{each.name} [{each.unit}]", f"± {each.name}", f"{each.name} from limit")
    ]
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            ", ".join(found.series.sizes(factor).values()),
            costs.dofs[number],
            costs.seconds[number],
            costs.memory_mb[number],
            *(
                cell
                for each, own in zip(found.watched, errors, strict=True)
                for cell in (each.values[number], each.bounds[number], own[number])
            ),
        )
        for number, factor in enumerate(costs.factors)
    )
    limits = [cell for limit in found.limits for cell in (limit.value, limit.error, limit.order)]
    last = ("limit, ±, order", None, None, None, *limits)
    return encode_csv(
        PlainTable("convergence", ("size", "dofs", "seconds", "MB", *names), (*rows, last))
    )
