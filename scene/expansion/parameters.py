"""Parameters of a scene: values with names, and every text of it that is calculated from them.

Each parameter is calculated once, after those that it needs, whether or not this succeeds; what
lists and tables grow to is counted. So a scene costs what it holds, not what it could be written
out to.
"""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal

from headstock.scene.reading.expressions import (
    NAME,
    ExpressionError,
    calculate,
    is_expression,
    names_in,
    read_text,
    sole_name,
)
from headstock.scene.reading.files import (
    MAX_DEPTH,
    TomlTable,
    TomlValue,
    count_entries,
)
from headstock.scene.reading.findings import Findings, KeyPath, suggest_names
from headstock.scene.reading.units import Measure, quote_value

PARAMETERS = "parameters"
# applied before values are calculated, or to be applied to other scenes
NOT_CALCULATED = (PARAMETERS, "variants", "studies", "compare")
MAX_FILLED = 10_000  # entries of lists and tables that parameters stand for, and of one of them
LARGEST_NUMBER = 10**40  # of a whole number; units reach further
_SHOWN_MESSAGE = 200  # characters of why another parameter fails
_SHOWN_NAMES = 6  # of a circle of parameters

# whose entries describe the machine
MACHINE_SECTIONS = (
    PARAMETERS,
    "materials",
    "cutting",
    "components",
    "joints",
    "chains",
    "points",
    "axes",
    "supports",
    "loads",
    "probes",
    "sensors",
    "masses",
    "drives",
)


def calculate_tables(raw: TomlTable, findings: Findings) -> TomlTable:
    """A scene with all its expressions calculated; ``parameters`` stays for whoever looks.

    Args:
        raw: As parsed, variants and overrides applied; left as it is.
        findings: Receives what cannot be calculated, and parameters that no expression could take.
    """
    parameters = _Parameters(raw)
    overrides = {
        str(key[1]): origin.override
        for key, origin in findings.origins.items()
        if key[0] == PARAMETERS and len(key) > 1 and origin.override is not None
    }
    if overrides:
        _note_overrides(raw, parameters, overrides, findings)
    _check_names(parameters, findings)
    return {
        section: value
        if section in NOT_CALCULATED
        else _calculated(value, (section,), parameters, findings)
        for section, value in raw.items()
    }


def _check_names(parameters: "_Parameters", findings: Findings) -> None:
    for name, written in parameters.written.items():
        if NAME.fullmatch(name) is None:
            findings.add(
                (PARAMETERS, name),
                f"{name[:80]!r} is no name of a parameter; write letters, digits and _",
            )
        elif is_expression(written):
            try:
                parameters.calculated(str(written))
            except ExpressionError as error:
                findings.add((PARAMETERS, name), f"{quote_value(written)} {error}")


def _note_overrides(
    raw: TomlTable, parameters: "_Parameters", overrides: Mapping[str, str], findings: Findings
) -> None:
    """Have errors of what is calculated from a parameter name what set it.

    Args:
        overrides: Setting, variant or point of a study, by parameter.
    """
    users: dict[str, list[str]] = {}
    for name, written in parameters.written.items():
        for needed in _names_of(written):
            users.setdefault(needed, []).append(name)
    sources = dict(overrides)
    waiting = deque(overrides)
    while waiting:
        name = waiting.popleft()
        for user in users.get(name, ()):
            if user not in sources:
                sources[user] = sources[name]
                waiting.append(user)
    for section, entries in raw.items():
        for key, text in () if section in NOT_CALCULATED else _expressions(entries, (section,)):
            source = next((sources[name] for name in names_in(text) if name in sources), None)
            origin = findings.origin_of(key) if source is not None else None
            if origin is not None and origin.override is None:
                findings.origins[key] = replace(origin, override=source)


def _expressions(value: TomlValue, key: KeyPath = ()) -> Iterator[tuple[KeyPath, str]]:
    """Each expression in a value, and where it stands."""
    if isinstance(value, dict | list):
        for part, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _expressions(item, (*key, part))
    elif isinstance(value, str) and is_expression(value):
        yield key, value


def _names_of(written: TomlValue) -> list[str]:
    """Parameters that a value needs, in its order."""
    names = (name for _, text in _expressions(written) for name in names_in(text))
    return list(dict.fromkeys(names))


@dataclass(frozen=True)
class _Known:
    """A parameter as a sole name stands for it.

    Attributes:
        entries: That it is written out to, long texts as several.
        depth: Of lists and tables in each other.
        measure: What expressions calculate with; None where it is to be read from the value.
    """

    value: TomlValue
    entries: int = 1
    depth: int = 0
    measure: Measure | None = None


@dataclass(frozen=True)
class _Failed:
    """A parameter that cannot be calculated.

    Attributes:
        message: Why, from parameter to parameter.
    """

    message: str
    root: str
    reason: str


class _NeedsFailedError(ExpressionError):
    """A value that needs a parameter that cannot be calculated."""

    def __init__(self, name: str, failed: _Failed) -> None:
        self.root, self.reason = failed.root, failed.reason
        why = (
            failed.message
            if len(failed.message) <= _SHOWN_MESSAGE
            else f"depends on {failed.root!r}, which {failed.reason}"
        )
        super().__init__(f"needs the parameter {name!r}, which {why}")


class _Parameters:
    """Values of the parameters of a scene, calculated when they are requested."""

    def __init__(self, raw: TomlTable) -> None:
        section = raw.get(PARAMETERS)
        self.written: TomlTable = section if isinstance(section, dict) else {}
        self._found: dict[str, _Known | _Failed] = {}
        self._filled = 0  # entries of the scene that stand for lists and tables

    def calculated(self, text: str) -> TomlValue:
        """The value of an expression of a scene; raises ``ExpressionError``."""
        for name in names_in(text):
            self._calculate_with_needs(name)
        parameter = self._evaluate(text)
        self._filled += parameter.entries - 1
        if self._filled > MAX_FILLED:
            raise ExpressionError(
                f"makes the scene hold more than {MAX_FILLED} entries of parameters that are lists "
                "or tables; a scene holds no bulk data, write shorter lists"
            )
        return _copied(parameter.value)

    def _calculate_with_needs(self, name: str) -> None:
        """Calculate a parameter after all that it needs, however long the chain of them."""
        if name in self._found or name not in self.written:
            return
        # open ones, each needed by the one before it
        path = [(name, iter(_names_of(self.written[name])))]
        position = {name: 0}
        while path:
            last, needs = path[-1]
            for needed in needs:
                if needed in self._found or needed not in self.written:
                    continue
                if needed in position:
                    circle = [
                        parameter for parameter, _ in path[position[needed] :][: _SHOWN_NAMES + 1]
                    ]
                    shown = circle if len(circle) <= _SHOWN_NAMES else [*circle[:-2], "..."]
                    reason = (
                        f"is calculated from itself: {' -> '.join([*shown, needed])}; "
                        "give one of them a value"
                    )
                    self._found[needed] = _Failed(reason, needed, reason)
                else:
                    position[needed] = len(path)
                    path.append((needed, iter(_names_of(self.written[needed]))))
                    break
            else:
                path.pop()
                if last not in self._found:
                    self._found[last] = self._result(last)

    def _result(self, name: str) -> _Known | _Failed:
        written = self.written[name]
        try:
            measure = None if isinstance(written, str) else _measure_of(written)
            if measure is not None:
                return _Known(measure.written(), measure=measure)
            return self._filled_in(written)
        except _NeedsFailedError as error:
            return _Failed(str(error), error.root, error.reason)
        except ExpressionError as error:
            return _Failed(str(error), name, str(error))

    def _filled_in(self, written: TomlValue) -> _Known:
        """A value with the expressions in it calculated, whose parameters are."""
        if isinstance(written, str):
            if is_expression(written):
                return self._evaluate(written)
            return _Known(written, count_entries(written))
        if not isinstance(written, dict | list):
            return _Known(written)
        inner = [
            self._filled_in(item)
            for item in (written.values() if isinstance(written, dict) else written)
        ]
        entries = 1 + sum(known.entries for known in inner)
        depth = 1 + max((known.depth for known in inner), default=0)
        if entries > MAX_FILLED or depth > MAX_DEPTH:
            most = f"{MAX_FILLED} entries" if entries > MAX_FILLED else f"{MAX_DEPTH} levels"
            raise ExpressionError(
                f"holds more than {most} with the lists and tables that it names; write a shorter one"
            )
        values = [known.value for known in inner]
        return _Known(
            dict(zip(written, values, strict=True)) if isinstance(written, dict) else values,
            entries,
            depth,
        )

    def _evaluate(self, text: str) -> _Known:
        """An expression whose parameters are calculated."""
        if (name := sole_name(text)) is not None:
            return self._look_up(name)
        measure = calculate(text, self._measure, self.written)
        return _Known(measure.written(), measure=measure)

    def _look_up(self, name: str) -> _Known:
        if name not in self.written:
            hint = suggest_names(name, self.written, what="parameters")
            raise ExpressionError(f"names the unknown parameter {name[:80]!r}; {hint}")
        result = self._found[name]
        if isinstance(result, _Failed):
            raise _NeedsFailedError(name, result)
        return result

    def _measure(self, name: str) -> Measure:
        """A number or a quantity."""
        parameter = self._look_up(name)
        if parameter.measure is not None:
            return parameter.measure
        measure = _measure_of(parameter.value)
        if measure is None:
            raise ExpressionError(
                f"calculates with {name!r}, which is {quote_value(parameter.value)} and no number; "
                'write a number with a unit, such as "12 mm"'
            )
        self._found[name] = replace(parameter, measure=measure)
        return measure


def _measure_of(value: TomlValue) -> Measure | None:
    """What a written value measures; None for what is no finite number of ordinary size."""
    if isinstance(value, str):
        return read_text(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return Measure(Decimal(repr(value))) if -LARGEST_NUMBER < value < LARGEST_NUMBER else None


def _copied(value: TomlValue) -> TomlValue:
    """A list or a table of its own for each place, so that no two of a scene are one object."""
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    return [_copied(item) for item in value] if isinstance(value, list) else value


def _calculated(
    value: TomlValue, key: KeyPath, parameters: _Parameters, findings: Findings
) -> TomlValue:
    """A value with its expressions calculated; what cannot be stays, and is reported."""
    if isinstance(value, dict):
        return {
            name: _calculated(item, (*key, name), parameters, findings)
            for name, item in value.items()
        }
    if isinstance(value, list):
        return [
            _calculated(item, (*key, index), parameters, findings)
            for index, item in enumerate(value)
        ]
    if not isinstance(value, str) or not is_expression(value):
        return value
    try:
        return parameters.calculated(value)
    except ExpressionError as error:
        findings.add(key, f"{quote_value(value)} {error}")
        return value
