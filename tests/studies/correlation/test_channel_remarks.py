"""Faults of channels are found and named; clean data raise no alarm."""

from collections.abc import Callable

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.scene.test_data.records import ComplexArray, TestChannel, as_vector
from headstock.studies.correlation.channel_remarks import describe_channel_faults

SENSORS, MODES = 24, 10
CHANNELS = [
    TestChannel(str(point), as_vector(axis))
    for point in range(1, SENSORS + 1)
    for axis in np.eye(3)
]


def draw_shapes(seed: int) -> FloatArray:
    """Smooth shapes at points of which some are close to others ``(c, k)``."""
    rng = np.random.default_rng(seed)
    places = rng.random((SENSORS, 3))
    places[18:] = places[:6] + 0.02 * rng.standard_normal((6, 3))
    x, y, z = places.T
    fields = np.stack(
        [x**0, x, y, z, x * y, y * z, z * x, x**2, y**2, np.sin(4 * x), np.cos(4 * z)]
    )
    shapes = np.einsum("fn,fak->nak", fields, rng.standard_normal((len(fields), 3, MODES)))
    return shapes.reshape(3 * SENSORS, MODES)


def measure(shapes: FloatArray, seed: int) -> ComplexArray:
    """With 5 % noise and a phase per mode."""
    rng = np.random.default_rng(seed)
    noise = (rng.standard_normal(shapes.shape) + 1j * rng.standard_normal(shapes.shape)) / 2**0.5
    sizes = np.sqrt((shapes**2).mean(axis=0))
    phases = np.exp(2j * np.pi * rng.random(shapes.shape[1]))
    return np.asarray((shapes + 0.05 * sizes * noise) * phases, dtype=complex)


def rows_of(*points: int) -> list[int]:
    return [3 * (point - 1) + axis for point in points for axis in range(3)]


def exchange(data: ComplexArray) -> None:
    data[[48, 49]] = data[[49, 48]]


def turn(data: ComplexArray) -> None:
    data[[48, 49]] = [data[49], -data[48]]


def swap(data: ComplexArray) -> None:
    data[rows_of(5, 16)] = data[rows_of(16, 5)]


def swap_cables(data: ComplexArray) -> None:
    data[[13, 46]] = data[[46, 13]]


def reverse(data: ComplexArray) -> None:
    data[20] *= -1.0


def shift(data: ComplexArray) -> None:
    data[rows_of(*range(11, 21))] = data[rows_of(20, *range(11, 20))]


def kill(data: ComplexArray) -> None:
    data[20] *= 0.01


def scale(data: ComplexArray) -> None:
    data[20] *= 9.81


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (exchange, "sensor 17: x and y look exchanged"),
        (turn, "sensor 17 looks turned: its x, y are recorded as "),
        (swap, "sensors 5 and 16 look swapped"),
        (swap_cables, "5:+y and 16:+y look swapped"),
        (reverse, "sensor 7: z looks reversed"),
        (shift, "sensors 11 to 20 look shifted: each is recorded under the number of the next one"),
        (kill, "7:+z looks dead"),
        (scale, "7:+z looks "),
    ],
)
def test_a_single_fault_is_named(fault: Callable[[ComplexArray], None], words: str) -> None:
    shapes = draw_shapes(1)
    data = measure(shapes, 2)
    fault(data)
    (remark,) = describe_channel_faults(data, shapes, CHANNELS)
    assert remark.text.startswith(words)
    assert "MAC of 10 modes rises from 0." in remark.text


def test_faults_of_several_sensors_are_all_named() -> None:
    shapes = draw_shapes(4)
    data = measure(shapes, 5)
    exchange(data)
    swap(data)
    remarks = describe_channel_faults(data, shapes, CHANNELS)
    assert {rows for remark in remarks for rows in remark.rows} == {48, 49, *rows_of(5, 16)}
    assert {remark.text.partition(" look")[0] for remark in remarks} == {
        "sensor 17: x and y",
        "sensors 5 and 16",
    }


def test_clean_data_with_noise_raise_no_alarm() -> None:
    alarms = [
        describe_channel_faults(measure(draw_shapes(seed), 100 + seed), draw_shapes(seed), CHANNELS)
        for seed in range(10)
    ]
    assert alarms == [()] * 10


def test_a_model_that_mixes_modes_is_no_fault_of_channels() -> None:
    shapes = draw_shapes(7)
    mixed = shapes @ (
        np.eye(MODES) + 0.15 * np.random.default_rng(8).standard_normal((MODES, MODES))
    )
    assert describe_channel_faults(measure(mixed, 9), shapes, CHANNELS) == ()


def test_two_shapes_are_too_few_for_a_verdict() -> None:
    shapes = draw_shapes(1)[:, :2]
    data = measure(shapes, 2)
    reverse(data)
    assert describe_channel_faults(data, shapes, CHANNELS) == ()
