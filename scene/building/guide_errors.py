"""Errors of guides and drives: built from their tables, and what may be wrong with them."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.guide_errors import AxisErrors, ErrorProfile, RailErrors, Wave
from headstock.scene.building.draft import Draft
from headstock.scene.building.joints import KINDS
from headstock.scene.reading.findings import Findings, KeyPath
from headstock.scene.reading.units import ANGLE, LENGTH, Dimension, Quantity
from headstock.scene.schema.axes import LEG_KEYS, AxisTable
from headstock.scene.schema.effects import GUIDE_ERRORS
from headstock.scene.schema.guide_errors import (
    MOTION_KEYS,
    RAIL_KEYS,
    AxisErrorsTable,
    ProfileTable,
    RailErrorsTable,
)
from headstock.scene.schema.joints import JointTable
from headstock.scene.schema.scene import SceneTable

# what errors measure
AMOUNTS = {
    key: LENGTH if index < 3 else ANGLE
    for keys in (RAIL_KEYS, MOTION_KEYS)
    for index, key in enumerate(keys)
}
# what each kind of joint that slides holds on to
SLIDING = {
    "linear_guide": RAIL_KEYS[1:],
    "prismatic": RAIL_KEYS[1:],
    "ball_screw": RAIL_KEYS[:1],
}


def build_rail_errors(table: JointTable) -> RailErrors | None:
    """Errors of what a joint slides along; None without any."""
    errors = table.errors
    if errors is None:
        return None
    passing = errors.ball_passing
    waves = {} if passing is None else passing.amplitudes()
    return RailErrors(
        profiles={
            RAIL_KEYS.index(key): _build_profile(profile)
            for key, profile in errors.profiles().items()
        },
        length=errors.length or table.length or 0.0,
        passing={
            RAIL_KEYS.index(key): ErrorProfile(
                waves=(Wave(passing.period, amount.value, passing.phase),)
            )
            for key, amount in waves.items()
            if passing is not None
        },
    )


def build_axis_errors(table: AxisTable) -> AxisErrors | None:
    """Error motions of an axis; None without any."""
    errors = table.errors
    if errors is None:
        return None
    return AxisErrors(
        motions={
            MOTION_KEYS.index(key): _build_profile(profile)
            for key, profile in errors.profiles().items()
        },
        squareness=np.array([*errors.squareness().values()]),
        point=None if errors.at is None else np.array(errors.at),
    )


def build_leg_errors(scene: SceneTable) -> dict[int, ErrorProfile]:
    """Number of a leg of a lumped mechanism to the error of its length, where the effect is on."""
    errors = None if scene.mechanism is None else scene.mechanism.errors
    if errors is None or GUIDE_ERRORS not in scene.active:
        return {}
    return {LEG_KEYS.index(leg): _build_profile(table) for leg, table in errors.profiles().items()}


def _build_profile(table: ProfileTable) -> ErrorProfile:
    """The profile a faultless table stands for."""
    points = table.points
    return ErrorProfile(
        positions=_values([] if points is None else points.at),
        values=_values([] if points is None else points.values),
        coefficients=_values(table.polynomial or []),
        scale=1.0 if table.over is None else table.over.value,
        waves=tuple(
            Wave(wave.period.value, wave.amplitude.value, wave.phase) for wave in table.waves or ()
        ),
    )


def _values(quantities: list[Quantity]) -> FloatArray:
    return np.array([quantity.value for quantity in quantities], dtype=float)


def check_guide_errors(draft: Draft) -> None:
    """Report errors with a wrong unit, errors that move nothing, and the effect without any."""
    scene = draft.table
    for name, joint in scene.joints.items():
        if joint.errors is not None:
            _check_rail(("joints", name, "errors"), joint, joint.errors, draft.findings)
    for name, axis in scene.axes.items():
        if axis.errors is not None:
            _check_axis(("axes", name, "errors"), axis, axis.errors, draft.findings)
    errors = None if scene.mechanism is None else scene.mechanism.errors
    legs = {} if errors is None else errors.profiles()
    for leg, profile in legs.items():
        _check_profile(("mechanism", "errors", leg), profile, LENGTH, LENGTH, draft.findings)
    if GUIDE_ERRORS not in scene.active:
        return
    if scene.is_lumped:
        if not legs:
            draft.add(
                ("effects", GUIDE_ERRORS),
                'the legs of the lumped mechanism have no errors; describe them in [mechanism.errors], or write model = "components"',
            )
        return
    if all(joint.errors is None for joint in scene.joints.values()) and all(
        axis.errors is None for axis in scene.axes.values()
    ):
        draft.add(
            ("effects", GUIDE_ERRORS),
            "no guide, drive or axis has errors; describe them in [joints.NAME.errors] or [axes.NAME.errors]",
        )


def _check_rail(
    key: KeyPath, joint: JointTable, errors: RailErrorsTable, findings: Findings
) -> None:
    directions = SLIDING.get(joint.kind)
    if directions is None:
        findings.add(
            key,
            f"a {joint.kind} slides along nothing; give the errors to a linear_guide, a prismatic joint or a ball_screw",
        )
        return
    profiles = errors.profiles()
    passing = {} if errors.ball_passing is None else errors.ball_passing.amplitudes()
    for name in profiles:
        _check_direction((*key, name), name, joint, directions, findings)
        _check_profile((*key, name), profiles[name], LENGTH, AMOUNTS[name], findings)
    for name, amount in passing.items():
        part = (*key, "ball_passing", name)
        _check_direction(part, name, joint, directions, findings)
        _check_dimension(part, amount, AMOUNTS[name], findings)
    if not profiles and not passing:
        findings.add(
            key,
            'holds no error; write for example normal = { waves = [{ period = "400 mm", amplitude = "1 um" }] }',
        )


def _check_direction(
    key: KeyPath, name: str, joint: JointTable, directions: tuple[str, ...], findings: Findings
) -> None:
    if name not in directions:
        findings.add(
            key,
            f"a {joint.kind} moves freely in this direction; its errors are {', '.join(directions)}",
        )
        return
    dof = RAIL_KEYS.index(name)
    rule = KINDS[joint.kind]
    if dof in rule.fixed:
        return
    if not any(dof in rule.keys[given] for given in joint.stiffness if given in rule.keys):
        findings.add(
            key,
            f'moves nothing, since the joint has no stiffness there; write stiffness = {{ {name} = "..." }}, or remove it',
        )


def _check_axis(key: KeyPath, axis: AxisTable, errors: AxisErrorsTable, findings: Findings) -> None:
    profiles = errors.profiles()
    for name, profile in profiles.items():
        position = LENGTH if axis.kind == "linear" else ANGLE
        _check_profile((*key, name), profile, position, AMOUNTS[name], findings)
    square = [name for name, angle in errors.squareness().items() if angle]
    if square and axis.kind != "linear":
        findings.add(
            (*key, square[0]),
            'turns the line of a linear axis; of a rotary one write EA or EB as a constant: polynomial = ["10 urad"]',
        )
    if not profiles and not square:
        findings.add(key, 'holds no error; write for example EC0 = "20 urad", or EY = { ... }')


def _check_profile(
    key: KeyPath, table: ProfileTable, position: Dimension, amount: Dimension, findings: Findings
) -> None:
    for part, quantity in table.positions():
        _check_dimension((*key, *part), quantity, position, findings)
    for part, quantity in table.amounts():
        _check_dimension((*key, *part), quantity, amount, findings)


def _check_dimension(key: KeyPath, value: Quantity, wanted: Dimension, findings: Findings) -> None:
    if value.dimension != wanted:
        example = "1 um" if wanted == LENGTH else "10 urad"
        findings.add(
            key,
            f'is not {"a length" if wanted == LENGTH else "an angle"}; write for example "{example}"',
        )
