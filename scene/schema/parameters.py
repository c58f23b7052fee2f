"""Parameters of a scene: values with names, and every text of it that is calculated from them."""

from decimal import Decimal

from headstock.scene.reading.expressions import (
    NAME,
    ExpressionError,
    calculate,
    is_expression,
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
    return {
        section: value
        if section in NOT_CALCULATED
        else _calculated(value, (section,), parameters, findings)
        for section, value in raw.items()
    }


class _Parameters:
    """Values of the parameters of a scene, calculated when they are asked for."""

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
