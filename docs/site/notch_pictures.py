"""Picture of docs/notches.md: ``./headstock exec python3 docs/site/notch_pictures.py``."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

import headstock as hs

mpl.use("Agg")
import matplotlib.pyplot as plt  # behind the choice of its backend

PROJECT = Path(__file__).resolve().parent.parent.parent
PICTURES = {"notch": "|L| of the drive of X, opened at its force"}
GAIN, INTEGRAL, KV, DEAD_TIME, NOTCH_HZ, DAMPING = 3e5, 0.01, 60.0, 3.75e-4, 246.2, 0.1


def main() -> None:
    """Draw the open loop of X with and without a notch, from the machine with free motors."""
    scene = PROJECT / "machines" / "three_axis.toml"
    machine = hs.load(scene, variant="controlled+segmented")
    plant = hs.state_space(machine, hz="1 kHz", motors="free")
    row, column = plant.outputs.index("X motor"), plant.inputs.index("X force")
    hz = np.geomspace(20.0, 600.0, 600)
    s = 2j * np.pi * hz
    states = np.linalg.solve(
        s[:, None, None] * np.eye(len(plant.A)) - plant.A, plant.B[:, [column]] + 0j
    )
    motor = (plant.C[row] @ states)[:, 0]
    loop = GAIN * (1.0 + 1.0 / (INTEGRAL * s)) * (KV + s) * np.exp(-s * DEAD_TIME) * motor
    omega = 2.0 * np.pi * NOTCH_HZ
    notch = (s**2 + omega**2) / (s**2 + 2.0 * DAMPING * omega * s + omega**2)
    figure, axes = plt.subplots(figsize=(7.0, 3.4), dpi=110)
    axes.loglog(hz, abs(loop), label="without a notch")
    axes.loglog(hz, abs(loop * notch), label=f"notch at {NOTCH_HZ:g} Hz")
    axes.axhline(1.0, color="0.6", linewidth=0.8)
    axes.set(xlabel="Hz", ylabel=PICTURES["notch"], xlim=(hz[0], hz[-1]))
    axes.legend()
    axes.grid(alpha=0.3, which="both")
    figure.tight_layout()
    figure.savefig(PROJECT / "docs" / "images" / "notch.png")


if __name__ == "__main__":
    main()
