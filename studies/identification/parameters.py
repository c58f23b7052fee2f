"""From the table of a parameter to scene keys, bounds and a prior in SI units, checked against
every variant.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.parts.solids import SuperelementFile
from headstock.scene.expansion.parameters import PARAMETERS
from headstock.scene.reading.findings import Findings, show_key
from headstock.scene.reading.keys import (
    NUMBER,
    find_keys,
    read_number,
    split_key,
    value_at,
    written_unit,
)
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.units import Dimension, Quantity
from headstock.scene.scene import Scene
from headstock.studies.identification.key_laws import ParameterValueError, find_laws, holds_number
from headstock.studies.identification.schema import (
    ParameterTable,
    PowerRuleTable,
    SetRuleTable,
    ShiftRuleTable,
    TargetsTable,
)
from headstock.studies.identification.targets import KeyRule, Parameter

Scenes = Mapping[str | None, Scene]
Rule = SetRuleTable | PowerRuleTable | ShiftRuleTable
_FREE_OF_MESH = ("at", "rotate", "mass")
_PLACES: dict[str, tuple[str, ...]] = {
    "components": ("solid", "mass", "at", "rotate", "interfaces"),
    "joints": ("stiffness", "at"),
    "materials": ("E", "nu", "rho"),
}


@dataclass(frozen=True)
class _Target:
    """A scene key that a parameter's rule names, with an example of its value."""

    rule: KeyRule
    quantity: Quantity
    unit: str
    place: KeyPath


def read_parameters(
    table: TargetsTable, scenes: Scenes, findings: Findings
) -> tuple[Parameter, ...]:
    """The parameters of a target file; those with a fault are reported and left out.

    Args:
        table: The target file, as checked against its schema.
        scenes: The scene of each variant that the targets use.
        findings: Takes the faults, with their place in the file.
    """
    found = []
    setters: dict[KeyPath, str] = {}
    for name, entry in table.parameters.items():
        key: KeyPath = ("parameters", name)
        targets = [
            target
            for kind, rules in _rules_by_kind(entry)
            for index, rule in enumerate(rules)
            for target in _find_targets(key, kind, index, rule, scenes, findings)
        ]
        for target in targets:
            if target.rule.kind == "set" and setters.setdefault(target.rule.key, name) != name:
                text = f"{show_key(target.rule.key)} is set by the parameter {setters[target.rule.key]!r} already; keep one"
                findings.add(target.place, text)
        parameter = _read_parameter(name, entry, targets, findings) if targets else None
        if parameter is not None:
            found.append(parameter)
            _check_followers(parameter, targets, scenes, findings)
    return tuple(found)


def _check_followers(
    parameter: Parameter, targets: Sequence[_Target], scenes: Scenes, findings: Findings
) -> None:
    """Report numbers that a scene calculates from a fitted one of its own parameters and that
    cannot be fitted, and a fitted one that nothing is calculated from.
    """
    named = [target for target in targets if target.rule.key[0] == PARAMETERS]
    if not named:
        return
    first, found = named[0], 0
    for scene in scenes.values():
        try:
            laws = [law for law in find_laws(scene, (parameter,)) if law.calculated is not None]
        except ParameterValueError as error:
            findings.add(first.place, str(error))
            return
        found += len(laws)
        faults = [_find_fault(law.key, scene) for law in laws if law.key[2] != "mesh"]
        for fault in [fault for fault in faults if fault][:1]:
            name = show_key(first.rule.key)
            findings.add(
                first.place, f"a value is calculated from {name} that no fit takes: {fault}"
            )
            return
    if not found:
        name = show_key(first.rule.key[1:])
        findings.add(
            first.place,
            f"no dimension, mass, place, material or stiffness of the scene is calculated from {name!r}; "
            f'write one as "= {name}", or fit a key',
        )


def _rules_by_kind(table: ParameterTable) -> tuple[tuple[str, Sequence[Rule]], ...]:
    return ("set", table.keys), ("multiply", table.multiplies), ("shift", table.shifts)


def _find_targets(
    base: KeyPath, kind: str, index: int, rule: Rule, scenes: Scenes, findings: Findings
) -> list[_Target]:
    """Every key a rule means, in any of the variants."""
    place: KeyPath = (
        *base,
        {"set": "keys", "multiply": "multiplies", "shift": "shifts"}[kind],
        index,
    )
    try:
        pattern = split_key(rule.key)
    except ValueError as error:
        findings.add(place, str(error))
        return []
    found: dict[KeyPath, _Target] = {}
    fault = ""
    for scene in scenes.values():
        for key in find_keys(scene.raw, pattern):
            fault = fault or _find_fault(key, scene)
            if key not in found and holds_number(scene.raw, key):
                factor = rule.power if isinstance(rule, PowerRuleTable) else rule.factor
                offset = (
                    rule.offset.value
                    if isinstance(rule, SetRuleTable) and rule.offset is not None
                    else 0.0
                )
                quantity = read_number(scene.raw, key)
                found[key] = _Target(
                    KeyRule(key, kind, factor, offset),
                    quantity,
                    written_unit(scene.raw, key, scene.written),
                    place,
                )
                if (
                    isinstance(rule, SetRuleTable)
                    and rule.offset is not None
                    and rule.offset.dimension != quantity.dimension
                ):
                    fault = f"offset is a {rule.offset.dimension.name} and the key holds a {quantity.dimension.name}"
    if not found and not fault:
        fault = _explain_missing(pattern, rule.key, scenes)
    if fault:
        findings.add(place, fault)
        return []
    return list(found.values())


def _explain_missing(pattern: KeyPath, text: str, scenes: Scenes) -> str:
    for scene in scenes.values():
        for key in find_keys(scene.raw, pattern):
            try:
                read_number(scene.raw, key)
            except ValueError as error:
                return str(error)
    raw = next(iter(scenes.values())).raw
    depth = max(length for length in range(len(pattern) + 1) if find_keys(raw, pattern[:length]))
    table = value_at(raw, find_keys(raw, pattern[:depth])[0])
    holds = (
        ", ".join(list(table)[:20])
        if isinstance(table, dict)
        else f"{len(table)} entries"
        if isinstance(table, list)
        else "a value"
    )
    where = show_key(pattern[:depth]) or "the scene"
    return f"no variant named here writes {text[:80]!r}: {where} holds {holds}; a number that is fitted is written in the scene"


def _find_fault(key: KeyPath, scene: Scene) -> str:
    """Why a key of the scene cannot be fitted; empty where it can."""
    section = str(key[0])
    if section == PARAMETERS:
        return ""  # what is calculated from it is looked at once its bounds are known
    if len(key) < 3 or section not in _PLACES or key[2] not in _PLACES[section]:
        places = "; ".join(
            [
                "parameters.NAME",
                *(f"{name}.NAME.{'|'.join(keys)}" for name, keys in _PLACES.items()),
            ]
        )
        return f"{show_key(key)} cannot be fitted; what can: {places}"
    variant = f"in variant {scene.variant}" if scene.variant else "in the scene as written"
    if section == "components" and key[2] not in _FREE_OF_MESH:
        component = scene.machine.components[str(key[1])]
        if isinstance(component.solid, SuperelementFile):
            return f"{key[1]} is an imported superelement {variant}; fit its place, mass or joints"
    return ""


def _read_parameter(
    name: str, table: ParameterTable, targets: list[_Target], findings: Findings
) -> Parameter | None:
    key: KeyPath = ("parameters", name)
    before = len(findings.problems)
    first = next((target for target in targets if target.rule.kind == "set"), None)
    shifted = next((target for target in targets if target.rule.kind == "shift"), None)
    example = first or shifted
    dimension = NUMBER if example is None else example.quantity.dimension
    if first is not None:
        reference = (
            (first.quantity.value - first.rule.offset) / first.rule.factor
            if first.rule.factor
            else 0.0
        )
    else:
        reference = 0.0 if shifted is not None else 1.0
    for target in targets:
        wanted = dimension if target.rule.kind != "multiply" else target.quantity.dimension
        if target.quantity.dimension != wanted:
            findings.add(
                target.place,
                f"{show_key(target.rule.key)} is a {target.quantity.dimension.name} and the parameter a {wanted.name}; "
                "put it under multiplies, which takes any number along in proportion",
            )
        if target.rule.factor == 0.0:
            findings.add(target.place, "a factor of zero moves nothing; write another")
    if any(target.rule.kind == "multiply" for target in targets) and reference == 0.0:
        findings.add(
            (*key, "multiplies"),
            "the parameter's value in the scene is zero, so nothing can be in proportion to it",
        )
    values = _read_values(key, table, dimension, reference, findings)
    if values is None or len(findings.problems) > before:
        return None
    return Parameter(
        name=name,
        rules=tuple(target.rule for target in targets),
        reference=reference,
        logarithmic=table.scale == "log",
        dimension=dimension,
        unit="" if example is None else example.unit,
        lower=values.lower,
        upper=values.upper,
        start=values.start,
        prior=values.prior,
        prior_sigma=values.prior_sigma,
    )


class _Values(NamedTuple):
    """Bounds, start and prior of a parameter, SI; see :class:`Parameter`."""

    lower: float
    upper: float
    start: float
    prior: float | None
    prior_sigma: float | None


def _read_values(
    key: KeyPath, table: ParameterTable, dimension: Dimension, reference: float, findings: Findings
) -> _Values | None:
    """Bounds, start and prior, or None where one of them has another dimension."""
    given = {
        ("bounds", 0): table.bounds[0],
        ("bounds", 1): table.bounds[1],
        ("start",): table.start,
        ("prior",): table.prior,
    }
    wrong = [
        (place, item)
        for place, item in given.items()
        if item is not None and item.dimension != dimension
    ]
    for place, item in wrong:
        example = "a plain number such as 1.2" if dimension == NUMBER else f'"{dimension.example}"'
        findings.add(
            (*key, *place),
            f"is a {item.dimension.name} but what it moves is a {dimension.name}; write {example}",
        )
    if wrong:
        return None
    lower, upper = (bound.value for bound in table.bounds)
    if lower >= upper:
        findings.add(
            (*key, "bounds"),
            f"the lower bound {lower:g} is not below the upper one {upper:g} (SI); swap or widen them",
        )
        return None
    if table.scale == "log" and lower <= 0.0:
        text = f'the lower bound is {lower:g} but a logarithm needs more than zero; raise it, or write scale = "linear"'
        findings.add((*key, "bounds"), text)
        return None
    start = reference if table.start is None else table.start.value
    inside = (
        {"start": start} if table.prior is None else {"start": start, "prior": table.prior.value}
    )
    for what, value in inside.items():
        if not lower <= value <= upper:
            unit = dimension.unit
            written = what if what == "prior" or table.start is not None else "bounds"
            owner = "the scene's value" if written == "bounds" else f"{what} ="
            remedy = (
                "; widen them, or write a start inside"
                if written == "bounds"
                else "; move it, or widen them"
            )
            findings.add(
                (*key, written),
                f"{owner} {value:g} {unit} lies outside the bounds {lower:g} to {upper:g} {unit}{remedy}",
            )
    sigma = _read_sigma(key, table, dimension, findings)
    prior = None if sigma is None else reference if table.prior is None else table.prior.value
    return _Values(lower, upper, start, prior, sigma)


def _read_sigma(
    key: KeyPath, table: ParameterTable, dimension: Dimension, findings: Findings
) -> float | None:
    if table.prior_sigma is None:
        if table.prior is not None:
            example = "0.3 (of the logarithm)" if table.scale == "log" else f'"{dimension.example}"'
            findings.add(
                (*key, "prior_sigma"),
                f"'prior_sigma' is missing: how far from the prior may it be? write {example}",
            )
        return None
    wanted = NUMBER if table.scale == "log" else dimension
    if table.prior_sigma.dimension != wanted or not (
        np.isfinite(table.prior_sigma.value) and table.prior_sigma.value > 0.0
    ):
        example = (
            "a plain number above zero such as 0.3 (of the logarithm)"
            if table.scale == "log"
            else f'"{dimension.example}"'
        )
        findings.add((*key, "prior_sigma"), f"is not a spread for this parameter; write {example}")
        return None
    return table.prior_sigma.value
