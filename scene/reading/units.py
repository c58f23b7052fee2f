"""Quantities with units, read at the border: text in, SI floats inside."""

import math
import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cache, lru_cache
from typing import Literal

# Prefixes, which end with a dash, and units: first spelling, meaning, other spellings; any of them takes
# a prefix, and the long ones an s. Hertz and radian are dimensions here; Decimal makes "38 mm" and
# "0.038 m" the same float.
_DEFINITIONS = """
micro- = 1e-6 = u- = μ-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
nano- = 1e-9 = n-
meter = [length] = m = metre
second = [time] = s = sec
gram = [mass] = g
radian = [angle] = rad
hertz = [frequency] = Hz
byte = [information] = B
tonne = 1e3 * kilogram = t = ton
inch = 25.4e-3 * meter = in
foot = 304.8e-3 * meter = ft
minute = 60 * second = min
hour = 3600 * second = h
newton = kilogram * meter / second^2 = N
pascal = newton / meter^2 = Pa
bar = 1e5 * pascal = bar
liter = 1e-3 * meter^3 = l = L
degree = 0.01745329251994329576923690768 * radian = deg = °
revolution = 6.283185307179586476925286767 * radian = rev
revolutions_per_minute = revolution / minute = rpm
standard_gravity = 9.80665 * meter / second^2 = g_n
percent = 0.01 = %
pound_force = 4.4482216152605 * newton = lbf
psi = 6894.757293168361 * pascal = psi
kibibyte = 1024 * byte = KiB
mebibyte = 1048576 * byte = MiB
gibibyte = 1073741824 * byte = GiB
"""

_NUMBER = re.compile(
    r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,5})?)(?![\d.eE,_jJ])\s*(.*?)\s*", re.DOTALL
)
_FACTOR = r"[A-Za-zμ°%_]+(?:(?:\^|\*\*)-?[1-9])?"
_UNIT = re.compile(rf"(?:1\s*/\s*)?{_FACTOR}(?:\s*[*/·]\s*{_FACTOR}|\s+{_FACTOR})*")
_TERM = re.compile(r"([*/]?)\s*(?:([\d.]+(?:e-?\d+)?)|([A-Za-zμ°_]+|%)(?:(?:\^|\*\*)(-?\d))?)")
_SUPERSCRIPTS = str.maketrans({"²": "^2", "³": "^3", "⁴": "^4", "·": "*", "⋅": "*"})
MAX_TEXT = 80
Sign = Literal["any", "not negative", "positive"]
LARGEST_WHOLE = 10**15
LARGEST_BARE = 10**30  # no unit is likely beyond


@dataclass(frozen=True)
class Dimension:
    """A kind of quantity: its name, SI unit, an example to show to whoever got it wrong, and the
    largest size that is believed.

    ``most`` is far beyond any machine [SI]: what is larger is a slip of units, and its squares and
    products would leave the range of floats.
    """

    name: str
    unit: str
    example: str
    most: float


LENGTH = Dimension("length", "m", "250 mm", 1e5)
ANGLE = Dimension("angle", "rad", "30 deg", 1e6)
MASS = Dimension("mass", "kg", "35 kg", 1e12)
TIME = Dimension("time", "s", "0.1 s", 1e12)
FREQUENCY = Dimension("frequency", "Hz", "500 Hz", 1e10)
PRESSURE = Dimension("pressure", "Pa", "210 GPa", 1e20)
DENSITY = Dimension("density", "kg/m^3", "7850 kg/m^3", 1e12)
FORCE = Dimension("force", "N", "1 kN", 1e18)
MOMENT = Dimension("moment", "N m", "10 N m", 1e20)
STIFFNESS = Dimension("stiffness", "N/m", "380 N/um", 1e24)
ROTATIONAL_STIFFNESS = Dimension("rotational stiffness", "N m/rad", "1e6 N m/rad", 1e24)
STIFFNESS_PER_AREA = Dimension("stiffness per area", "N/m^3", "3 N/um/mm^2", 1e24)
DAMPING = Dimension("damping", "N s/m", "20 N s/m", 1e24)
ROTATIONAL_DAMPING = Dimension("rotational damping", "N m s/rad", "5 N m s/rad", 1e24)
ACCELERATION = Dimension("acceleration", "m/s^2", "9.81 m/s^2", 1e9)
SPEED = Dimension("speed", "m/s", "3000 mm/min", 1e6)
ANGULAR_SPEED = Dimension("angular speed", "rad/s", "3000 rpm", 1e9)
COMPLIANCE = Dimension("compliance", "m/N", "151 um/kN", 1e9)
INERTIA = Dimension("moment of inertia", "kg m^2", "2e-3 kg m^2", 1e15)
RATE = Dimension("rate", "1/s", "50 1/s", 1e12)
IMPULSE = Dimension("impulse", "N s", "2 N s", 1e18)
ANGULAR_IMPULSE = Dimension("angular impulse", "N m s", "0.1 N m s", 1e20)
MEMORY = Dimension("amount of memory", "B", "4 GB", 1e18)
RATIO = Dimension("ratio", "", "2 %", 1e12)
# pressure and stiffness by other names
SPECIFIC_FORCE = Dimension("force per area", "N/m^2", "1500 N/mm^2", 1e13)
EDGE_FORCE = Dimension("force per length", "N/m", "20 N/mm", 1e9)
DIMENSIONS = (
    LENGTH, ANGLE, MASS, TIME, FREQUENCY, PRESSURE, DENSITY, FORCE, MOMENT, STIFFNESS, ROTATIONAL_STIFFNESS,
    STIFFNESS_PER_AREA, DAMPING, ROTATIONAL_DAMPING, ACCELERATION, SPEED, ANGULAR_SPEED, COMPLIANCE, INERTIA, RATE, MEMORY, RATIO,
    IMPULSE, ANGULAR_IMPULSE,
)  # fmt: skip


class UnitError(ValueError):
    """A text that is not a quantity of the wanted kind; the message says what to write."""


@dataclass(frozen=True)
class Quantity:
    """A value in SI units together with what it measures."""

    value: float
    dimension: Dimension


@dataclass(frozen=True)
class Unit:
    """A unit of a dimension: times ``factor`` a number is in SI units."""

    factor: Decimal
    dimension: Dimension


# what units are made of: symbol of the unit in which a quantity is held, and the size of the one that is
# defined
_BASES = {
    "[length]": ("m", Decimal(1)),
    "[mass]": ("kg", Decimal("1e-3")),
    "[time]": ("s", Decimal(1)),
    "[angle]": ("rad", Decimal(1)),
    "[frequency]": ("Hz", Decimal(1)),
    "[information]": ("B", Decimal(1)),
}


type Powers = tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class Measure:
    """A value with what it measures, whatever that is: what expressions calculate with.

    Attributes:
        powers: Symbol and exponent of each base unit, sorted; none for a plain number.
    """

    value: Decimal
    powers: Powers = ()

    @property
    def unit(self) -> str:
        """As a scene writes it; empty for a plain number."""
        return "*".join(
            symbol if power == 1 else f"{symbol}^{power}" for symbol, power in self.powers
        )

    def times(self, other: "Measure", power: int = 1) -> "Measure":
        """Return the product with a power of another one."""
        return Measure(self.value * other.value**power, self._join(other, power))

    def over(self, other: "Measure") -> "Measure":
        """Return the quotient; raises ``decimal.DivisionByZero``."""
        return Measure(self.value / other.value, self._join(other, -1))

    def _join(self, other: "Measure", times: int) -> Powers:
        powers = dict(self.powers)
        for symbol, power in other.powers:
            powers[symbol] = powers.get(symbol, 0) + times * power
        return tuple(sorted((symbol, power) for symbol, power in powers.items() if power))

    def written(self) -> str | int | float:
        """As a scene writes it: text with a unit, or a plain number."""
        if self.powers:
            return f"{+self.value} {self.unit}"
        whole = abs(self.value) < LARGEST_WHOLE and self.value == self.value.to_integral_value()
        return int(self.value) if whole else float(self.value)


def parse_quantity(text: object, *dimensions: Dimension) -> Quantity:
    """Read a quantity such as ``"380 N/um"`` that measures one of the given dimensions.

    Args:
        text: What the scene holds; anything but text with a number and a unit is refused.
        dimensions: Dimensions that are accepted, at least one.

    Returns:
        The value in SI units and the dimension it was found to have.

    Raises:
        UnitError: Not a number with a unit, not finite, an unknown unit, or another dimension.
    """
    wanted = " or ".join(_with_article(dimension) for dimension in dimensions)
    example = " or ".join(f'"{dimension.example}"' for dimension in dimensions)
    if isinstance(text, bool) or not isinstance(text, str | int | float):
        raise UnitError(
            f"{quote_value(text)} is not {wanted}; write a number with a unit in quotes, such as {example}"
        )
    if not isinstance(text, str):
        if isinstance(text, float) and not math.isfinite(text):
            raise UnitError(f"{text} is not finite; write {wanted} such as {example}")
        shown = quote_value(text)
        raise UnitError(
            f'{shown} has no unit; write it in quotes with a unit, such as "{shown} {_likely_unit(text, dimensions[0])}"'
        )
    number, unit = _split_quantity(text, wanted, example)
    measured = _resolve_unit(unit, example)
    for dimension in dimensions:
        if measured.powers == _resolve_unit(dimension.unit, example).powers:
            value = _scale_number(number, measured.value, text, wanted)
            if abs(value) > dimension.most:
                raise UnitError(
                    f"{quote_value(text)} is {value:.3g} {dimension.unit}, more than any machine has ({dimension.most:g}); check its unit, "
                    f"or write {wanted} such as {example}"
                )
            return Quantity(value, dimension)
    raise UnitError(
        f"{quote_value(text)} is {_describe(unit, measured)}, not {wanted}; write for example {example}"
    )


def read_measure(number: str, unit: str) -> Measure:
    """Return a number with any known unit, such as ``38`` and ``mm``.

    Raises:
        UnitError: An unknown unit.
    """
    clean = unicodedata.normalize("NFKC", unit.translate(_SUPERSCRIPTS))
    return Measure(Decimal(number)).times(_resolve_unit(clean, "38 mm"))


def read_unit(text: str, *dimensions: Dimension) -> Unit:
    """Read a unit without a number, such as ``mm``, that measures one of the given dimensions.

    Raises:
        UnitError: An unknown unit, or another dimension.
    """
    wanted = " or ".join(_with_article(dimension) for dimension in dimensions)
    example = " or ".join(unit_of(dimension.example) for dimension in dimensions)
    if not text or len(text) > MAX_TEXT:
        raise UnitError(f"{quote_value(text)} is no unit of {wanted}; write for example {example}")
    unit = unicodedata.normalize("NFKC", text.translate(_SUPERSCRIPTS))
    measured = _resolve_unit(unit, example)
    for dimension in dimensions:
        if measured.powers == _resolve_unit(dimension.unit, example).powers:
            return Unit(measured.value, dimension)
    raise UnitError(
        f"{quote_value(text)} measures {_describe(unit, measured)}, not {wanted}; write for example {example}"
    )


def unit_of(text: str) -> str:
    """The unit in the text of a quantity; empty where there is none."""
    match = _NUMBER.fullmatch(unicodedata.normalize("NFKC", text.translate(_SUPERSCRIPTS)))
    return "" if match is None else match[2]


@lru_cache(maxsize=256)
def quantity_pattern(*dimensions: Dimension, sign: Sign = "any") -> str:
    """Regular expression of texts that may be a quantity of some dimensions, for the JSON schema:
    what a pattern can know.

    A single unit must measure one of the dimensions; of products and powers of units only the words
    are checked.
    """
    prefixes, meanings = _read_definitions()
    wanted = {_resolve_unit(dimension.unit, "").powers for dimension in dimensions}
    fits = [name for name in meanings if _resolve_unit(name, "").powers in wanted]
    any_unit, fitting = (
        # the two signs for micro are the same letter
        f"(?:{_one_of(['µ', *prefixes])})?(?:{_one_of(names)})"
        for names in ([*meanings], fits)
    )
    power = r"(?:(?:\^|\*\*)-?[1-9]|[²³⁴])"
    factor = f"{any_unit}{power}?"
    more = rf"(?:(?:\s*[*/·⋅]\s*|\s+){factor})"
    single = f"{fitting}|" if fits else ""
    unit = rf"(?:{single}1\s*/\s*{factor}{more}*|{factor}{more}+|{any_unit}{power})"
    needed = "?" if () in wanted else ""
    number = (
        r"[0-9]+\.?[0-9]*|\.[0-9]+"
        if sign != "positive"
        else r"[0-9]*[1-9][0-9]*\.?[0-9]*|[0-9]*\.[0-9]*[1-9][0-9]*"
    )
    return rf"^\s*{'[+-]?' if sign == 'any' else '[+]?'}(?:{number})(?:[eE][+-]?[0-9]{{1,5}})?(?:\s*{unit}){needed}\s*$"


@cache
def _read_definitions() -> tuple[dict[str, Decimal], dict[str, str]]:
    """Return the factor of each prefix and the meaning of each unit, by every spelling."""
    prefixes: dict[str, Decimal] = {}
    meanings: dict[str, str] = {}
    for meaning, *spellings in _split_definitions():
        for spelling in spellings:
            if spelling.endswith("-"):
                prefixes[spelling.rstrip("-")] = Decimal(meaning)
            else:
                meanings[spelling] = meaning
    return prefixes, meanings


def _split_definitions() -> Iterator[list[str]]:
    """Yield the meaning of each prefix and unit, with its spellings, the longest last."""
    for line in _DEFINITIONS.strip().splitlines():
        name, meaning, *others = (part.strip() for part in line.split("="))
        yield [meaning, *dict.fromkeys([*others, name])]


def list_spellings() -> tuple[list[list[str]], list[list[str]]]:
    """Return the spellings of each prefix and of each unit that quantities may have."""
    prefixes, names = list[list[str]](), list[list[str]]()
    for _, *spellings in _split_definitions():
        (prefixes if spellings[-1].endswith("-") else names).append(
            [text.rstrip("-") for text in spellings]
        )
    return prefixes, names


def measure_unit(unit: str) -> tuple[Decimal, str]:
    """Return the size of a unit in SI units, and what it measures."""
    measured = _resolve_unit(unit, "")
    return measured.value, _describe(unit, measured)


def _one_of(words: Sequence[str]) -> str:
    """Alternatives of a regular expression, the longest first."""
    return "|".join(
        sorted(map(re.escape, dict.fromkeys(words)), key=lambda text: (-len(text), text))
    )


def _split_quantity(text: str, wanted: str, example: str) -> tuple[str, str]:
    if len(text) > MAX_TEXT:
        raise UnitError(
            f"{quote_value(text)} is too long for a quantity; write {wanted} such as {example}"
        )
    clean = unicodedata.normalize("NFKC", text.translate(_SUPERSCRIPTS))
    match = _NUMBER.fullmatch(clean)
    if match is None:
        raise UnitError(
            f"{quote_value(text)} is not one real number with a unit; write {wanted} such as {example}"
        )
    return match[1], match[2]


def _scale_number(number: str, factor: Decimal, text: str, wanted: str) -> float:
    if not math.isfinite(float(number)):
        raise UnitError(
            f"{quote_value(text)} is outside the range of floating-point numbers; write {wanted} of ordinary size"
        )
    value = float(Decimal(number) * factor)
    if not math.isfinite(value) or (value == 0.0 and Decimal(number) != 0):
        raise UnitError(
            f"{quote_value(text)} is outside the range of floating-point numbers; write {wanted} of ordinary size"
        )
    return value


def _likely_unit(number: float, dimension: Dimension) -> str:
    """The unit of the dimension's example or the SI unit: the one with which a bare number comes
    nearer to the example.
    """
    example = parse_quantity(dimension.example, dimension).value
    if not number or abs(number) > LARGEST_BARE:
        return unit_of(dimension.example)

    def distance(unit: str) -> float:
        return abs(math.log(abs(number) * float(_resolve_unit(unit, "").value) / example))

    return min((unit_of(dimension.example), dimension.unit), key=distance)


@lru_cache(maxsize=1024)
def _resolve_unit(unit: str, example: str) -> Measure:
    """Return one of a unit."""
    if not unit:
        return Measure(Decimal(1))
    if _UNIT.fullmatch(unit) is None:
        raise UnitError(
            f"{unit!r} is not a unit; write units like N/um, kg/m^3 or N s/m, for example {example}"
        )
    try:
        return _multiply_terms(unit)
    except KeyError as error:
        raise UnitError(f"unknown unit {unit!r}; write for example {example}") from error


def _multiply_terms(text: str) -> Measure:
    """Return a product such as ``60 * second`` or ``kN m/rad``; raises KeyError for an unknown unit."""
    product = Measure(Decimal(1))
    for sign, number, name, power in _TERM.findall(text):
        term = Measure(Decimal(number)) if number else _find_unit(name)
        product = product.times(term, int(power or 1) * (-1 if sign == "/" else 1))
    return product


@cache
def _find_unit(name: str) -> Measure:
    """Return one of a unit without a power; raises KeyError where it is unknown."""
    prefixes, meanings = _read_definitions()
    for plural in ("", "s"):
        for prefix, factor in {"": Decimal(1), **prefixes}.items():
            stem = name.removeprefix(prefix).removesuffix(plural)
            if f"{prefix}{stem}{plural}" != name or (plural and len(stem) == 1):
                continue
            if meaning := meanings.get(stem):
                symbol, size = _BASES.get(meaning, ("", Decimal(1)))
                one = Measure(size, ((symbol, 1),)) if symbol else _multiply_terms(meaning)
                return Measure(factor).times(one)
    raise KeyError(name)


def _describe(unit: str, measured: Measure) -> str:
    if not unit:
        return "a plain number"
    for dimension in DIMENSIONS:
        if _resolve_unit(dimension.unit, "").powers == measured.powers:
            return _with_article(dimension)
    return f"in {unit}"


def _with_article(dimension: Dimension) -> str:
    return f"{'an' if dimension.name[0] in 'aeiou' else 'a'} {dimension.name}"


def quote_value(value: object) -> str:
    """A value as the scene writes it, shortened: what error messages quote."""
    if isinstance(value, int) and abs(value) > 10**40:
        return "a number of more than 40 digits"  # longer ones cannot even be printed
    text = repr(value) if not isinstance(value, str) else f'"{value}"'
    return text if len(text) <= MAX_TEXT else f"{text[: MAX_TEXT - 3]}..."
