"""odd numbers are refused with their line before anything is assembled; what is
accepted is finite.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from faults.runs import SCENE
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene

pytestmark = pytest.mark.hard("H17")

JOINT = '\n[joints.odd]\nbetween = ["ground", "column.tip"]\nkind = "spring"\nstiffness = { x = VALUE }\n'


def load(folder: Path, text: str, value: str) -> Scene:
    path = folder / "scene.toml"
    path.write_text(text.replace("VALUE", value))
    return load_scene(path)


@pytest.mark.parametrize(
    "value",
    [
        '"nan N/um"', '"inf N/um"', '"-inf N/um"', '"1e400 N/um"', '"1e308 GN/nm"', '"1e3"', '"1e3 N"', '"1+2j N/um"', '"2j N/um"', '"-1 N/um"',
        "nan", "inf", "1e400", "5", "true", '""', '"N/um"', '"1 N/um 2"', '"1,5 N/um"', '"0x10 N/um"', '"1_000 N/um"',
    ],
)  # fmt: skip
def test_an_odd_stiffness_is_refused_at_its_line(tmp_path: Path, value: str) -> None:
    with pytest.raises(SceneError) as caught:
        load(tmp_path, SCENE + JOINT, value)
    problems = caught.value.problems
    assert all(
        "scene.toml:" in problem.place and problem.key.startswith("joints.odd")
        for problem in problems
    )


@pytest.mark.parametrize("key", ['E = "210 GPa"', 'rho = "7850 kg/m^3"'])
@pytest.mark.parametrize("number", ["0", "-1", "nan", "inf", "1e400", "-0"])
def test_a_material_without_a_positive_finite_number_is_refused(
    tmp_path: Path, key: str, number: str
) -> None:
    name, _, unit = key.replace('"', "").split(" ", 2)[0], None, key.rsplit(" ", 1)[1].rstrip('"')
    with pytest.raises(SceneError, match=rf"materials\.steel\.{name}"):
        load(tmp_path, SCENE.replace(key, f'{name} = "{number} {unit}"'), "")


def test_every_number_of_an_accepted_machine_is_finite(tmp_path: Path) -> None:
    machine = load(tmp_path, SCENE + JOINT, '"1e-3 N/m"').machine
    numbers: list[float] = []

    def collect(value: object) -> None:
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            for field in dataclasses.fields(value):
                collect(getattr(value, field.name))
        elif isinstance(value, dict):
            for item in value.values():
                collect(item)
        elif isinstance(value, list | tuple):
            for item in value:
                collect(item)
        elif isinstance(value, np.ndarray):
            numbers.extend(float(number) for number in value.ravel())
        elif isinstance(value, float):
            numbers.append(value)

    collect([machine.components, machine.joints, machine.gravity])
    assert len(numbers) > 50
    assert all(math.isfinite(number) for number in numbers)


def test_a_negative_stiffness_needs_its_flag(tmp_path: Path) -> None:
    allowed = JOINT.replace("stiffness", "allow_negative = true\nstiffness")
    stiffness = load(tmp_path, SCENE + allowed, '"-1 N/um"').machine.joints["odd"].stiffness
    assert stiffness[0, 0] == -1e6
