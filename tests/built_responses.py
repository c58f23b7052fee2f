"""Frequency responses of oscillators whose modes are known, with noise."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.scene.test_data.records import (
    ComplexArray,
    MeasuredResponses,
    TestChannel,
)


@dataclass(frozen=True, eq=False)
class KnownModes:
    """Modes of a system.

    Attributes:
        hz: ``(k,)`` undamped, increasing.
        damping: ``(k,)``.
        shapes: ``(m, k)`` of modal mass one; the forces act at the first motions.
    """

    hz: FloatArray
    damping: FloatArray
    shapes: FloatArray

    def respond(self, lines_hz: FloatArray, forces: int) -> ComplexArray:
        """Return receptances ``(l, m, forces)``."""
        omega = 2.0 * np.pi * self.hz
        damped = omega * np.sqrt(1.0 - self.damping**2)
        laplace = 2j * np.pi * lines_hz[:, None]
        denominators = (laplace + self.damping * omega) ** 2 + damped**2
        given = (self.shapes, self.shapes[:forces])
        return np.asarray(np.einsum("lk,mk,fk->lmf", 1.0 / denominators, *given))


def space_lines(low: float, high: float, count: int) -> FloatArray:
    """Return frequencies ``(count,)`` of equal distance [Hz]."""
    return np.asarray(np.linspace(low, high, count), dtype=np.float64)


def draw_modes(
    seed: int, count: int = 9, *, motions: int = 20, close: bool = False, most_hz: float = 285.0
) -> KnownModes:
    """Return random modes from 22 Hz on; two within 0.3 % where ``close``."""
    random = np.random.default_rng(seed)
    hz = np.sort(random.uniform(22.0, most_hz, count))
    if close:
        hz[count // 2 + 1] = 1.003 * hz[count // 2]
    damping = random.uniform(0.005, 0.03, count)
    return KnownModes(np.sort(hz), damping, random.normal(size=(motions, count)))


def add_noise(values: ComplexArray, share: float, seed: int) -> ComplexArray:
    """Return responses with noise of one size at all lines, as a share of each pair's rms."""
    random = np.random.default_rng((seed, 1))
    noise = random.normal(size=(2, *values.shape)) / np.sqrt(2.0)
    sizes = np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
    return np.asarray(values + share * sizes * (noise[0] + 1j * noise[1]))


def measure(
    modes: KnownModes, *, noise: float, seed: int, forces: int = 3, lines: int = 600
) -> MeasuredResponses:
    """Return responses from 20 to 300 Hz; force ``i`` acts at point ``i``."""
    hz = space_lines(20.0, 300.0, lines)
    channels = tuple(
        TestChannel(str(number + 1), (0.0, 0.0, 1.0)) for number in range(len(modes.shapes))
    )
    values = add_noise(modes.respond(hz, forces), noise, seed)
    return MeasuredResponses(hz, channels, channels[:forces], values)
