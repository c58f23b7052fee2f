"""Stability of milling: multipliers by closed forms and in time, and the border of ten scenes
beside limits by independent methods.
"""

import dataclasses
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.special

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.lobes import RPM, PoseLobes
from headstock.pipeline.runner import run_scene
from headstock.scene.building.loader import load_scene
from headstock.solvers.milling.tip_poles import TipDynamics, tip_dynamics
from headstock.solvers.motion.alpha import LinearMotion, Regeneration, integrate_linear
from headstock.solvers.mpi import MPI
from headstock.validation.mechanisms.semi_discretisation import (
    floquet_multipliers,
    largest_multiplier,
    single_frequency_limit,
)
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_order,
    compare_value,
    named_case,
)

SCENES = Path(__file__).parents[1] / "references" / "milling_limits"
# Insperger and Stepan (2004), Int. J. Numer. Meth. Eng. 61, 117-141, sec. 5: one mode, two teeth
MASS, HZ, ZETA, CHIP, NORMAL, TEETH = 0.03993, 922.0, 0.011, 6e8, 2e8, 2
# frequency of chatter over the natural one, waves between two cuts
TURNING = (
    (1.0213, 3),
    (1.0057, 1),
    (1.0471, 5),
)
MATHIEU = ((1.0, 0.05), (0.5, -0.1), (2.0, 0.2))  # parametric excitation, weight of the delay
MARCHED_STEPS = 1600
SLOTTING = ((5000.0, 0.2e-3), (5000.0, 1e-3), (15000.0, 1e-3))  # rpm, depth of cut [m]


def check_stability_methods(comm: MPI.Comm, steps: int = MARCHED_STEPS) -> Iterator[ValidationRow]:
    """Multipliers on borders known in closed form, and of a published milling case by integrating its
    equation in time; limits of ten scenes.
    """
    yield from named_case("stability-closed-forms", [*_turning_rows(), *_mathieu_rows()])
    yield from named_case("stability-published-milling", _milling_rows(steps))
    # one and two modes, immersions of 5 to 100 %, both senses, helix and one to six teeth, beside
    # converged limits by collocation of another program and by semi-discretisation
    limits = tomllib.loads((SCENES / "limits.toml").read_text())
    for name in sorted(limits):
        yield from named_case("milling-limits", _limit_rows(name, limits[name], comm))


def _limit_rows(
    name: str, limits: dict[str, dict[str, list[float]]], comm: MPI.Comm
) -> Iterator[ValidationRow]:
    scene = load_scene(SCENES / f"{name}.toml")
    scene = dataclasses.replace(scene, analyses=scene.analyses.keep(["lobes"]))
    with tempfile.TemporaryDirectory(prefix="headstock-lobes-") as folder:
        results = run_scene(scene, Path(folder), comm=comm)
    (found,) = find_answers(results.answers, PoseLobes)
    for own in found.directions:
        reference = limits[own.name]
        np.testing.assert_allclose(RPM * found.speeds, reference["rpm"], rtol=1e-5)
        true = 1e-3 * np.array(reference["limit_mm"])
        off = own.depths / true - 1.0
        # digits of the table, and ± of the search
        allowed = 1e-4 + np.nan_to_num(own.errors / true)
        where = f"{name}, travel {own.name}, {len(true)} speeds"
        yield compare_bound(
            f"{where}: limit off, at most", np.abs(off).max(), 0.01, "semi-discretisation"
        )
        yield compare_bound(
            f"{where}: limit above the true one, over its ±",
            max(0.0, float((off / allowed).max())),
            1.0,
        )


def _one_mode() -> TipDynamics:
    """Return the single mode of the published case."""
    omega = 2.0 * np.pi * HZ
    mass = MASS * np.eye(1)
    damping = 2.0 * ZETA * omega * MASS * np.eye(1)
    stiffness = MASS * omega**2 * np.eye(1)
    return tip_dynamics(mass, damping, stiffness, forced=np.eye(1))


def _slotting_gain(times: FloatArray, period: float, depth: float) -> FloatArray:
    """``(n,)`` force per motion of two teeth in a full slot, up-milling [N/m]."""
    angle = np.pi * times / period
    # one of two teeth is in the cut at any time
    return (
        -depth
        * (CHIP * np.cos(angle % np.pi) + NORMAL * np.sin(angle % np.pi))
        * np.sin(angle % np.pi)
    )


def _turning_rows() -> Iterator[ValidationRow]:
    """Constant engagement: on the border of the lobes the largest multiplier is one (Tobias;
    Altintas 2012, sec. 4.2).
    """
    tip = _one_mode()
    omega = 2.0 * np.pi * HZ
    for ratio, waves in TURNING:
        chatter = ratio * omega
        response = 1.0 / (MASS * (omega**2 - chatter**2 + 2j * ZETA * omega * chatter))
        gain = 0.5 / response.real  # negative: the force works against the motion
        # exp(-i omega T) = 1 - 1 / (gain response)
        period = (2.0 * np.pi * waves - float(np.angle(1.0 - 1.0 / (gain * response)))) / chatter
        errors = [
            abs(largest_multiplier(tip, np.full((steps * waves, 1, 1), gain), period) - 1.0)
            for steps in (30, 60, 120)
        ]
        name = f"turning at {ratio:g} times the natural frequency, {waves} waves"
        yield compare_bound(f"{name}: multiplier off one", errors[-1], 1e-3)
        yield compare_order(f"{name}: order", errors, 2.0)
        factor = single_frequency_limit(tip, np.full((1, 1, 1), gain), period)
        exact = Target(1.0, "-", 1e-4, "closed form")
        yield compare_value(f"{name}: limit by a single frequency", factor, exact)


def _mathieu_rows() -> Iterator[ValidationRow]:
    """``x'' + (delta + epsilon cos t) x = b x(t - 2 pi)``: borders by Mathieu's characteristic
    values (Insperger and Stepan 2002).
    """
    steps = 300
    times = (np.arange(steps) + 0.5) * 2.0 * np.pi / steps
    for epsilon, weight in MATHIEU:
        for order, sign in ((0, 1.0), (1, -1.0)):
            delta = float(scipy.special.mathieu_a(order, 2.0 * epsilon)) / 4.0 + sign * weight
            tip = TipDynamics(
                np.array([[0.0, 1.0], [-delta, 0.0]]),
                np.array([[0.0], [1.0]]),
                np.array([[1.0, 0.0]]),
                1.0,
            )
            gains = (-epsilon * np.cos(times))[:, None, None]
            found = floquet_multipliers(
                tip, gains, 2.0 * np.pi, past=np.full((steps, 1, 1), -weight)
            )
            off = float(np.abs(found - sign).min())
            name = f"delayed Mathieu equation, epsilon {epsilon:g}, b {weight:g}: a multiplier off {sign:+.0f}"
            yield compare_bound(name, off, 1e-3)


def _milling_rows(steps: int) -> Iterator[ValidationRow]:
    """Return the largest multiplier by semi-discretisation and from the growth of an integrated motion,
    both with so many steps per tooth.
    """
    allowed = 5e-4 * (MARCHED_STEPS / steps) ** 2
    for rpm, depth in SLOTTING:
        period = 60.0 / (TEETH * rpm)
        fine = _slotting_gain((np.arange(steps * 8) + 0.5) * period / (steps * 8), period, depth)
        found = largest_multiplier(
            _one_mode(), fine.reshape(steps, 8).mean(axis=1)[:, None, None], period
        )
        integrated = _integrated_multiplier(period, depth, steps)
        name = f"multiplier, slotting at {rpm:g} rpm, {1e3 * depth:g} mm"
        yield compare_value(name, found, Target(integrated, "-", allowed, "integrated in time"))


def _integrated_multiplier(period: float, depth: float, steps: int, turns: int = 60) -> float:
    """Growth over a period of the two strongest waves in a integrated motion."""
    times = np.arange(steps * turns) * period / steps
    omega = 2.0 * np.pi * HZ

    def both(value: float) -> FloatArray:
        return np.full((2, 1, 1), value)

    tool = np.zeros((2, 3, 1))
    tool[:, 0] = 1.0
    motion = LinearMotion(
        times=times,
        nodes=times[[0, -1]],
        mass=both(MASS),
        damping=both(2.0 * ZETA * omega * MASS),
        stiffness=both(MASS * omega**2),
        tool=tool,
        gravity_deflection=np.zeros((2, 1)),
        load=np.zeros((len(times), 1)),
    )
    kick = np.zeros((len(times), 1))
    kick[1:40] = 1.0
    stiffness = np.zeros((len(times), 3, 3))
    stiffness[:, 0, 0] = _slotting_gain(times, period, depth)
    moved = (
        integrate_linear(motion, kick, regeneration=Regeneration(stiffness, steps))
        .compliant[:, 0]
        .reshape(turns, steps)
    )
    before, now, after = moved[-3], moved[-2], moved[-1]
    first, second = np.linalg.lstsq(np.stack([now, before], axis=1), after, rcond=None)[0]
    return float(np.abs(np.roots([1.0, -first, -second])).max())
