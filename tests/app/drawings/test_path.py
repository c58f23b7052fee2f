"""The path in the report and in tables: curves with their ramps shaded, thinned without losing a
peak.
"""

import re

import numpy as np

from headstock.app.drawings.path import draw_path
from headstock.app.texts.curves import thin_curve
from headstock.app.views.path import _path_stem, _tabulate_path
from headstock.pipeline.answers.path import PathCurves
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.set_points import Ramp, SetPoint, sample_move

CHANNELS = (("tcp", "z"), ("tcp", "rx"))


def make_curves(feed: float) -> PathCurves:
    move = SetPoint(0.08, feed, Ramp("linear", 0.1))
    times = np.arange(0.0, move.duration + 0.3, 4e-4, dtype=np.float64)
    motion = sample_move(move, times)
    quasi_static = np.column_stack([-3e-7 * motion.accelerations, 1e-7 * motion.accelerations])
    rings = 1e-7 * np.column_stack([np.sin(500.0 * times), np.cos(500.0 * times)])
    deviation = PathDeviation(
        times, quasi_static + rings, quasi_static, np.zeros_like(quasi_static), rings
    )
    return PathCurves(
        feed,
        move.zones,
        CHANNELS,
        deviation,
        quasi_static + rings,
        motion.positions,
        motion.accelerations,
        drives=("Z",),
        torques=rings[:, :1],
        position_errors=rings[:, 1:],
    )


def test_a_table_has_a_row_per_sample_and_its_parts_add_up() -> None:
    table = _tabulate_path(make_curves(0.05))
    assert table.name == "path_3000"
    assert table.headings[3:7] == (
        "deviation tcp z [um]",
        "quasi-static tcp z [um]",
        "low-frequency tcp z [um]",
        "residual vibration tcp z [um]",
    )
    rows = np.array(table.rows)
    assert rows.shape == (5000, 3 + 2 * 5 + 2)
    np.testing.assert_allclose(rows[:, 3], rows[:, 4:7].sum(axis=1), atol=1e-15)
    np.testing.assert_allclose(rows[:, 8], rows[:, 9:12].sum(axis=1), atol=1e-15)


def test_a_thinned_curve_keeps_its_ends_and_its_peaks() -> None:
    x = np.linspace(0.0, 1.0, 20_001, dtype=np.float64)
    y = np.sin(900.0 * x)
    y[12_345] = 3.0
    thin = thin_curve(x, y, 300)
    assert len(thin[0]) <= 602
    assert (thin[0][0], thin[0][-1]) == (0.0, 1.0)
    assert thin[1].max() == 3.0
    assert (np.diff(thin[0]) > 0.0).all()
    np.testing.assert_array_equal(thin_curve(x[:100], y[:100], 300)[0], x[:100])


def test_the_drawing_shades_both_ramps_and_shows_every_feed() -> None:
    text = str(draw_path([make_curves(0.01), make_curves(0.05)], 0, "path_0"))
    # the path, and for each feed the whole move with both ramps and a closer look at each
    assert text.count("<rect") == 2 + 2 * (2 + 1 + 1)
    assert text.count("<polyline") == 2 + 2 * (2 + 3 + 3)
    for word in ("600 mm/min", "3000 mm/min", "accelerating", "decelerating", "magnified", "tcp z"):
        assert word in text
    assert not re.search(r"nan|inf", text.replace("infinite", ""))


def test_stems_of_odd_feeds_are_file_names() -> None:
    assert [_path_stem(feed) for feed in ("600 mm/min", "1234.5 deg/min")] == [
        "path_600",
        "path_1234_5",
    ]
