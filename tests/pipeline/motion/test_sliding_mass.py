"""A mass that slides along an arm that tilts: Coriolis forces of linear axes come out of matrices that
change along the path.
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from fixture_machines import stored_scene, write_scene
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.motion.path import run_path_stage
from headstock.pipeline.planning.plan import Stage
from headstock.scene.analyses.path import PathRequest
from headstock.scene.building.loader import load_scene
from scene_runs import start

STIFFNESS = 32000.0  # of the hinge [N m/rad]
SCENE = stored_scene("sliding_mass")


def test_a_mass_slides_along_an_arm_that_tilts_as_lagranges_equation_says(tmp_path: Path) -> None:
    path = write_scene(tmp_path, SCENE, name="arm")
    scene = load_scene(path)
    state = start(scene, tmp_path)
    parts = state.parts.superelements
    (found,) = run_path_stage(state, Stage("path", None, "")).answers
    assert isinstance(found, PathResult)
    curves = found.runs[0].curves
    assert PathRequest in scene.analyses
    move, arm, slider = scene.analyses[PathRequest].moves[0], parts["arm"], parts["slider"]
    mass, height = slider.mass_kg, 0.02 + 0.1  # of its middle over the hinge
    still = arm.inertia[1, 1] + arm.mass_kg * 0.6**2 + slider.inertia[1, 1] + mass * height**2

    ramp, feed = move.ramp.time_constant, move.feed
    # beginning, and speed and acceleration there, of each part of the move
    pieces = [
        (0.0, 0.0, feed / ramp),
        (ramp, feed, 0.0),
        (move.braking, feed, -feed / ramp),
        (move.duration, 0.0, 0.0),
    ]
    times = curves.deviation.times

    def rate(
        time: float,
        state: FloatArray,
        begin: tuple[float, float, float],
        place: float,
        coriolis: float,
    ) -> FloatArray:
        """Of the turn ``phi`` of the arm about y, which leads the slider to ``(s + h phi, h - s phi)``,
        and of its speed.
        """
        low, speed, pull = begin
        since = time - low
        v, s = speed + pull * since, place + speed * since + 0.5 * pull * since**2
        moment = -mass * height * pull - (STIFFNESS + coriolis * mass * s * pull) * state[0]
        moment -= coriolis * 2.0 * mass * s * v * state[1]
        return np.array([state[1], moment / (still + mass * s**2)])

    def tilt(coriolis: float) -> FloatArray:
        state, place, found = np.zeros(2), 0.2, []
        for begin, end in zip(pieces, [*(each[0] for each in pieces[1:]), times[-1]], strict=True):
            low, speed, pull = begin
            run = solve_ivp(
                rate,
                (low, end),
                state,
                args=(begin, place, coriolis),
                rtol=1e-7,
                atol=1e-11,
                max_step=5e-3,
                dense_output=True,
            )
            found.append(run.sol(times[(times >= low) & (times < end)])[0])
            state = run.y[:, -1]
            place += speed * (end - low) + 0.5 * pull * (end - low) ** 2
        return np.append(np.concatenate(found), state[0])

    places = 0.2 + curves.positions
    expected = -places * tilt(1.0)
    size = np.abs(expected).max()
    # terms with the square of the speed are left out: (v / L)^2 over the square of the frequency
    assert np.abs(curves.deviation.total[:, 0] - expected).max() < 6e-3 * size
    without = -places * tilt(0.0)
    assert np.abs(without - expected).max() > 0.1 * size
