"""What the terminal shows of an identification: starts as they end, parameters with intervals, targets, and what is not seen."""

import math
from pathlib import Path

from headstock.app.terminal.console import add_row, make_console, make_table, print_table
from headstock.scene.reading.keys import write_number
from headstock.studies.identification.descent import StartRecord
from headstock.studies.identification.files import RECORD_FILE
from headstock.studies.identification.identification import FittedParameter, Identification, TargetOutcome
from headstock.studies.identification.targets import IdentificationTask

CORRELATION_SHOWN = 0.9
SEEN_FAINTLY = 0.5
BLIND_SHOWN = 6


def print_task(task: IdentificationTask) -> None:
    """Name what is fitted to what."""
    held_out = [held for case in task.cases for held in case.held_out]
    held = sum(held_out)
    text = f"{len(task.parameters)} parameters, {len(held_out) - held} targets in {len(task.cases)} cases"
    make_console().print(f"{task.name}  ({text}{f', {held} held out' if held else ''})", style="bold", markup=False)


def print_start(record: StartRecord) -> None:
    """One line per start."""
    refused = f", {record.refused} refused" if record.refused else ""
    moved = f", {record.exchanges} exchange(s) of modes" if record.exchanges else ""
    cost = f"{2.0 * record.cost:12.5g}"
    line = f"  start  sum of squares {cost}  {record.evaluations:4d} evaluations{moved}{refused}  {record.reason}"
    make_console().print(line, markup=False, soft_wrap=True)


def print_identification(found: Identification, folder: Path) -> None:
    """Everything a fit found."""
    console = make_console()
    console.print()
    table = make_table("parameter", ">fitted", ">95 % from", ">to", ">seen", "note")
    for item in found.parameters:
        add_row(table, *_parameter_cells(item))
    print_table(console, "Parameters (seen: share of what was open beforehand that the data settle)", table)
    table = make_table("target", ">measured", ">model", ">deviation", ">in sigma", ">MAC", ">mode", "")
    for outcome in found.outcomes:
        add_row(table, *_outcome_cells(outcome))
    print_table(console, "Targets", table)
    for case, extra in found.extra_hz.items():
        if extra:
            shown = ", ".join(f"{value:.4g}" for value in extra)
            console.print(f"{case}: the model has {len(extra)} further mode(s) in the range: {shown} Hz", markup=False)
    _print_doubts(found)
    fitted = [abs(item.deviation) for item in found.outcomes if not item.hold_out]
    status = "converged" if found.converged else f"not converged: {found.starts[found.best].reason}"
    text = f"{status}; largest deviation {100.0 * max(fitted):.2f} %; written to {folder}"
    console.print(text, style="bold", markup=False)


def _parameter_cells(item: FittedParameter) -> tuple[str, ...]:
    unit = item.parameter.unit
    known = math.isfinite(item.low)
    ends = [f"{write_number(end, unit, 4)}" if known else "open" for end in (item.low, item.high)]
    notes = [f"at its {item.at_bound} bound"] if item.at_bound else []
    if item.seen < SEEN_FAINTLY:
        within = "the prior" if item.parameter.prior_sigma is not None else "its bounds"
        notes.append(f"unobservable: within {within}")
    return (item.parameter.name, f"{write_number(item.value, unit, 4)}", *ends, f"{100.0 * item.seen:.0f} %", "; ".join(notes))


def _outcome_cells(item: TargetOutcome) -> tuple[str, ...]:
    wanted, model = (
        f"{value:.4g} Hz" if item.kind == "frequency" else f"{1e9 * value:.4g} µm/kN" for value in (item.wanted, item.found)
    )
    mac = "" if item.mac is None else f"{item.mac:.2f}"
    mode = str(item.mode) if item.mode else ""
    note = "held out" if item.hold_out else ""
    return item.name, wanted, model, f"{100.0 * item.deviation:+.2f} %", f"{item.residual:+.2f}", mac, mode, note


def _print_doubts(found: Identification) -> None:
    console, statistics = make_console(), found.statistics
    for blind in statistics.blind[-BLIND_SHOWN:][::-1]:  # the blindest come last
        console.print(f"the data do not see {blind}", style="yellow", markup=False)
    if len(statistics.blind) > BLIND_SHOWN:
        more = len(statistics.blind) - BLIND_SHOWN
        console.print(f"nor {more} further direction(s), in {RECORD_FILE}", style="yellow", markup=False)
    names = [item.parameter.name for item in found.parameters]
    for i, first in enumerate(names):
        for j, second in enumerate(names[:i]):
            value = statistics.correlations[i, j]
            if abs(value) >= CORRELATION_SHOWN:
                console.print(f"correlated {value:+.2f}: {second} and {first}", style="yellow", markup=False)
    if statistics.noise is not None:
        text = f"residuals are {statistics.noise:.2g} times the stated tolerances ({statistics.freedom:.1f} degrees of freedom)"
        console.print(text, markup=False)
