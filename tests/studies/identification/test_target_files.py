"""A target file that cannot be used is answered with every problem at once, each with its place and
what to write.
"""

import re
from pathlib import Path

import pytest

from common import approx
from headstock.scene.reading.findings import Problem, SceneError
from headstock.studies.identification.target_files import LoadedTask, load_targets
from headstock.validation.machines.identification_cases import SCENE

ROOT = Path(__file__).resolve().parents[3]
GOOD = """name = "good"
[fit]
modes_above = "5 Hz"
[cases.a]
variant = "stiff"
pose = "out"
tolerance = "2 %"
frequencies = ["60 Hz", "50 Hz"]
modes = [{ frequency = "70 Hz", tolerance = "1.4 Hz", weight = 4, vectors = { tcp = [0, 1, 0] } }]
compliances = [{ point = "tcp", motion = "z", force = "x", value = "-9 um/kN", tolerance = "0.9 um/kN", hold_out = true }]
[parameters.guide]
keys = ["joints.guide_*.stiffness.normal"]
bounds = ["10 N/um", "800 N/um"]
[parameters.width]
keys = ["joints.guide_1.at[1]", { key = "joints.guide_2.at[1]", factor = -1, offset = "2 mm" }]
bounds = ["10 mm", "80 mm"]
prior_sigma = 0.3
"""


def load(folder: Path, text: str) -> LoadedTask:
    scene, targets = folder / "machine.toml", folder / "targets.toml"
    scene.write_text(SCENE)
    targets.write_text(text)
    return load_targets(targets, scene)


def problems(folder: Path, text: str) -> tuple[Problem, ...]:
    with pytest.raises(SceneError) as caught:
        load(folder, text)
    return caught.value.problems


def test_a_target_file_becomes_targets_in_si_units(tmp_path: Path) -> None:
    task = load(tmp_path, GOOD).task
    (case,) = task.cases
    assert [target.frequency_hz for target in case.modes] == [50.0, 60.0, 70.0]
    assert [target.sigma for target in case.modes] == approx([0.02, 0.02, 0.01])
    assert (case.compliances[0].value, case.compliances[0].sigma) == approx((-9e-9, 0.1))
    assert case.held_out == (False, False, False, True)
    guide, width = task.parameters
    assert [rule.key[1] for rule in guide.rules] == ["guide_1", "guide_2", "guide_3", "guide_4"]
    assert (guide.start, guide.lower, guide.upper) == approx((50e6, 10e6, 800e6))
    rules = [(rule.factor, rule.offset) for rule in width.rules]
    assert rules == [(1.0, 0.0), (-1.0, approx(0.002))]
    assert (width.prior, width.prior_sigma) == approx((0.04, 0.3))


def test_numbers_are_measured_by_the_names_that_runs_give_them(tmp_path: Path) -> None:
    numbers = """numbers = { "frequency(mode=3)" = "55 Hz", "compliance(pose=out,point=tcp,direction=zx)" = "-9 um/kN" }
[parameters.guide]"""
    (case,) = load(tmp_path, GOOD.replace("[parameters.guide]", numbers)).task.cases
    assert [mode.frequency_hz for mode in case.modes] == [50.0, 55.0, 60.0, 70.0]
    assert [mode.number for mode in case.modes] == [None, 3, None, None]
    long, short = case.compliances
    assert (short.motion, short.force, short.value) == (long.motion, long.force, long.value)
    assert (short.sigma, short.hold_out) == (0.02, False)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("frequencies(mode=3)", "55 Hz", "is no name of a number"),
        ("frequency(pose=out)", "55 Hz", "names no mode"),
        ("frequency(mode=3)", "5 um/kN", "is a compliance, not a frequency"),
        ("frequency(pose=back,mode=3)", "55 Hz", "a case per pose"),
        ("compliance(point=tcpp,direction=x)", "5 um/kN", "did you mean 'tcp'?"),
        ("compliance(point=tcp,direction=xw)", "5 um/kN", "has no direction xw"),
        ("multiplier(face=1)", "5 Hz", "cannot be fitted"),
    ],
)
def test_a_number_that_cannot_be_fitted_is_named_with_the_remedy(
    tmp_path: Path, name: str, value: str, message: str
) -> None:
    numbers = f'numbers = {{ "{name}" = "{value}" }}\n[parameters.guide]'
    (found,) = problems(tmp_path, GOOD.replace("[parameters.guide]", numbers))
    assert message in found.message and "cases.a.numbers" in found.key
    assert found.place.endswith("targets.toml:11")


@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        ('"stiff"', '"stif"', "cases.a.variant", "did you mean 'stiff'?"),
        ('"out"', '"away"', "cases.a.pose", "unknown pose 'away'; poses: back, middle, out"),
        ('"60 Hz"', '"60 rad/s"', "cases.a.frequencies[0]", "not a frequency"),
        ('"60 Hz"', '"4 Hz"', "cases.a", "lies below modes_above (5 Hz)"),
        ("tcp = [0, 1, 0]", "tip = [0, 1, 0]", "cases.a.modes[0].vectors.tip", "unknown point 'tip'"),
        ("tcp = [0, 1, 0]", "tcp = [0, 0, 0]", "cases.a.modes[0].vectors", "every vector is zero"),
        ("tcp = [0, 1, 0]", "tcp = [0, 1]", "cases.a.modes[0].vectors.tcp", "has 2 entries but needs at least 3"),
        ('point = "tcp"', 'point = "tcpp"', "cases.a.compliances[0].point", "did you mean 'tcp'?"),
        ('"-9 um/kN"', '"-9 N/um"', "cases.a.compliances[0].value", "is a stiffness, not a compliance"),
        ('"-9 um/kN"', '"0 um/kN"', "cases.a.compliances[0]", "is zero"),
        ('motion = "z"', 'motion = "up"', "cases.a.compliances[0].motion", "is not one of 'x', 'y' or 'z'"),
        ('tolerance = "2 %"', 'tolerance = "-2 %"', "cases.a.tolerance", "a standard deviation is above zero"),
        ("weight = 4", "weights = 4", "cases.a.modes[0].weights", "did you mean 'weight'?"),
        ('"joints.guide_*.stiffness.normal"', '"joints.guide_*.stiffness.axial"', "parameters.guide.keys[0]", "lateral, normal"),
        ('"joints.guide_*.stiffness.normal"', '"joints.rail_*.at[0]"', "parameters.guide.keys[0]", "joints holds bolts, guide_1"),
        ('"joints.guide_*.stiffness.normal"', '"axes.X.limits[0]"', "parameters.guide.keys[0]", "no variant named here writes"),
        ('"joints.guide_*.stiffness.normal"', '"joints..normal"', "parameters.guide.keys[0]", "is not a key"),
        ('"joints.guide_*.stiffness.normal"', '"joints.guide_1.kind"', "parameters.guide.keys[0]", "cannot be fitted"),
        ('"joints.guide_*.stiffness.normal"', '"poses.out.X"', "parameters.guide.keys[0]", "cannot be fitted"),
        ('"joints.guide_*.stiffness.normal"', '"joints.feet.stiffness"', "parameters.guide.keys[0]", "is a table"),
        ('["10 N/um", "800 N/um"]', '["800 N/um", "10 N/um"]', "parameters.guide.bounds", "is not below the upper one"),
        ('["10 N/um", "800 N/um"]', '["60 N/um", "800 N/um"]', "parameters.guide.bounds", "the scene's value 5e+07 N/m lies outside"),
        ('["10 N/um", "800 N/um"]', '["0 N/um", "800 N/um"]', "parameters.guide.bounds", 'write scale = "linear"'),
        ('["10 N/um", "800 N/um"]', '["10 mm", "800 mm"]', "parameters.guide.bounds[0]", "is a length but what it moves is a stiffness"),
        ('["10 N/um", "800 N/um"]', '["10 N/um"]', "parameters.guide.bounds", "has 1 entries but needs at least 2"),
        ("prior_sigma = 0.3", 'prior = "200 mm"\nprior_sigma = 0.3', "parameters.width.prior", "lies outside the bounds"),
        ("prior_sigma = 0.3", 'prior = "30 mm"', "parameters.width.prior_sigma", "is missing"),
        ("prior_sigma = 0.3", 'prior_sigma = "3 mm"', "parameters.width.prior_sigma", "of the logarithm"),
        ("factor = -1", "factor = 0", "parameters.width.keys[1]", "a factor of zero"),
        ('offset = "2 mm"', 'offset = "2 N/um"', "parameters.width.keys[1]", "offset is a stiffness"),
        ('"joints.guide_1.at[1]",', '"joints.guide_1.stiffness.normal",', "parameters.width.keys[0]", "is set by the parameter 'guide'"),
        ('"joints.guide_1.at[1]",', '"components.slider.mass",', "parameters.width.keys[1]", "put it under multiplies"),
        ('"joints.guide_1.at[1]",', '"joints.guide_1.at[3]",', "parameters.width.keys[0]", "joints.guide_1.at holds 3 entries"),
    ],
)  # fmt: skip
def test_a_fault_is_named_with_its_key(
    tmp_path: Path, old: str, new: str, key: str, message: str
) -> None:
    assert old in GOOD
    found = problems(tmp_path, GOOD.replace(old, new, 1))
    matching = [problem for problem in found if problem.key == key and message in problem.message]
    assert matching, "\n".join(str(problem) for problem in found)
    assert all(problem.place.startswith(f"{tmp_path / 'targets.toml'}:") for problem in matching)


def test_the_example_of_the_documentation_is_a_target_file(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "identification.md").read_text()
    (example,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    targets = tmp_path / "targets.toml"
    targets.write_text(example)
    task = load_targets(targets, ROOT / "machines" / "three_axis.toml").task
    assert [len(case.modes) for case in task.cases] == [3, 3]
    assert [len(parameter.rules) for parameter in task.parameters] == [4, 2, 4, 7]


def test_many_unknown_sensors_are_one_problem_with_their_count(tmp_path: Path) -> None:
    vectors = ", ".join(f"s{number} = [0, 1, 0]" for number in range(192))
    (problem,) = problems(tmp_path, GOOD.replace("tcp = [0, 1, 0]", vectors))
    assert problem.key == "cases.a.modes[0].vectors.s0"
    assert problem.message.startswith("192 unknown points 's0', 's1', 's2', ...; points, sensors")


def test_every_fault_is_told_at_once(tmp_path: Path) -> None:
    text = GOOD
    for old, new in (
        ('"stiff"', '"stif"'),
        ('["10 mm", "80', '["90 mm", "80'),
        ("name =", "nome ="),
    ):
        text = text.replace(old, new)
    keys = {problem.key for problem in problems(tmp_path, text)}
    assert keys >= {"nome", "cases.a.variant", "parameters.width.bounds"}


FEET = "".join(
    f'[parameters.feet_{dof}]\nkeys = ["joints.feet.stiffness.{dof}"]\nbounds = ["1 N/um", "900 N/um"]\n'
    for dof in "xyz"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD + FEET, "3 measured value(s) cannot fix 4 parameters without a prior"),
        (GOOD.replace('tolerance = "2 %"', "hold_out = true"), "nothing to fit to"),
    ],
)
def test_fewer_data_than_parameters_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (problem,) = problems(tmp_path, text)
    assert message in problem.message


def test_a_mechanism_is_fitted_in_variants_of_components_only(tmp_path: Path) -> None:
    machines = ROOT / "machines"
    task = load_targets(machines / "tripteor_targets.toml", machines / "tripteor.toml").task
    assert [case.held_out for case in task.cases] == [(True,) * 4, (False,) * 4, (False,) * 4]
    assert [parameter.name for parameter in task.parameters] == ["legs_1_2", "leg_3", "frame"]
    text = (machines / "tripteor_targets.toml").read_text()
    lumped = tmp_path / "targets.toml"
    lumped.write_text(text.replace('"elastic_legs+segmented"', '"lumped"', 1))
    with pytest.raises(SceneError, match="lumped mechanism"):
        load_targets(lumped, machines / "tripteor.toml")
