"""Elements of the catalogue in a machine built in Python."""

from pathlib import Path

import numpy as np
import pytest

import headstock as hs
from common import approx
from headstock.scene.reading.keys import read_entries

ENDS = ["slide.bottom", "ground"]
PLACES = [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]


def slide(pads: hs.Joint) -> hs.Machine:
    """A rigid slide on two carriages of a rail along x, and a screw of 100 N/um."""
    body = hs.Component(
        solid=hs.Box(0.3, 0.2, 0.1),
        material="steel",
        fidelity="rigid",
        interfaces={"bottom": hs.Interface(face="z-")},
    )
    drive = hs.Joint(between=ENDS, kind="ball_screw", axis="x", stiffness={"axial": 1e8})
    return hs.Machine(
        name="slide",
        materials={"steel": hs.Material(E="210 GPa", nu=0.3, rho=7850.0)},
        components={"slide": body},
        joints={"pad": pads, "drive": drive},
        points={"tcp": hs.Point(tool="slide.bottom", work="ground")},
        analyses={"static": {"at": "tcp"}},
    )


def test_a_pair_of_carriages_on_a_rail_has_the_stiffness_of_two_springs(tmp_path: Path) -> None:
    guide = "catalogue:guide_35"
    pads = hs.Joint(from_=guide, between=ENDS, axis="x", places=PLACES, loss_factor=0.01)
    assert (pads.kind, pads.from_, pads.loss_factor) == ("linear_guide", guide, 0.01)
    machine = slide(pads)
    values = {key: value.value for key, value in dict(pads.stiffness).items()}  # type: ignore[call-overload]
    arm = 0.1
    expected = [
        1e8,
        2.0 * values["lateral"],
        2.0 * values["normal"],
        2.0 * values["roll"],
        2.0 * (values["pitch"] + values["normal"] * arm**2),
        2.0 * (values["yaw"] + values["lateral"] * arm**2),
    ]
    result = hs.run(machine)
    found = np.linalg.inv(result.compliance["tcp"])
    np.testing.assert_allclose(found, np.diag(expected), rtol=1e-9, atol=1.0)
    (assumed,) = result.assumptions
    assert assumed.startswith("joints.pad: catalogue:guide_35") and "loss_factor" in assumed

    written = machine.save(tmp_path / "slide.toml")
    assert 'from = "catalogue:guide_35"' in written.read_text()
    assert hs.load(written) == machine
    larger = machine.change(set={"joints.pad.from": "catalogue:guide_45"})
    assert larger.scene.machine.joints["pad_1"].stiffness[2, 2] == 630e6


def test_a_body_on_mounts_has_half_their_loss_factor_as_damping_ratio() -> None:
    # one mount in the middle: the vertical mode is a mass on a spring with structural damping
    mount = hs.Joint(from_="catalogue:rubber_mount_2kN", between=ENDS)
    plain = slide(mount)  # for its slide
    damped = hs.Machine(
        materials=read_entries(plain.table, "materials"),
        components=read_entries(plain.table, "components"),
        joints={"mount": mount},
        analyses={"modal": {"count": 6}},
        effects={"damping": True},
    )
    modes = hs.run(damped).modes["reference"]
    mass = 0.3 * 0.2 * 0.1 * 7850.0
    vertical = np.sqrt(1.8e6 / mass) / (2.0 * np.pi)
    (number,) = np.flatnonzero(np.isclose(modes.frequencies_hz, vertical, rtol=1e-9, atol=0.0))
    ratio = modes.damping_ratio[number]
    assert ratio == approx(0.12 / 2.0)


def test_a_joint_of_an_unknown_element_is_refused_in_python() -> None:
    with pytest.raises(hs.SceneError, match="guide_36") as caught:
        hs.Joint(from_="catalogue:guide_36", between=["a.b", "ground"], axis="x")
    assert len(caught.value.problems) == 1
