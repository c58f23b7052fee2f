"""The profile that the teeth of a mill leave on a straight face, and its parameters.

Every tooth draws a trochoid: its cutting edge turns about the axis of the tool while the axis goes
along the face, vibrates and is pushed off. What lies on the part's side of every trochoid stays:
the profile is their lower envelope, tooth by tooth and exact, without any raster. On a rigid
machine it is the row of cusps of Martellotti (1941), of height ``f_z^2 / (8 R)`` in the limit of
small feeds.

Parameters are those of ISO 21920-2 (ISO 4287 before): waviness by the Gaussian filter of ISO
16610-21, roughness is the rest; the form removed is the straight line of least squares.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # whose interpolation and filters, a third of a second, are loaded where they are used
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import EndMill, Sense, spin_of

SAMPLES_PER_CUSP = 32.6  # no whole number: samples come close to the peak of some cusp
NEWTON_STEPS = 3
MOST_TEETH = 200  # that may have left a place, on either side of it
SLACK = 1.5  # of the time in which a tooth turns, over that of a small angle
CUT_OFF_SIGMA = np.sqrt(np.log(2.0) / 2.0) / np.pi  # of the Gaussian with transmission 1/2
FEWEST_WAVES = 10  # in the evaluation length: what is longer is form
CHUNK = 8192


@dataclass(frozen=True, eq=False)
class ToolMotion:
    """The axis of a tool beside a straight face.

    Attributes:
        times: ``(n,)`` rising [s].
        along: ``(n,)`` from the start of the face in the direction of travel [m].
        outward: ``(n,)`` distance from the nominal face, on the side of the tool [m].
    """

    times: FloatArray
    along: FloatArray
    outward: FloatArray


@dataclass(frozen=True)
class ProfileParameters:
    """What is measured on a profile, all in metres.

    Attributes:
        location: Mean of the profile: by how much too much material is left.
        ra: Arithmetic mean height of the roughness profile.
        rz: Mean over section lengths of the height between highest peak and lowest valley of the
            roughness profile.
        wt: Total height of the waviness profile.
        pt: Total height of the profile without its form.
        wavelength: Of the strongest wave that is longer than the marks of the teeth.
    """

    location: float
    ra: float
    rz: float
    wt: float
    pt: float
    wavelength: float
    wave: float


def mill_profile(
    mill: EndMill,
    spindle: float,
    motion: ToolMotion,
    positions: FloatArray,
    height: float = 0.0,
    *,
    sense: Sense = "down",
) -> FloatArray:
    """Profile ``(k,)`` of a milled face at one height: how far it is outward of the nominal face
    [m].

    Angles are those of :mod:`headstock.solvers.milling.forces`.

    Args:
        spindle: Its speed [rad/s].
        positions: ``(k,)`` rising, along the face from its start [m].
        height: Above the lower end of the tool [m].
        sense: Milling down an edge passes the face against the travel, milling up along it.

    Raises:
        ModelError: The tool does not advance, its motion does not reach over the positions, or it
            vibrates so strongly that too many teeth may have left a place.
    """
    along = scipy.interpolate.CubicSpline(motion.times, motion.along)
    outward = scipy.interpolate.CubicSpline(motion.times, motion.outward)
    spin = spin_of(sense)
    passes, teeth = _tooth_passes(mill, spindle, motion.times, height, spin)
    places = along(passes)
    if len(places) < 2 or not (np.diff(places) > 0.0).all():
        raise ModelError("the tool does not advance along the face from tooth to tooth")
    radius = 0.5 * mill.diameter
    radii = radius + mill.runout * np.cos(
        2.0 * np.pi * np.arange(mill.teeth) / mill.teeth + mill.runout_angle
    )
    if not places[0] < positions[0] <= positions[-1] < places[-1]:
        raise ModelError(
            f"the motion of the tool covers {1e3 * places[0]:.4g} to {1e3 * places[-1]:.4g} mm of the face, not all of"
            f" {1e3 * positions[0]:.4g} to {1e3 * positions[-1]:.4g} mm"
        )
    rates, speeds = np.abs(outward.derivative()(passes)), np.abs(along.derivative()(passes))
    parts = []
    for start in range(0, len(positions), CHUNK):
        wanted = positions[start : start + CHUNK]
        first, last = np.searchsorted(places, [wanted[0] - radius, wanted[-1] + radius])
        near = slice(int(first), int(last))
        teeth_near = _ToothPasses(
            places[near],
            passes[near],
            outward(passes[near]),
            radii[teeth[near]],
            float(rates[near].max()),
            float(speeds[near].max()),
        )
        parts.append(_lowest_edges(spin * spindle, along, outward, teeth_near, wanted))
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class _ToothPasses:
    """Teeth as they point at the face.

    Attributes:
        places: ``(p,)`` of the tool's axis along the face, rising [m].
        times: ``(p,)`` [s].
        outward: ``(p,)`` distance of the axis from the face [m].
        radii: ``(p,)`` of the teeth [m].
        rate: Fastest motion of the axis across the face [m/s].
        speed: Fastest motion along it [m/s].
    """

    places: FloatArray
    times: FloatArray
    outward: FloatArray
    radii: FloatArray
    rate: float
    speed: float


def _lowest_edges(
    spindle: float,
    along: "scipy.interpolate.CubicSpline",
    outward: "scipy.interpolate.CubicSpline",
    passes: _ToothPasses,
    positions: FloatArray,
) -> FloatArray:
    """Lower envelope of the trochoids: teeth further and further off, while one can still be deeper
    than those before; a spindle below zero mills up.
    """
    after = np.clip(np.searchsorted(passes.places, positions), 1, len(passes.places) - 1)
    found = np.full(len(positions), np.inf)
    lowest, largest = float(passes.outward.min()), float(passes.radii.max())
    # milling up, the axis goes with the edge, which so reaches further than a circle: by at most its
    # way in a quarter of a turn
    wider = 1.0
    if spindle < 0.0:
        wider += 0.5 * np.pi * passes.speed / (abs(spindle) * float(passes.radii.min()))
    for shift in range(MOST_TEETH):
        nearest = np.inf
        for number in (after + shift, after - 1 - shift):
            inside = (number >= 0) & (number < len(passes.places))
            number = np.where(inside, number, 0)
            distance = np.abs(passes.places[number] - positions)
            # a circle, deeper by as much as the axis moves while the tooth turns to the place
            reached = np.sqrt(np.maximum(passes.radii[number] ** 2 - (distance / wider) ** 2, 0.0))
            slack = passes.rate * distance / (abs(spindle) * passes.radii[number]) * SLACK
            deeper = inside & (passes.outward[number] - reached - slack < found)
            if deeper.any():
                some = number[deeper]
                edge = _edge_heights(
                    spindle,
                    along,
                    outward,
                    radii=passes.radii[some],
                    passes=passes.times[some],
                    positions=positions[deeper],
                )
                found[deeper] = np.minimum(found[deeper], edge)
            nearest = min(nearest, float(distance[inside].min(initial=np.inf)))
        reach = np.sqrt(max(largest**2 - min(nearest / wider, largest) ** 2, 0.0))
        slack_left = passes.rate * nearest / (abs(spindle) * largest) * SLACK
        if lowest - reach - slack_left > found.max():
            return found
    raise ModelError(
        f"the tool moves by {1e6 * np.ptp(passes.outward):.3g} µm across the face, so that more than {2 * MOST_TEETH} teeth may have left a place"
    )


def _tooth_passes(
    mill: EndMill, spindle: float, times: FloatArray, height: float, spin: float
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Times ``(k,)`` at which teeth point at the face, and which teeth ``(k,)``."""
    # theta = -spin (spindle t + lag - twist) is -pi/2 then; the lag of tooth j is 2 pi j / teeth
    pitch = 2.0 * np.pi / mill.teeth
    start = 0.5 * np.pi * spin + 2.0 * height * np.tan(mill.helix) / mill.diameter
    first = int(np.ceil((spindle * times[0] - start) / pitch))
    last = int(np.floor((spindle * times[-1] - start) / pitch))
    numbers = np.arange(first, last + 1)
    return np.asarray((start + pitch * numbers) / spindle), np.asarray(-numbers % mill.teeth)


def _edge_heights(
    spindle: float,
    along: "scipy.interpolate.CubicSpline",
    outward: "scipy.interpolate.CubicSpline",
    *,
    radii: FloatArray,
    passes: FloatArray,
    positions: FloatArray,
) -> FloatArray:
    """Where the edge of one tooth each is across the face as it passes positions ``(k,)``."""
    speed = along.derivative()
    # s = along(t) - r sin(psi), psi = spindle (t - pass)
    angle = np.zeros(len(positions))
    for _ in range(NEWTON_STEPS):
        times = passes + angle / spindle
        off = along(times) - radii * np.sin(angle) - positions
        angle = angle - off / (speed(times) / spindle - radii * np.cos(angle))
    return outward(passes + angle / spindle) - radii * np.cos(angle)


def waviness_profile(profile: FloatArray, spacing: float, cut_off: float) -> FloatArray:
    """Mean line ``(k,)`` of a profile: the Gaussian filter of ISO 16610-21, which halves waves as
    long as the cut-off; at the ends the weights that are left count.

    Args:
        profile: ``(k,)`` at even positions [m].
        spacing: Of the positions [m].
        cut_off: Wavelength lambda c [m].
    """
    sigma = CUT_OFF_SIGMA * cut_off / spacing

    def smooth(values: FloatArray) -> FloatArray:
        return scipy.ndimage.gaussian_filter1d(values, sigma, mode="constant", truncate=6.0)

    return smooth(profile) / smooth(np.ones(len(profile)))


def measure_profile(
    profile: FloatArray, spacing: float, cut_off: float, inside: slice, shortest_wave: float
) -> ProfileParameters:
    """Parameters of a profile over its evaluation length.

    Args:
        profile: ``(k,)`` at even positions, also beyond the evaluation length [m].
        spacing: Of the positions [m].
        cut_off: Wavelength lambda c between roughness and waviness, also the section length [m].
        shortest_wave: Waves of the profile are looked for above this length [m].

    Raises:
        ModelError: The evaluation length is shorter than one section.
    """
    waviness = waviness_profile(profile, spacing, cut_off)[inside]
    heights = profile[inside]
    section = round(cut_off / spacing)
    count = len(heights) // section
    if count < 1:
        raise ModelError(
            f"the evaluation length of {1e3 * spacing * len(heights):.3g} mm is shorter than the cut-off of {1e3 * cut_off:g} mm"
        )
    roughness = heights - waviness
    sections = roughness[: count * section].reshape(count, section)
    places: FloatArray = np.asarray(np.arange(len(heights)) * spacing)
    wavelength, wave = _strongest_wave(_remove_line(places, heights), spacing, shortest_wave)
    return ProfileParameters(
        location=float(heights.mean()),
        ra=float(np.abs(roughness).mean()),
        rz=float(np.ptp(sections, axis=1).mean()),
        wt=float(np.ptp(_remove_line(places, waviness))),
        pt=float(np.ptp(_remove_line(places, heights))),
        wavelength=wavelength,
        wave=wave,
    )


def _remove_line(places: FloatArray, heights: FloatArray) -> FloatArray:
    return np.asarray(
        heights - np.polynomial.Polynomial.fit(places, heights, 1)(places), dtype=float
    )


def _strongest_wave(heights: FloatArray, spacing: float, shortest: float) -> tuple[float, float]:
    """Length and amplitude of the strongest line of a profile, in a Hann window; zeros where none
    is long enough.
    """
    window = np.hanning(len(heights))
    lines = 2.0 * np.abs(np.fft.rfft(window * heights)) / window.sum()
    per_length = np.fft.rfftfreq(len(heights), spacing)
    wanted = per_length < 1.0 / shortest
    wanted[:FEWEST_WAVES] = False
    if not wanted.any():
        return 0.0, 0.0
    strongest = int(np.argmax(np.where(wanted, lines, 0.0)))
    return float(1.0 / per_length[strongest]), float(lines[strongest])
