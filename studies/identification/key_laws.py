"""How numbers of a scene follow the parameters of a fit: as a rule says, or as the scene calculates
them from its own ``[parameters]``.
"""

import itertools
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from headstock.scene.expansion.expansion import expand_scene, replaced
from headstock.scene.expansion.parameters import PARAMETERS
from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.reading.findings import Findings, KeyPath, show_key
from headstock.scene.reading.keys import NUMBER, find_keys, read_number
from headstock.scene.reading.units import Dimension
from headstock.scene.scene import Scene
from headstock.solvers.errors import ModelError
from headstock.studies.identification.targets import KeyRule, Parameter

REMEMBERED = 64  # calculated scenes, or builds of one entry, that are kept
STEP = 2.0**-10  # of a derivative of what is calculated, relative to the parameter
# where between its bounds a parameter is put to see what follows it: nowhere special
SOMEWHERE = 0.381966
# what neither modes nor compliances and responses depend on
UNSEEN_SECTIONS = (
    *("name", "analyses", "sweeps", "studies", "variants", "compare", "effects", "limits"),
    "exports",
    *("accuracy", "drives", "probes", "loads"),
)
UNSEEN_KEYS = {
    "axes": ("limits",),
}


class ParameterValueError(ModelError):
    """A value of a parameter with which the scene cannot be built."""


def remember[K, V](known: OrderedDict[K, V], key: K, make: Callable[[], V]) -> V:
    """Return what is known under a key, or make it; what was asked for latest is kept."""
    if key not in known:
        known[key] = make()
        if len(known) > REMEMBERED:
            known.popitem(last=False)
    known.move_to_end(key)
    return known[key]


@dataclass(frozen=True)
class KeyLaw:
    """How one number of a scene follows the parameters.

    Attributes:
        written: Its value in the scene, SI.
        rules: Parameter and rule, in the order of the file.
        calculated: What it is calculated with, where the scene calculates it from numbers that
            follow parameters.
    """

    key: KeyPath
    written: float
    dimension: Dimension
    rules: tuple[tuple[Parameter, KeyRule], ...]
    calculated: "_CalculatedNumbers | None" = None

    def content(self) -> tuple[object, ...]:
        """Return what the law does, wherever the key stands; to be compared only."""
        rules = [
            (parameter.name, rule.kind, rule.factor, rule.offset) for parameter, rule in self.rules
        ]
        somewhere = None if self.calculated is None else self.calculated.somewhere[self.key]
        return self.written, tuple(rules), somewhere

    def depends_on(self, parameter: str) -> bool:
        """Tell whether the number depends on a parameter."""
        return any(other.name == parameter for other, _ in self.rules) or (
            self.calculated is not None and self.key in self.calculated.followers.get(parameter, ())
        )

    def value(self, values: Mapping[str, float]) -> float:
        """The number for given parameter values, SI: what sets it, times what multiplies it, plus
        what shifts it.

        Raises:
            ParameterValueError: It cannot be calculated with them.
        """
        return self._evaluate(values, "")[0]

    def slope(self, values: Mapping[str, float], name: str) -> float:
        """Its derivative by one parameter."""
        return self._evaluate(values, name)[1]

    def _evaluate(self, values: Mapping[str, float], name: str) -> tuple[float, float]:
        """Return the number and its derivative by a parameter; zero by none."""
        base, base_slope = self._base(values), self._base_slope(values, name)
        product, product_slope, shift, shift_slope = 1.0, 0.0, 0.0, 0.0
        for parameter, rule in self.rules:
            p, factor, mine = values[parameter.name], rule.factor, parameter.name == name
            if rule.kind == "set":
                base, base_slope = factor * p + rule.offset, factor if mine else 0.0
            elif rule.kind == "multiply":
                product *= (p / parameter.reference) ** factor
                product_slope += factor / p if mine else 0.0
            else:
                shift += factor * (p - parameter.reference)
                shift_slope += factor if mine else 0.0
        slope = product * (base_slope + base * product_slope) + shift_slope
        return base * product + shift, slope

    def _base(self, values: Mapping[str, float]) -> float:
        return (
            self.written if self.calculated is None else self.calculated.numbers(values)[self.key]
        )

    def _base_slope(self, values: Mapping[str, float], name: str) -> float:
        """Of what the scene calculates, to fourth order: an expression is smooth."""
        if self.calculated is None or self.key not in self.calculated.followers.get(name, ()):
            return 0.0
        p = values[name]
        step = STEP * (abs(p) or 1.0)
        ahead, behind, far_ahead, far_behind = (
            self._base({**values, name: p + side * step}) for side in (1.0, -1.0, 2.0, -2.0)
        )
        return (8.0 * (ahead - behind) - (far_ahead - far_behind)) / (12.0 * step)


@dataclass(frozen=True, eq=False)
class _CalculatedNumbers:
    """What a scene calculates from numbers of its ``[parameters]`` that are fitted.

    Attributes:
        written: What describes the machine in the scene, as it is written.
        laws: Of the fitted numbers among its parameters.
        followers: Keys of the scene in full that depend on each parameter of the fit, in its order.
        somewhere: What they hold with every parameter between its bounds.
    """

    written: TomlTable
    laws: tuple[KeyLaw, ...]
    followers: dict[str, tuple[KeyPath, ...]] = field(default_factory=dict)
    somewhere: dict[KeyPath, float] = field(default_factory=dict)
    _known: OrderedDict[tuple[float, ...], dict[KeyPath, float]] = field(
        default_factory=OrderedDict
    )

    def numbers(self, values: Mapping[str, float]) -> dict[KeyPath, float]:
        """Numbers of the scene in full that depend on a parameter, SI.

        Raises:
            ParameterValueError: The scene cannot be calculated with these values.
        """
        given = tuple(law.value(values) for law in self.laws)

        def calculate() -> dict[KeyPath, float]:
            keys = dict.fromkeys(itertools.chain.from_iterable(self.followers.values()))
            raw = self._expand(given)
            return {key: read_number(raw, key).value for key in keys}

        return remember(self._known, given, calculate)

    def leaves(self, values: Mapping[str, float]) -> dict[KeyPath, TomlValue]:
        """All values of the scene in full."""
        return dict(_leaves(self._expand(tuple(law.value(values) for law in self.laws))))

    def _expand(self, given: Sequence[float]) -> TomlTable:
        section = self.written[PARAMETERS]
        for law, number in zip(self.laws, given, strict=True):
            text = number if law.dimension == NUMBER else f"{number!r} {law.dimension.unit}"
            section = replaced(section, law.key[1:], text)
        findings = Findings("")
        raw = expand_scene({**self.written, PARAMETERS: section}, findings)
        if findings.problems:
            problem = findings.problems[0][1]
            raise ParameterValueError(f"{problem.key} {problem.message}")
        return raw


def find_laws(scene: Scene, parameters: Sequence[Parameter]) -> tuple[KeyLaw, ...]:
    """Laws of the numbers of a scene that follow parameters of a fit: those that their rules name
    and those that the scene calculates from them.

    Args:
        scene: A variant; keys that it does not hold as numbers are left out.

    Raises:
        ParameterValueError: The scene cannot be calculated with values between the bounds.
    """
    rules: dict[KeyPath, list[tuple[Parameter, KeyRule]]] = {}
    for parameter in parameters:
        for rule in parameter.rules:
            if holds_number(scene.raw, rule.key):
                rules.setdefault(rule.key, []).append((parameter, rule))
    laws = {key: _make_law(scene.raw, key, tuple(pairs)) for key, pairs in rules.items()}
    named = tuple(law for key, law in laws.items() if key[0] == PARAMETERS)
    if not named:
        return tuple(laws.values())
    calculated = _CalculatedNumbers(
        {key: value for key, value in scene.written.items() if key not in UNSEEN_SECTIONS}, named
    )
    _find_followers(calculated, parameters, scene)
    for key in calculated.somewhere:
        laws[key] = _make_law(scene.raw, key, tuple(rules.get(key, ())), calculated)
    return tuple(laws.values())


def _find_followers(
    calculated: _CalculatedNumbers, parameters: Sequence[Parameter], scene: Scene
) -> None:
    references = {parameter.name: parameter.reference for parameter in parameters}
    between = {p.name: p.lower + SOMEWHERE * (p.upper - p.lower) for p in parameters}
    before = calculated.leaves(references)
    for name, value in between.items():
        if any(law.depends_on(name) for law in calculated.laws):
            after = calculated.leaves({**references, name: value})
            if changed := sorted(map(show_key, before.keys() ^ after.keys())):
                raise ParameterValueError(f"{changed[0]} is there with some values of {name} only")
            calculated.followers[name] = tuple(
                key for key in before if before[key] != after[key] and _is_seen(key, scene)
            )
    calculated.somewhere.update(calculated.numbers(between))


def _is_seen(key: KeyPath, scene: Scene) -> bool:
    """Whether undamped modes or compliances depend on a key."""
    section = str(key[0])
    if section == "components" and key[2] == "mesh":
        return scene.machine.components[str(key[1])].fidelity == "elastic"
    return section != PARAMETERS and not (len(key) > 2 and key[2] in UNSEEN_KEYS.get(section, ()))


def _make_law(
    raw: TomlTable,
    key: KeyPath,
    rules: tuple[tuple[Parameter, KeyRule], ...],
    calculated: _CalculatedNumbers | None = None,
) -> KeyLaw:
    quantity = read_number(raw, key)
    return KeyLaw(key, quantity.value, quantity.dimension, rules, calculated)


def holds_number(raw: TomlTable, key: KeyPath) -> bool:
    """Tell whether a parsed scene holds a number at a key."""
    if not find_keys(raw, key):
        return False
    try:
        read_number(raw, key)
    except ValueError:
        return False
    return True


def _leaves(value: TomlValue, key: KeyPath = ()) -> Iterator[tuple[KeyPath, TomlValue]]:
    if isinstance(value, dict):
        for name, item in value.items():
            yield from _leaves(item, (*key, name))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _leaves(item, (*key, index))
    else:
        yield key, value
