"""FMUs of a machine for co-simulation, FMI 2.0 and 3.0: C sources with the numbers of a state space at
a fixed step, and a library for this kind of computer.

Source: Functional Mock-up Interface Specification, 2.0.4 and 3.0.1 (Modelica Association).
"""

import hashlib
import io
import platform
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from headstock.pipeline.exchange.matrices import ExchangeError

SOURCES = Path(__file__).parent / "fmu"
MODEL = "headstock"
VERSIONS = {2: "2.0", 3: "3.0"}
TOKENS = {2: "guid", 3: "instantiationToken"}
CAPABILITIES = {
    2: ("canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative"),
    3: (
        "canGetAndSetFMUState",
        "canSerializeFMUState",
        "providesDirectionalDerivatives",
        "providesAdjointDerivatives",
    ),
}
UNITS = {
    "1": {},
    "s": {"s": "1"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "m": {"m": "1"},
    "N.m": {"kg": "1", "m": "2", "s": "-2"},
    "rad": {"rad": "1"},
    "m/s": {"m": "1", "s": "-1"},
    "m/s2": {"m": "1", "s": "-2"},
    "rad/s": {"rad": "1", "s": "-1"},
    "rad/s2": {"rad": "1", "s": "-2"},
}
BINARIES = {2: "linux64", 3: "x86_64-linux"}
SECONDS = 300  # that a compiler may take
COMPILER = ("cc", "-shared", "-fPIC", "-O3", "-std=c99", "-I.")
FIXED_TIME = (2026, 1, 1, 0, 0, 0)  # of the entries, so that the same machine is the same file


class FmuVariable(NamedTuple):
    """An input with its value at the start, or an output."""

    name: str
    unit: str
    start: float | None = None

    @property
    def causality(self) -> str:
        """As model descriptions name it."""
        return "output" if self.start is None else "input"


@dataclass(frozen=True, eq=False)
class FmuModel:
    """What an FMU is made of.

    Attributes:
        step: [s].
        variables: Inputs before outputs; positions of axes behind other inputs.
        header: Its numbers in C.
        axes: It has positions of axes, and no derivatives.
    """

    name: str
    description: str
    step: float
    variables: tuple[FmuVariable, ...]
    header: str
    axes: bool = False

    @property
    def token(self) -> str:
        """Return the identifier that a model description and its library share."""
        return "{" + hashlib.sha256(self.header.encode()).hexdigest()[:32] + "}"


def encode_fmu(model: FmuModel, version: int) -> bytes:
    """Return an FMU for co-simulation, compiled where a C compiler is at hand.

    Args:
        version: 2 or 3.

    Raises:
        ExchangeError: The compiler refused the sources.
    """
    sources = {
        path.name: path.read_bytes()
        for path in sorted(SOURCES.iterdir())
        if _belongs(path, version)
    }
    sources["model.h"] = f'#define TOKEN "{model.token}"\n{model.header}'.encode()
    files = {"modelDescription.xml": _describe_model(model, version)}
    files |= {f"sources/{name}": content for name, content in sources.items()}
    if version == 3:
        files["sources/buildDescription.xml"] = _describe_build()
    library = _compile(sources, version)
    if library is not None:
        files[f"binaries/{BINARIES[version]}/{MODEL}.so"] = library
    image = io.BytesIO()
    with zipfile.ZipFile(image, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, FIXED_TIME), content, zipfile.ZIP_DEFLATED)
    return image.getvalue()


def _belongs(path: Path, version: int) -> bool:
    return (path.suffix == ".h" and "fmi" not in path.name) or path.name.startswith(f"fmi{version}")


def _describe_build() -> bytes:
    build = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ElementTree.SubElement(build, "BuildConfiguration", modelIdentifier=MODEL)
    files = ElementTree.SubElement(configuration, "SourceFileSet", language="C99")
    ElementTree.SubElement(files, "SourceFile", name="fmi3.c")
    return _encode_xml(build)


def _describe_model(model: FmuModel, version: int) -> bytes:
    step = repr(model.step)
    root = ElementTree.Element(
        "fmiModelDescription",
        {"fmiVersion": VERSIONS[version], TOKENS[version]: model.token},
        modelName=model.name,
        description=model.description,
        generationTool="Headstock",
        variableNamingConvention="flat",
    )
    kind = ElementTree.SubElement(
        root,
        "CoSimulation",
        {
            name: "true"
            for name in CAPABILITIES[version]
            if not (model.axes and name.endswith(("Derivative", "Derivatives")))
        },
        modelIdentifier=MODEL,
        canHandleVariableCommunicationStepSize="true",
    )
    if version == 2:
        sources = ElementTree.SubElement(kind, "SourceFiles")
        ElementTree.SubElement(sources, "File", name="fmi2.c")
    else:
        kind.set("fixedInternalStepSize", step)
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name, powers in UNITS.items():
        unit = ElementTree.SubElement(units, "Unit", name=name)
        ElementTree.SubElement(unit, "BaseUnit", powers)
    ElementTree.SubElement(root, "DefaultExperiment", stepSize=step)
    _add_variables(root, model, version)
    return _encode_xml(root)


def _add_variables(root: ElementTree.Element, model: FmuModel, version: int) -> None:
    """Add the variables, inputs before outputs, and what must be known of outputs."""
    variables = ElementTree.SubElement(root, "ModelVariables")
    structure = ElementTree.SubElement(root, "ModelStructure")
    if version == 3:
        time = {"causality": "independent", "variability": "continuous", "unit": "s"}
        ElementTree.SubElement(variables, "Float64", time, name="time", valueReference="0")
    for reference, given in enumerate(model.variables, 1):
        common = {
            "name": given.name,
            "valueReference": str(reference),
            "causality": given.causality,
            "variability": "continuous",
        }
        start = {"unit": given.unit} | ({} if given.start is None else {"start": repr(given.start)})
        if version == 3:
            ElementTree.SubElement(variables, "Float64", {**common, **start})
        else:
            initial = {"initial": "calculated"} if given.start is None else {}
            variable = ElementTree.SubElement(variables, "ScalarVariable", {**common, **initial})
            ElementTree.SubElement(variable, "Real", start)
    outputs = [
        reference for reference, given in enumerate(model.variables, 1) if given.start is None
    ]
    for tag in ("Output", "InitialUnknown"):
        parent = structure if version == 3 else ElementTree.SubElement(structure, f"{tag}s")
        for reference in outputs:
            number = {"valueReference" if version == 3 else "index": str(reference)}
            ElementTree.SubElement(parent, tag if version == 3 else "Unknown", number)


def _encode_xml(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True))


def _compile(sources: dict[str, bytes], version: int) -> bytes | None:
    """Return the library of this kind of computer; None without a compiler, or elsewhere than on Linux
    with 64-bit x86 processors.
    """
    if (sys.platform, platform.machine()) != ("linux", "x86_64"):
        return None
    with tempfile.TemporaryDirectory() as folder:
        for name, content in sources.items():
            (Path(folder) / name).write_bytes(content)
        command: Sequence[str] = (*COMPILER, f"fmi{version}.c", "-o", f"{MODEL}.so", "-lm")
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, timeout=SECONDS, check=False
            )
        except FileNotFoundError:
            return None
        if done.returncode:
            raise ExchangeError(
                f"the C compiler refused the sources of the FMU: {done.stderr.strip()[-300:]}"
            )
        return (Path(folder) / f"{MODEL}.so").read_bytes()
