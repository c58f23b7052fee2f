"""Closed-loop poles and figures of drives as rows of text, for the terminal."""

from collections.abc import Iterator

from headstock.app.texts.error_texts import show_damping
from headstock.pipeline.storage.json_texts import Json

Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]


def list_control(pose: str, control: Json) -> Iterator[Table]:
    """Title, headings and rows of each table of a pose; a heading that begins with ``>`` is for numbers."""
    yield (
        f"Closed-loop poles in pose {pose} up to {control['up_to_hz']:g} Hz",
        POLE_HEADINGS,
        [_pole_row(number, pole) for number, pole in enumerate(control["poles"], start=1)],
    )
    speed = 60e3 * control["speed_m_per_s"]
    title = f"Drives in pose {pose}, lag at {speed:g} mm/min"
    yield title, DRIVE_HEADINGS, [_drive_row(name, drive) for name, drive in control["drives"].items()]


POLE_HEADINGS = (">no.", ">Hz", ">damping", ">decays in ms", "drive", "motion")
DRIVE_HEADINGS = (
    "drive", "encoder", ">kv 1/s", ">kp N s/m", ">motor kg", ">lag µm", ">bandwidth Hz", ">gain margin", ">phase margin °", ">max |S|"
)  # fmt: skip


def _pole_row(number: int, pole: Json) -> tuple[str, ...]:
    decay = "grows" if pole["real"] > 0.0 else "never" if pole["real"] == 0.0 else f"{-1e3 / pole['real']:.4g}"
    hz = "0" if pole["frequency_hz"] == 0.0 else f"{pole['frequency_hz']:.3f}"
    return str(number), hz, show_damping(pole["damping_ratio"]), decay, pole["drive"], pole["name"]


def _drive_row(name: str, drive: Json) -> tuple[str, ...]:
    margins = drive["margins"] or {}
    shown = [name, drive["encoder"], f"{drive['kv_per_s']:.4g}", f"{drive['velocity_gain_n_s_per_m']:.4g}"]
    shown += [f"{drive['motor_mass_kg']:.4g}", _number(drive["velocity_lag_um"])]
    return *shown, *(_number(margins.get(key)) for key in ("bandwidth_hz", "gain", "phase_deg", "sensitivity"))


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
