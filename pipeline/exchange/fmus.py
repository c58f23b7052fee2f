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
from xml.etree import ElementTree

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.exchange.matrices import ExchangeError
from headstock.pipeline.exchange.state_spaces import MachineStateSpace, name_variable

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
COMPILER = ("cc", "-shared", "-fPIC", "-O2", "-std=c99", "-I.")
FIXED_TIME = (2026, 1, 1, 0, 0, 0)  # of the entries, so that the same machine is the same file


@dataclass(frozen=True, eq=False)
class FmuModel:
    """What an FMU is made of: the name of the machine, and its state space at a step."""

    name: str
    space: MachineStateSpace

    @property
    def token(self) -> str:
        """What a model description and its library know each other by."""
        return "{" + hashlib.sha256(_encode_numbers(self.space).encode()).hexdigest()[:32] + "}"

    @property
    def description(self) -> str:
        """In a sentence."""
        return f"{self.name}: forces in, motions out; inputs are held over {self.space.step:g} s"

    @property
    def variables(self) -> list[tuple[str, str, str]]:
        """Name, unit and causality of each variable, inputs first."""
        return [
            (name_variable(kind, name), unit, causality)
            for kind, causality, names, units in (
                ("force", "input", self.space.inputs, self.space.input_units),
                ("motion", "output", self.space.outputs, self.space.output_units),
            )
            for name, unit in zip(names, units, strict=True)
        ]


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
    sources["model.h"] = _encode_header(model).encode()
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
    return path.name == "core.h" or path.name.startswith(f"fmi{version}")


def _encode_numbers(space: MachineStateSpace) -> str:
    paired = 2 * space.pairs
    states = np.arange(paired).reshape(-1, 2)
    arrays = {
        "BLOCKS": space.A[states[:, :, None], states[:, None, :]],
        "A": space.A[paired:, paired:],
        "B": space.B,
        "C": space.C,
        "D": space.D,
    }
    return "".join(_encode_array(name, array) for name, array in arrays.items())


def _encode_array(name: str, array: FloatArray) -> str:
    numbers = array.ravel().tolist() or [0.0]
    rows = (", ".join(map(repr, numbers[k : k + 6])) for k in range(0, len(numbers), 6))
    return f"static const double {name}[] = {{\n" + ",\n".join(rows) + "\n};\n"


def _encode_header(model: FmuModel) -> str:
    space = model.space
    sizes = {
        "PAIRS": space.pairs,
        "DENSE": len(space.A) - 2 * space.pairs,
        "INPUTS": len(space.inputs),
        "OUTPUTS": len(space.outputs),
        "STEP": repr(space.step),
        "STEP_TEXT": f'"{space.step:g}"',
        "TOKEN": f'"{model.token}"',
    }
    return "".join(f"#define {name} {value}\n" for name, value in sizes.items()) + _encode_numbers(
        space
    )


def _describe_build() -> bytes:
    build = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ElementTree.SubElement(build, "BuildConfiguration", modelIdentifier=MODEL)
    files = ElementTree.SubElement(configuration, "SourceFileSet", language="C99")
    ElementTree.SubElement(files, "SourceFile", name="fmi3.c")
    return _encode_xml(build)


def _describe_model(model: FmuModel, version: int) -> bytes:
    step = repr(model.space.step)
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
        dict.fromkeys(CAPABILITIES[version], "true"),
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
    for reference, (name, unit, causality) in enumerate(model.variables, 1):
        common = {
            "name": name,
            "valueReference": str(reference),
            "causality": causality,
            "variability": "continuous",
        }
        start = {"unit": unit, **({"start": "0"} if causality == "input" else {})}
        if version == 3:
            ElementTree.SubElement(variables, "Float64", {**common, **start})
        else:
            initial = {"initial": "calculated"} if causality == "output" else {}
            variable = ElementTree.SubElement(variables, "ScalarVariable", {**common, **initial})
            ElementTree.SubElement(variable, "Real", start)
    outputs = range(1 + len(model.space.inputs), 1 + len(model.variables))
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
