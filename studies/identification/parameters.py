"""From the table of a parameter to scene keys, bounds and a prior in SI units, checked against
every variant.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.parts.solids import SuperelementFile
from headstock.scene.expansion.parameters import PARAMETERS
from headstock.scene.reading.findings import Findings, KeyPath, show_key
from headstock.scene.reading.keys import (
    NUMBER,
    find_keys,
    read_number,
    split_key,
    value_at,
    write_number,
    written_unit,
)
from headstock.scene.reading.units import Dimension, Quantity
from headstock.scene.scene import Scene
from headstock.studies.identification.key_laws import ParameterValueError, find_laws, holds_number
from headstock.studies.identification.targets import (
    KeyRule,
    Parameter,
    ParameterTable,
    PowerRuleTable,
    SetRuleTable,
    ShiftRuleTable,
    TargetsTable,
)

SAME_VALUE = 1e-9
Scenes = Sequence[Scene]
Rule = SetRuleTable | PowerRuleTable | ShiftRuleTable
_TABLES = {"set": "keys", "multiply": "multiplies", "shift": "shifts"}
_FREE_OF_MESH = ("at", "rotate", "mass", "rayleigh")
_PLACES: dict[str, tuple[str, ...]] = {
    "components": ("solid", "mass", "at", "rotate", "interfaces", "rayleigh", "segments"),
    "joints": ("stiffness", "stiffness_per_area", "damping", "loss_factor", "at"),
    "materials": ("E", "nu", "rho", "loss_factor"),
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
        scenes: The scene of each machine and variant that the targets use.
        findings: Takes the faults, with their place in the file.
    """
    parameters = []
    setters: dict[KeyPath, str] = {}
    for name, entry in table.parameters.items():
        key: KeyPath = ("parameters", name)
        targets = [
            target
            for kind, rules in _TABLES.items()
            for index, rule in enumerate(getattr(entry, rules))
            for target in _find_targets(key, kind, index, rule, scenes, findings)
        ]
        for target in targets:
            if target.rule.kind == "set" and setters.setdefault(target.rule.key, name) != name:
                text = f"{show_key(target.rule.key)} is set by the parameter {setters[target.rule.key]!r} already; keep one"
                findings.add(target.place, text)
        parameter = _read_parameter(name, entry, targets, findings) if targets else None
        if parameter is not None:
            parameters.append(parameter)
            _check_followers(parameter, targets, scenes, findings)
    return tuple(parameters)


def _check_followers(
    parameter: Parameter, targets: Sequence[_Target], scenes: Scenes, findings: Findings
) -> None:
    """Report numbers that a scene calculates from a fitted one of its own parameters and that
    cannot be fitted, and a fitted one that nothing is calculated from.
    """
    named = [target for target in targets if target.rule.key[0] == PARAMETERS]
    if not named:
        return
    first, count = named[0], 0
    for scene in scenes:
        try:
            laws = [law for law in find_laws(scene, (parameter,)) if law.calculated is not None]
        except ParameterValueError as error:
            findings.add(first.place, str(error))
            return
        count += len(laws)
        faults = [_find_fault(law.key, scene) for law in laws if law.key[2] != "mesh"]
        for fault in [fault for fault in faults if fault][:1]:
            name = show_key(first.rule.key)
            findings.add(
                first.place, f"a value is calculated from {name} that no fit takes: {fault}"
            )
            return
    if not count:
        name = show_key(first.rule.key[1:])
        findings.add(
            first.place,
            f"no dimension, mass, place, material or stiffness of the scene is calculated from {name!r}; "
            f'write one as "= {name}", or fit a key',
        )


def _find_targets(
    base: KeyPath, kind: str, index: int, rule: Rule, scenes: Scenes, findings: Findings
) -> list[_Target]:
    """Return every key a rule means, in any of the variants."""
    rule_key: KeyPath = (*base, _TABLES[kind], index)
    try:
        pattern = split_key(rule.key)
    except ValueError as error:
        findings.add(rule_key, str(error))
        return []
    targets: dict[KeyPath, _Target] = {}
    holder: dict[KeyPath, Scene] = {}  # that each was read from
    faults: list[str] = []
    for scene in scenes:
        for key in find_keys(scene.raw, pattern):
            faults.append(_find_fault(key, scene))
            if not holds_number(scene.raw, key):
                continue
            target = _make_target(key, kind, rule, scene, rule_key)
            first = targets.setdefault(key, target)
            if first is target:
                holder[key] = scene
                faults.append(_find_offset_fault(rule, target.quantity))
            elif kind == "set" and scene.path == holder[key].path:
                faults.append(_find_own_value(first, target, scene, holder[key]))
    if not targets and not any(faults):
        faults.append(_explain_missing(pattern, rule.key, scenes))
    for fault in filter(None, faults):
        findings.add(rule_key, fault)
        return []
    return list(targets.values())


def _make_target(key: KeyPath, kind: str, rule: Rule, scene: Scene, place: KeyPath) -> _Target:
    factor = rule.power if isinstance(rule, PowerRuleTable) else rule.factor
    offset = rule.offset.value if isinstance(rule, SetRuleTable) and rule.offset else 0.0
    quantity, unit = read_number(scene.raw, key), written_unit(scene.raw, key, scene.written)
    return _Target(KeyRule(key, kind, factor, offset), quantity, unit, place)


def _find_own_value(first: _Target, target: _Target, scene: Scene, other: Scene) -> str:
    """Return that two variants hold different numbers, which a parameter would set to one; empty where
    they are equal.
    """
    if math.isclose(first.quantity.value, target.quantity.value, rel_tol=SAME_VALUE):
        return ""
    key = show_key(target.rule.key)
    numbers = " and ".join(
        f"{write_number(one.quantity.value, one.unit, 6)} {_name_variant(holder)}"
        for one, holder in ((first, other), (target, scene))
    )
    return (
        f"{key} is {numbers}, and keys would set both to one value; "
        f'write multiplies = ["{key}"], which keeps their proportion, or fit a key that they share'
    )


def _name_variant(scene: Scene) -> str:
    return f"in variant {scene.variant}" if scene.variant else "in the scene as written"


def _find_offset_fault(rule: Rule, quantity: Quantity) -> str:
    """Return that the offset of a rule has another dimension than its key; empty where it has not."""
    if not isinstance(rule, SetRuleTable) or rule.offset is None:
        return ""
    offset, wanted = rule.offset.dimension, quantity.dimension
    return (
        "" if offset == wanted else f"offset is a {offset.name} and the key holds a {wanted.name}"
    )


def _explain_missing(pattern: KeyPath, text: str, scenes: Scenes) -> str:
    for scene in scenes:
        for key in find_keys(scene.raw, pattern):
            try:
                read_number(scene.raw, key)
            except ValueError as error:
                return str(error)
    raw = scenes[0].raw
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
    if key[2:] == ("segments", "count"):
        return "the number of segments cannot be fitted; what can: segments.bending and torsion, factors on E I and G J"
    if len(key) < 3 or section not in _PLACES or key[2] not in _PLACES[section]:
        places = "; ".join(
            [
                "parameters.NAME",
                *(f"{name}.NAME.{'|'.join(keys)}" for name, keys in _PLACES.items()),
            ]
        )
        return f"{show_key(key)} cannot be fitted; what can: {places}"
    if section == "components" and key[2] not in _FREE_OF_MESH:
        component = scene.machine.components[str(key[1])]
        if isinstance(component.solid, SuperelementFile):
            return f"{key[1]} is an imported superelement {_name_variant(scene)}; fit its place, mass or joints"
    return ""


type _Fault = tuple[KeyPath, str]  # with its place below the parameter


def _read_parameter(
    name: str, table: ParameterTable, targets: list[_Target], findings: Findings
) -> Parameter | None:
    example, reference = _find_reference(targets)
    dimension = NUMBER if example is None else example.quantity.dimension
    key: KeyPath = ("parameters", name)
    faults = [*_find_rule_faults(key, targets, dimension, reference)]
    wrong = [*_find_bound_faults(table, dimension)] or [
        *_find_start_faults(table, dimension, reference),
        *_find_prior_faults(table, dimension),
    ]
    faults += [((*key, *where), fault) for where, fault in wrong]
    for where, fault in faults:
        findings.add(where, fault)
    if faults:
        return None
    lower, upper = (bound.value for bound in table.bounds)
    sigma = None if table.prior_sigma is None else table.prior_sigma.value
    expected = reference if table.prior is None else table.prior.value
    return Parameter(
        name=name,
        rules=tuple(target.rule for target in targets),
        lower=lower,
        upper=upper,
        start=reference if table.start is None else table.start.value,
        reference=reference,
        prior=None if sigma is None else expected,
        prior_sigma=sigma,
        logarithmic=table.scale == "log",
        dimension=dimension,
        unit="" if example is None else example.unit,
    )


def _find_reference(targets: Sequence[_Target]) -> tuple[_Target | None, float]:
    """Return a target that says in which unit a parameter is, and the parameter's value in the scene, SI;
    one of a parameter that only multiplies.
    """
    first, shifted = (
        next((target for target in targets if target.rule.kind == kind), None)
        for kind in ("set", "shift")
    )
    if first is not None and first.rule.factor:
        return first, (first.quantity.value - first.rule.offset) / first.rule.factor
    example = first or shifted
    return example, 1.0 if example is None else 0.0


def _find_rule_faults(
    key: KeyPath, targets: Sequence[_Target], dimension: Dimension, reference: float
) -> Iterator[_Fault]:
    """Yield rules that do not fit the parameter, with their places in the file."""
    for target in targets:
        held = target.quantity.dimension
        if target.rule.kind != "multiply" and held != dimension:
            yield (
                target.place,
                f"{show_key(target.rule.key)} is a {held.name} and the parameter a {dimension.name}; "
                "put it under multiplies, which takes any number along in proportion",
            )
        if target.rule.factor == 0.0:
            yield target.place, "a factor of zero moves nothing; write another"
    if any(target.rule.kind == "multiply" for target in targets) and reference == 0.0:
        yield (
            (*key, "multiplies"),
            "the parameter's value in the scene is zero, so nothing can be in proportion to it",
        )


def _find_bound_faults(table: ParameterTable, dimension: Dimension) -> Iterator[_Fault]:
    """Yield values of another dimension; where there are none, bounds that leave no room."""
    given: dict[KeyPath, Quantity | None] = {
        ("bounds", number): bound for number, bound in enumerate(table.bounds)
    }
    given |= {("start",): table.start, ("prior",): table.prior}
    wrong = {
        where: value
        for where, value in given.items()
        if value is not None and value.dimension != dimension
    }
    example = "a plain number such as 1.2" if dimension == NUMBER else f'"{dimension.example}"'
    for where, value in wrong.items():
        yield (
            where,
            f"is a {value.dimension.name} but what it moves is a {dimension.name}; write {example}",
        )
    lower, upper = (bound.value for bound in table.bounds)
    if not wrong and lower >= upper:
        yield (
            ("bounds",),
            f"the lower bound {lower:g} is not below the upper one {upper:g} (SI); swap or widen them",
        )
    elif not wrong and table.scale == "log" and lower <= 0.0:
        yield (
            ("bounds",),
            f'the lower bound is {lower:g} but a logarithm needs more than zero; raise it, or write scale = "linear"',
        )


def _find_start_faults(
    table: ParameterTable, dimension: Dimension, reference: float
) -> Iterator[_Fault]:
    """Yield a start and a prior that lie outside the bounds."""
    lower, upper = (bound.value for bound in table.bounds)
    outside = f"lies outside the bounds {lower:g} to {upper:g} {dimension.unit}"
    start = reference if table.start is None else table.start.value
    if not lower <= start <= upper:
        where, owner, remedy = (
            ("bounds", "the scene's value", "widen them, or write a start inside")
            if table.start is None
            else ("start", "start =", "move it, or widen them")
        )
        yield (where,), f"{owner} {start:g} {dimension.unit} {outside}; {remedy}"
    if table.prior is not None and not lower <= table.prior.value <= upper:
        shown = f"{table.prior.value:g} {dimension.unit}"
        yield ("prior",), f"prior = {shown} {outside}; move it, or widen them"


def _find_prior_faults(table: ParameterTable, dimension: Dimension) -> Iterator[_Fault]:
    """Yield what is wrong with the standard deviation of a prior."""
    relative = table.scale == "log"
    example = "0.3 (of the logarithm)" if relative else f'"{dimension.example}"'
    sigma = table.prior_sigma
    if sigma is None:
        if table.prior is not None:
            text = "'prior_sigma' is missing: how far from the prior may it be? write"
            yield ("prior_sigma",), f"{text} {example}"
    elif sigma.dimension != (NUMBER if relative else dimension) or not 0.0 < sigma.value < np.inf:
        plain = "a plain number above zero such as " * relative
        yield ("prior_sigma",), f"is not a spread for this parameter; write {plain}{example}"
