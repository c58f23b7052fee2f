"""Arithmetic with quantities: ``= 2 * wall + 3 mm``. A closed grammar of numbers, units, names,
``+ - * /`` and parentheses; nothing is ever run as code.
"""

import re
from collections.abc import Callable, Collection
from decimal import DefaultContext, DivisionByZero, InvalidOperation, Overflow, localcontext

from headstock.scene.reading.units import Measure, UnitError, read_measure

LONGEST = 200  # characters
LARGEST_POWER = 30  # of a base unit
DEEPEST = 20  # parentheses and signs in each other
MARK = "="
# a unit stands right behind its number; of its operators only / may be written without brackets,
# and without spaces around it, so that `2*t` and `10 N / t` are what they look like
_UNIT = (
    r"(?:[A-Za-zμµ°%](?:[A-Za-zμµ°_]*))(?:\^-?[1-9]|[²³⁴])?(?:/[A-Za-zμµ°]+(?:\^-?[1-9]|[²³⁴])?)*"
)
_TOKEN = re.compile(
    rf"""\s*(?:
    (?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{{1,3}})?(?![\w.]*\d))[ ]?(?P<unit>{_UNIT})?
    |\[(?P<quantity>[^\[\]]*)\]
    |(?P<name>[A-Za-z_]\w*)
    |(?P<sign>[-+*/()])
    )""",
    re.VERBOSE,
)
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(.*?)\s*")
_WORD = re.compile(r"[A-Za-z]+")
NAME = re.compile(r"[A-Za-z_]\w{0,63}", re.ASCII)


class ExpressionError(ValueError):
    """A text that cannot be calculated; the message says why and what to write."""


def is_expression(value: object) -> bool:
    """Return whether a value of a scene is to be calculated."""
    return isinstance(value, str) and value.lstrip().startswith(MARK)


def sole_name(text: str) -> str | None:
    """The name, where an expression is nothing but one."""
    inner = text.lstrip().removeprefix(MARK).strip()
    return inner if NAME.fullmatch(inner) else None


def calculate(text: str, look_up: Callable[[str], Measure], names: Collection[str]) -> Measure:
    """The value of an expression.

    Args:
        text: With its mark ``=``.
        look_up: The value of a name; raises ``ExpressionError`` where there is none.

    Raises:
        ExpressionError: It does not follow the grammar, adds different quantities, divides by zero,
            or leaves the range of numbers.
    """
    _refuse_long(text)
    # the same however the process has set up its decimals
    with localcontext(DefaultContext):
        try:
            parser = _Parser(text.lstrip().removeprefix(MARK), look_up, names)
            value = parser.read_sum(0)
            parser.expect_end()
        except (DivisionByZero, InvalidOperation) as error:
            raise ExpressionError("divides by zero; check the values in it") from error
        except Overflow as error:
            raise ExpressionError("leaves the range of numbers; check its units") from error
        return value


def names_in(text: str) -> list[str]:
    """Names in an expression in its order, units left out; none where it is too long."""
    position, names = text.index(MARK) + len(MARK), dict[str, None]()
    while len(text) <= LONGEST and (token := _TOKEN.match(text, position)):
        if token["name"]:
            names[token["name"]] = None
        position = token.end()
    return list(names)


def read_text(text: str) -> Measure | None:
    """A number with or without a unit, such as ``12 mm``; None for any other text."""
    match = _QUANTITY.fullmatch(text) if len(text) <= LONGEST else None
    try:
        return None if match is None else _read_measure(*match.groups())
    except ExpressionError:
        return None


def prefix_names(text: str, prefix: str, names: Collection[str]) -> str:
    """An expression with a prefix before those of its names that are listed.

    Args:
        text: With its mark ``=``.
        prefix: To put before them.

    Raises:
        ExpressionError: A unit can be read as one of the names, or it is too long.
    """
    _refuse_long(text)
    position = text.index(MARK) + len(MARK)
    parts = [text[:position]]
    while token := _TOKEN.match(text, position):
        unit = token["unit"] or ""
        if "/" in unit and (doubtful := [word for word in _WORD.findall(unit) if word in names]):
            raise _read_twice(token["number"], unit, doubtful[0])
        start = token.start("name") if token["name"] in names else token.start()
        parts += [text[position:start], prefix] if token["name"] in names else []
        parts.append(text[start : token.end()])
        position = token.end()
    return "".join(parts) + text[position:]


def _refuse_long(text: str) -> None:
    if len(text) > LONGEST:
        raise ExpressionError(
            f"is longer than {LONGEST} characters; give its parts names under [parameters]"
        )


def _read_measure(number: str, unit: str) -> Measure:
    try:
        return read_measure(number, unit)
    except UnitError as error:
        raise ExpressionError(f"holds a unit that is none: {error}") from error


def _read_twice(number: str, unit: str, word: str) -> ExpressionError:
    return ExpressionError(
        f"can be read in two ways at {number} {unit}, as {word!r} is a parameter too; write spaces around /, or [{number} {unit}]"
    )


class _Parser:
    def __init__(
        self, text: str, look_up: Callable[[str], Measure], names: Collection[str]
    ) -> None:
        self._text, self._position, self._look_up, self._names = text, 0, look_up, names
        self._token = self._next()

    def expect_end(self) -> None:
        if self._token is not None:
            raise ExpressionError(
                f"cannot be read from {self._token.group().strip()!r} on; write + - * / between values, "
                "and a unit of several words in brackets, such as [10 N m]"
            )

    def read_sum(self, depth: int) -> Measure:
        value = self._read_product(depth)
        while (sign := self._take("+", "-")) is not None:
            other = self._read_product(depth)
            if value.powers != other.powers:
                raise ExpressionError(
                    f"adds {_describe(other)} to {_describe(value)}; both sides of {sign} must measure the same"
                )
            value = Measure(
                value.value + (other.value if sign == "+" else -other.value), value.powers
            )
        return value

    def _read_product(self, depth: int) -> Measure:
        value = self._read_factor(depth)
        while (sign := self._take("*", "/")) is not None:
            other = self._read_factor(depth)
            value = value.times(other) if sign == "*" else value.over(other)
            if any(abs(power) > LARGEST_POWER for _, power in value.powers):
                raise ExpressionError(
                    f"measures a power of a unit beyond {LARGEST_POWER}; check its products"
                )
        return value

    def _read_factor(self, depth: int) -> Measure:
        if depth > DEEPEST:
            raise ExpressionError(f"is nested more than {DEEPEST} deep; give its parts names")
        if self._take("-"):
            inner = self._read_factor(depth + 1)
            return Measure(-inner.value, inner.powers)
        if self._take("("):
            value = self.read_sum(depth + 1)
            if not self._take(")"):
                raise ExpressionError("lacks a closing parenthesis")
            return value
        return self._read_value()

    def _read_value(self) -> Measure:
        token = self._token
        if token is None or token["sign"]:
            shown = "its end" if token is None else repr(token["sign"])
            raise ExpressionError(
                f'lacks a value before {shown}; write for example "= 2 * (wall + 3 mm)"'
            )
        self._token = self._next()
        if token["name"]:
            return self._look_up(token["name"])
        number, unit = token["number"], token["unit"] or ""
        if number is None:
            match = _QUANTITY.fullmatch(token["quantity"])
            if match is None:
                raise ExpressionError(
                    f"holds [{token['quantity']}], which is no number with a unit; write for example [10 N m]"
                )
            number, unit = match.groups()
        elif "/" in unit:
            # a unit with a word that is a parameter can be read in two ways
            for word in [word for word in _WORD.findall(unit) if word in self._names]:
                raise _read_twice(number, unit, word)
        return _read_measure(number, unit)

    def _take(self, *signs: str) -> str | None:
        if self._token is None or self._token["sign"] not in signs:
            return None
        sign = str(self._token["sign"])
        self._token = self._next()
        return sign

    def _next(self) -> re.Match[str] | None:
        if not self._text[self._position :].strip():
            return None
        match = _TOKEN.match(self._text, self._position)
        if match is None:
            raise ExpressionError(
                f"cannot be read from {self._text[self._position :].strip()[:20]!r} on; it takes numbers with units, names of parameters, "
                "+ - * / and parentheses"
            )
        self._position = match.end()
        return match


def _describe(measure: Measure) -> str:
    unit = measure.unit
    return f"a value in {unit}" if unit else "a plain number"
