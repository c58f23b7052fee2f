"""Parameters of a scene: values with names, and every text of it that is calculated from them."""

from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal

from headstock.scene.reading.expressions import (
    NAME,
    ExpressionError,
    calculate,
    is_expression,
    names_in,
    sole_name,
)
from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.reading.findings import Findings, suggest_names
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.units import Measure, show_value

PARAMETERS = "parameters"
# applied before values are calculated, or to be applied to other scenes
NOT_CALCULATED = (PARAMETERS, "variants", "studies", "compare")

# whose entries describe the machine
MACHINE_SECTIONS = (
    PARAMETERS,
    "materials",
    "components",
    "joints",
    "chains",
    "points",
    "axes",
    "supports",
    "loads",
    "probes",
    "drives",
)


def calculate_tables(raw: TomlTable, findings: Findings) -> TomlTable:
    """A scene with all its expressions calculated; ``parameters`` stays for whoever looks.

    Args:
        raw: As parsed, variants and overrides applied; left as it is.
        findings: Receives what cannot be calculated.
    """
    parameters = _Parameters(raw)
    overrides = {
        str(key[1]): origin.override
        for key, origin in findings.origins.items()
        if key[0] == PARAMETERS and len(key) > 1 and origin.override is not None
    }
    if overrides:
        _note_overrides(raw, overrides, findings)
    return {
        section: value
        if section in NOT_CALCULATED
        else _calculated(value, (section,), parameters, findings)
        for section, value in raw.items()
    }


def _note_overrides(raw: TomlTable, overrides: Mapping[str, str], findings: Findings) -> None:
    """Have errors of what is calculated from a parameter name what set it.

    Args:
        raw: As parsed.
        overrides: Setting, variant or point of a study, by parameter.
        findings: Receives the origins.
    """
    section = raw.get(PARAMETERS)
    names = section if isinstance(section, dict) else {}

    def find(text: TomlValue, known: frozenset[str] = frozenset()) -> str | None:
        for name in names_in(text) - known if isinstance(text, str) and is_expression(text) else ():
            found = overrides.get(name) or find(names.get(name, ""), known | {name})
            if found is not None:
                return found
        return None

    def walk(value: TomlValue, key: KeyPath) -> None:
        if isinstance(value, dict | list):
            entries = value.items() if isinstance(value, dict) else enumerate(value)
            for part, item in entries:
                walk(item, (*key, part))
        elif (found := find(value)) is not None:
            origin = findings.origin_of(key)
            if origin.override is None:
                findings.origins[key] = replace(origin, override=found)

    for section_name, entries in raw.items():
        if section_name not in NOT_CALCULATED:
            walk(entries, (section_name,))


class _Parameters:
    """Values of the parameters of a scene, calculated when they are requested."""

    def __init__(self, raw: TomlTable) -> None:
        section = raw.get(PARAMETERS)
        self.written: TomlTable = section if isinstance(section, dict) else {}
        self._known: dict[str, Measure] = {}
        self._open: list[str] = []

    def value(self, name: str) -> TomlValue:
        """What a sole name stands for: of any kind."""
        if name in self.written:
            written = self.written[name]
            if isinstance(written, dict | list):
                return self._inside(name, written)
            if not is_expression(written) and not _is_number(written):
                return written
        return self.measure(name).written()

    def _inside(self, name: str, written: TomlValue) -> TomlValue:
        """A list or a table that a sole name stands for, calculated."""
        if name in self._open:
            raise ExpressionError(f"holds itself: {name}")
        self._open.append(name)
        try:
            return self._filled(written)
        finally:
            self._open.pop()

    def _filled(self, value: TomlValue) -> TomlValue:
        if isinstance(value, dict):
            return {key: self._filled(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self._filled(item) for item in value]
        return self.calculated(value) if isinstance(value, str) and is_expression(value) else value

    def measure(self, name: str) -> Measure:
        """A number or a quantity; raises ``ExpressionError``."""
        if name in self._known:
            return self._known[name]
        if name not in self.written:
            hint = suggest_names(name, self.written, what="parameters")
            raise ExpressionError(f"names the unknown parameter {name[:80]!r}; {hint}")
        if name in self._open:
            circle = " -> ".join([*self._open[self._open.index(name) :], name])
            raise ExpressionError(f"is calculated from itself: {circle}; give one of them a value")
        written = self.written[name]
        self._open.append(name)
        try:
            found = self._read(name, written)
        finally:
            self._open.pop()
        self._known[name] = found
        return found

    def _read(self, name: str, written: TomlValue) -> Measure:
        if isinstance(written, str) and is_expression(written):
            try:
                return calculate(written, self.measure)
            except ExpressionError as error:
                raise ExpressionError(f"needs the parameter {name!r}, which {error}") from error
        if _is_number(written):
            return Measure(Decimal(repr(written)))
        try:
            return calculate(f"=[{written}]", self.measure)
        except ExpressionError as error:
            raise ExpressionError(
                f"calculates with {name!r}, which is {show_value(written)} and no number; "
                'write a number with a unit, such as "12 mm"'
            ) from error

    def calculated(self, text: str) -> TomlValue:
        """The value of an expression of a scene; raises ``ExpressionError``."""
        name = sole_name(text)
        return self.value(name) if name is not None else calculate(text, self.measure).written()


def _is_number(written: TomlValue) -> bool:
    return isinstance(written, int | float) and not isinstance(written, bool)


def _calculated(
    value: TomlValue, key: KeyPath, parameters: _Parameters, findings: Findings
) -> TomlValue:
    """A value with every expression in it calculated; what cannot be stays as it is written and is
    reported.
    """
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
        findings.add(key, f"{show_value(value)} {error}")
        return value


def check_parameters(raw: TomlTable, findings: Findings) -> None:
    """Report parameters with names that no expression could take, or that cannot be calculated.

    Args:
        raw: The scene as parsed.
        findings: Receives the problems.
    """
    parameters = _Parameters(raw)
    for name, written in parameters.written.items():
        key = (PARAMETERS, name)
        if NAME.fullmatch(name) is None:
            findings.add(
                key, f"{name[:80]!r} is no name of a parameter; write letters, digits and _"
            )
        elif isinstance(written, str) and is_expression(written):
            try:
                parameters.calculated(written)
            except ExpressionError as error:
                findings.add(key, f"{show_value(written)} {error}")
