"""A test of a modified machine beside the test before it was modified: which modes are still the same, by
the shapes of both tests.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.frames import DIRECTIONS
from headstock.scene.reading.files import TomlTable, read_scene
from headstock.scene.reading.findings import Findings
from headstock.scene.schema.validation import validate_against
from headstock.solvers.pairing.mode_pairing import assign_modes, correlate_modes
from headstock.studies.correlation.sensors import Motions
from headstock.studies.identification.targets import TargetsTable


@dataclass(frozen=True, eq=False)
class BaseCase:
    """Measured modes of a machine before it was modified.

    Attributes:
        case: Its name in the target file.
        raw: Table of the target file, as it is written.
        names: Of its modes that have shapes.
        motions: Shape of each of these modes.
    """

    case: str
    raw: TomlTable
    names: tuple[str, ...]
    motions: tuple[Motions, ...]


def read_base_case(path: Path) -> BaseCase:
    """Read the first case of a target file that is no modification of another.

    Raises:
        SceneError: The file has problems, or no case with names and shapes.
    """
    findings = Findings(str(path))
    raw = read_scene(path, findings, "target")
    table = validate_against(TargetsTable, raw, findings)
    findings.raise_if_any()
    for name, case in () if table is None else table.cases.items():
        shaped = [mode for mode in case.modes or () if mode.name and mode.vectors]
        if case.like is None and shaped:
            motions = (mode.motions.items() for mode in shaped)
            named = ({(sensor, DIRECTIONS[dof]): x for (sensor, dof), x in one} for one in motions)
            return BaseCase(name, raw, tuple(mode.name for mode in shaped), tuple(named))
    findings.add(
        ("cases",),
        "no case has modes with name and vectors; take the targets.toml of an earlier test",
    )
    findings.raise_if_any()
    raise AssertionError("a problem was found and is raised")


def match_base_modes(shapes: Sequence[Motions], base: BaseCase) -> tuple[str, ...]:
    """Return the name of each measured shape: that of the mode of the base case with the same one; empty
    where none has it.
    """
    shared = sorted(set.intersection(*(set(motions) for motions in (*shapes, *base.motions))))
    names = [""] * len(shapes)
    if shared:
        first, second = (
            np.array([[motions[place] for place in shared] for motions in every]).T
            for every in (shapes, base.motions)
        )
        correlations = correlate_modes(first, second)
        for pair in assign_modes(correlations, np.zeros_like(correlations)):
            names[pair.first] = base.names[pair.second]
    return tuple(names)


def list_exchanges(names: tuple[str, ...], base: BaseCase) -> tuple[str, ...]:
    """Say which neighbouring modes of the base case have come into the other order.

    Args:
        names: Of the modes of the modified machine, rising.
    """
    places = [base.names.index(name) for name in names if name]
    return tuple(
        f"{base.names[other]} and {base.names[one]} have exchanged their order since {base.case}"
        for one, other in itertools.pairwise(places)
        if one > other
    )
