"""Files of an identification: its numbers as JSON, and the fitted values as variants to paste into
the scene.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import cast

import numpy as np

from headstock.pipeline.storage.json_texts import JsonTable, find_known, nest_known
from headstock.scene.reading.files import TomlTable, write_value
from headstock.scene.reading.findings import KeyPath, show_key
from headstock.scene.reading.keys import value_at, write_number, written_unit
from headstock.scene.scene import Scene
from headstock.studies.identification.descent import StartRecord
from headstock.studies.identification.identification import (
    FittedParameter,
    Identification,
    TargetOutcome,
)
from headstock.studies.identification.observations import KINDS
from headstock.studies.identification.problem import FitProblem
from headstock.studies.identification.statistics import Combination
from headstock.studies.identification.targets import MachineKey

OVERRIDES_FILE = "calibrated.toml"
RECORD_FILE = "identification.json"
HELD_OUT_FILE = "held_out.json"
VARIANT = "calibrated"


def hide_held_out(summary: JsonTable) -> tuple[JsonTable, list[JsonTable]]:
    """Return the content of ``identification.json`` without what was measured of held-out targets, and
    these targets in full.
    """
    shown: list[JsonTable] = []
    hidden: list[JsonTable] = []
    for row in cast(list[JsonTable], summary["targets"]):
        if row["hold_out"]:
            name = row["label"] or f"held out {len(hidden) + 1}"
            row = {**row, "name": f"{row['case']} {name}"}
            hidden.append(row)
            row = row | dict.fromkeys(("measured", "deviation", "residual_sigma", "mac"))
        shown.append(row)
    return {**summary, "targets": shown}, hidden


def summarise_identification(found: Identification) -> JsonTable:
    """Return the content of ``identification.json``.

    Values of parameters are in their units, None where they are open or were not given; fitted keys
    are by variant, the scene as written under an empty name.
    """
    statistics = found.statistics
    starts = [_summarise_start(found.problem, record) for record in found.starts]
    starts[found.best]["best"] = True
    return {
        "name": found.name,
        "status": "converged" if found.converged else "not converged",
        "parameters": {
            item.parameter.name: _summarise_parameter(item) for item in found.parameters
        },
        "combinations": [_summarise_combination(item) for item in statistics.combinations],
        "unidentifiable": [_summarise_combination(item) for item in statistics.unidentifiable],
        "correlated": [
            {"parameters": [first, second], "correlation": value}
            for first, second, value in found.correlated
        ],
        "targets": [summarise_outcome(item) for item in found.outcomes],
        "records": {
            target.name: dataclasses.asdict(record)
            for model in found.problem.cases
            for target, record in model.case.records
        },
        "extra_modes_hz": {name: list(values) for name, values in found.extra_hz.items()},
        "left_out_shapes": list(found.left_out),
        "exchanges": [*map(list, found.exchanges)],
        "noise_over_tolerance": statistics.noise.factor,
        "degrees_of_freedom": statistics.noise.freedom,
        "noise_by_kind": {
            kind: {"over_tolerance": noise.factor, "degrees_of_freedom": noise.freedom}
            for kind, noise in statistics.noise_by_kind.items()
        },
        # of ln p, or of p over the width of its bounds where the scale is linear
        "covariance": nest_known(statistics.covariance),
        "starts": starts,
        "keys": {
            f"{scene}:{variant or ''}".strip(":"): {
                show_key(key): text for key, text in values.items()
            }
            for (scene, variant), values in _write_keys(found, found.values).items()
        },
    }


def _write_keys(
    found: Identification, values: Mapping[str, float]
) -> dict[MachineKey, dict[KeyPath, str | float]]:
    """By machine of the target file: every key that follows a parameter with its value as the scene
    writes it; values in SI.
    """
    result: dict[MachineKey, dict[KeyPath, str | float]] = {}
    for state in found.point.states:
        parametric = state.model.parametric
        scene = parametric.scene
        result[state.model.case.machine] = {
            law.key: write_number(
                law.value(values), written_unit(scene.raw, law.key, scene.written)
            )
            for law in parametric.laws
            if law.rules
        }
    return result


def render_overrides(
    found: Identification, written: Scene, command: str, *, scene: str = "", name: str = VARIANT
) -> str:
    """Fitted values as variants of a scene, and what is known of them.

    Args:
        found: What was fitted.
        written: The scene without a variant: what it holds goes into the variant; keys and
            values that only one variant has go into ``NAME_VARIANT``, to be applied after it.
        command: How to get this file again.
        scene: Its name in the target file; empty for the scene that was fitted.
        name: Of the variant.
    """
    keys = {
        variant: values
        for (other, variant), values in _write_keys(found, found.values).items()
        if other == scene
    }
    shared = {
        key: value
        for values in keys.values()
        for key, value in values.items()
        if _has(written.raw, key)
    }
    lines = [
        f"# {command}",
        f"# Included by a scene (include = [...]) or pasted; apply as --variant VARIANT+{name}.",
    ]
    lines += [f"# {_describe(item)}" for item in found.parameters]
    lines += ["", f"[variants.{name}]", *_entries(shared)]
    for variant, values in keys.items():
        special = {key: value for key, value in values.items() if shared.get(key) != value}
        if special:
            own_name = f"{name}_{(variant or 'written').replace('+', '_')}"
            lines += [
                "",
                f"# --variant {variant}+{name}+{own_name}",
                f"[variants.{own_name}]",
                *_entries(special),
            ]
    return "\n".join([*lines, *_render_fit(found, scene, name)]) + "\n"


def _render_fit(found: Identification, scene: str, name: str) -> list[str]:
    """Return the lines of ``[fits.NAME]``: what is known of the fitted values."""
    problem, statistics = found.problem, found.statistics
    center = found.point.coordinates
    moves = []
    for change in statistics.list_moves():
        inside = (center + change >= problem.lower) & (center + change <= problem.upper)
        values = problem.values(center + (change if inside.all() else -change))
        keys: dict[KeyPath, str | float] = {}
        for (other, _), written in _write_keys(found, values).items():
            if other == scene:
                keys = written | keys
        moves.append(f"    {{ {', '.join(_entries(keys))} }},")
    names = [parameter.name for parameter in problem.parameters]
    unknown = [f'"{names[i]}"' for i in np.flatnonzero(~np.isfinite(statistics.sigmas))]
    scatter = {item.kind: 0.0 for item in found.outcomes}
    for item in found.outcomes:
        scatter[item.kind] = max(scatter[item.kind], item.scatter)
    shares = ", ".join(f'{kind} = "{100.0 * share:.2g} %"' for kind, share in scatter.items())
    return [
        "",
        "# what the measurements leave open: independent changes by half of a 95 % interval",
        f"[fits.{name}]",
        "moves = [",
        *moves,
        "]",
        f"open = [{', '.join(unknown)}]",
        f"scatter = {{ {shares} }}",
    ]


def _entries(values: Mapping[KeyPath, str | float]) -> list[str]:
    return [f'"{show_key(key)}" = {write_value(value)}' for key, value in values.items()]


def _has(raw: TomlTable, key: KeyPath) -> bool:
    """Whether the scene as written holds a key, and not as rigid."""
    try:
        return value_at(raw, key) != "rigid"
    except KeyError:
        return False


def _describe(item: FittedParameter) -> str:
    unit = item.parameter.unit
    value = write_number(item.value, unit, 4)
    if item.at_bound:
        return f"{item.parameter.name} = {value}: at its {item.at_bound} bound, no interval"
    if not math.isfinite(item.low):
        return f"{item.parameter.name} = {value}, 95 % interval: none, neither data nor a prior bound it"
    return f"{item.parameter.name} = {value}, 95 % interval {write_number(item.low, unit, 4)} .. {write_number(item.high, unit, 4)}"


def _summarise_parameter(item: FittedParameter) -> JsonTable:
    parameter = item.parameter
    values = (item.value, item.low, item.high, parameter.start, parameter.prior)
    shown = [_in_unit(value, parameter.unit) for value in values]
    bounds = [_in_unit(bound, parameter.unit) for bound in (parameter.lower, parameter.upper)]
    return {
        "unit": parameter.unit,
        **dict(zip(("value", "low_95", "high_95", "start", "prior"), shown, strict=True)),
        "bounds": bounds,
        "prior_sigma": parameter.prior_sigma,
        "scale": "log" if parameter.logarithmic else "linear",
        "data_share": item.data_share,
        "at_bound": item.at_bound or None,
    }


def _summarise_combination(item: Combination) -> JsonTable:
    return {
        "direction": dict(item.entries),
        "text": str(item),
        "spread_over_allowed": find_known(item.spread),
    }


def summarise_outcome(item: TargetOutcome) -> JsonTable:
    """Return a target as files have it, in its unit; None for what is not known."""
    kind = KINDS[item.kind]
    return {
        "case": item.case,
        "name": item.name,
        "label": item.label,
        "kind": item.kind,
        "unit": kind.unit,
        "measured": item.wanted * kind.scale,
        "model": item.found * kind.scale,
        "deviation": item.deviation,
        "relative_spread_95": find_known(item.spread),
        "relative_scatter_95": item.scatter,
        "relative_mesh_95": find_known(item.mesh),
        "residual_sigma": item.residual,
        "mac": item.mac,
        "mode": item.mode or None,
        "hold_out": item.hold_out,
    }


def _summarise_start(problem: FitProblem, record: StartRecord) -> JsonTable:
    return {
        "sum_of_squares": find_known(2.0 * record.cost),
        "evaluations": record.evaluations,
        "refused_evaluations": record.refused,
        "exchanges_of_modes": record.exchanges,
        "converged": record.converged,
        "reason": record.reason,
        "best": False,
        "start": problem.values(record.start),
        "end": None if record.end is None else problem.values(record.end.coordinates),
    }


def _in_unit(value: float | None, unit: str) -> float | None:
    if value is None or not math.isfinite(value):
        return None
    written = write_number(value, unit, 12)
    return written if isinstance(written, float) else float(written.split(" ")[0])
