"""Frequency response between points, interfaces and probes."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from headstock.scene.building.draft import (
    Draft,
    SceneAnalysis,
)
from headstock.scene.building.drives import check_motors, check_sampling
from headstock.scene.exports import ExportMotors
from headstock.scene.reading.findings import KeyPath
from headstock.scene.scene import LOAD, Request
from headstock.scene.schema import types
from headstock.scene.schema.effects import GRAVITY_STIFFENING
from headstock.solvers.control.drive_trains import (
    COMMAND,
    DRIVE_CHANNELS,
    FORCE,
    ROTARY_CHANNELS,
)
from headstock.solvers.second_order import Channel, Motion

KEY: KeyPath = ("analyses", "frf")
Channels = Annotated[list[types.ChannelName], Field(min_length=1, max_length=100)]


@dataclass(frozen=True)
class FrfRequest(Request):
    """Frequency response between input and output channels, in named poses.

    Attributes:
        inputs: Where loads act: ``(point or component.interface, direction)``, or a load of the
            scene as ``(name, LOAD)``.
        outputs: Where motion is wanted.
        probes: Where displacement and stress are wanted.
        from_hz: Lowest frequency [Hz].
        to_hz: Highest frequency [Hz].
        adaptive: Add points around every resonance.
        motion: What is tabled and drawn.
        poses: All of them when empty.
        motors: Locked, under control or free.
        fields_at: Frequencies at which volume meshes get displacement and stress [Hz].
    """

    analysis: ClassVar[str] = "frf"

    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    to_hz: float
    probes: tuple[str, ...] = ()
    from_hz: float = 0.0
    points: int = 401
    spacing: Literal["linear", "log"] = "linear"
    adaptive: bool = True
    motion: Motion = "receptance"
    poses: tuple[str, ...] = ()
    motors: ExportMotors = "locked"
    fields_at: tuple[float, ...] = ()

    @property
    def loaded_places(self) -> tuple[str, ...]:
        """Return names of its inputs."""
        return tuple(name for name, _ in self.inputs)

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        entries = f"{len(self.outputs)} × {len(self.inputs)} responses"
        words = {"controlled": ", drives under control", "free": ", motors free"}
        under = words.get(self.motors, "")
        inside = f", displacement and stress at {', '.join(self.probes)}" if self.probes else ""
        return f"{self.motion}, {entries} from {self.from_hz:g} to {self.to_hz:g} Hz{under}{inside}"


class _FrfTable(types.RequestTable):
    """Frequency response between points, or interfaces, from one frequency to another."""

    highest: ClassVar[str] = "up_to"
    loads_probes = "by itself"

    inputs: Channels | None = None
    """where loads act: `[["tcp", "x"]]`, a point or `component.interface` and one of `x y z rx ry rz`; a name alone means x, y and z; or a
    load of `[loads]`, as large as it is there; `["X", "force"]` of a drive, `["X", "command"]` of an axis under control; of a rotary one
    `torque` and `command_angle`; default: all points"""
    outputs: Channels | None = None
    """where motion is computed, points and interfaces as in `inputs`, `["X", "motor"]` and `["X", "scale"]` of a drive, of a rotary one
    `motor_angle` and `scale_angle`, and probes by name; default: the inputs, for loads all points, and all probes"""
    start: Annotated[types.Frequency, Field(alias="from")] = 0.0
    """lowest frequency; the value at 0 Hz is the static compliance"""
    up_to: types.PositiveFrequency
    """highest frequency; fixed-interface modes are kept up to twelve times this"""
    points: Annotated[types.WholeNumber, types.Between(2, 100_000)] = 401
    """number of frequencies of the regular grid"""
    spacing: Literal["linear", "log"] = "linear"
    """spacing of the regular grid"""
    adaptive: types.Flag = True
    """adds points around every resonance, from its half-power width outwards"""
    motion: Literal["receptance", "mobility", "accelerance"] = "receptance"
    """quantity in tables and charts; `results.h5` always holds receptances"""
    motors: ExportMotors = "locked"
    """`locked`: motors hold their position; `controlled`: the loops of all drives are closed; `free`: they are open; with the effect
    `drive_control`"""
    fields_at: tuple[types.PositiveFrequency, ...] = ()
    """frequencies at which `run --volume` writes displacement and stress of elastic components under every input"""
    poses: types.Names | None = None
    """poses in which it is computed; default: all of them"""

    def _faults(self) -> Iterator[str]:
        beyond = [hz for hz in self.fields_at if hz > self.up_to]
        if beyond:
            yield f"`fields_at` has {beyond[0]:g} Hz, beyond `up_to` = {self.up_to:g} Hz, up to which modes are kept; write a higher `up_to`"
        if self.start >= self.up_to:
            yield f"begins at {self.start:g} Hz and ends at {self.up_to:g} Hz; write a lower `from`"
        if self.spacing == "log" and self.start == 0.0:
            yield 'a log spacing cannot begin at 0 Hz; write from = "1 Hz"'


def _build(table: _FrfTable, draft: Draft) -> FrfRequest:
    """Build the request: between all points in all poses unless the table names some."""
    scene = draft.table
    every = [(name, "") for name in scene.points]
    inputs = draft.build_channels(
        [(n, LOAD if n in scene.loads else d) for n, d in table.inputs or every]
    )
    moved = tuple(one for one in inputs if one[1] not in (LOAD, *DRIVE_CHANNELS))
    outputs, probes = draft.split_outputs(table.outputs)
    return table.fill(
        FrfRequest,
        inputs=inputs,
        outputs=outputs or moved or draft.build_channels(every),
        probes=probes,
        to_hz=table.up_to,
        from_hz=table.start,
        poses=tuple(table.poses or draft.poses),
        fields_at=tuple(dict.fromkeys(table.fields_at)),
    )


def _check(table: _FrfTable, draft: Draft) -> None:
    """Report names that mean nothing."""
    for key, channels in (("inputs", table.inputs), ("outputs", table.outputs)):
        for index, (name, direction) in enumerate(channels or ()):
            place = (*KEY, key, index)
            if direction in DRIVE_CHANNELS:
                _check_drive_channel(place, name, direction, table, draft)
            elif key == "inputs" and name in draft.sections.get("loads", ()):
                _check_load_input(place, name, direction, table, draft)
            elif key == "outputs":
                draft.check_output(place, name, direction)
            else:
                draft.check_channel(place, name, direction, "loads")


def _check_drive_channel(
    key: KeyPath, name: str, direction: str, table: _FrfTable, draft: Draft
) -> None:
    """Report a channel of a drive that there is not, or that cannot be seen."""
    plain, drives = ROTARY_CHANNELS.get(direction, direction), draft.table.drives
    axis = name
    if plain == COMMAND:
        moved = [drive.axis or one for one, drive in drives.items()]
        draft.findings.check_name(key, name, moved, "driven axis", "axes with drives")
    else:
        draft.check_name(key, name, "drives")
        axis = drives[name].axis or name if name in drives else name
    found = draft.table.axes.get(axis)
    rotary = found is not None and found.kind == "rotary"
    if fault := _find_drive_fault(plain, table, is_input="inputs" in key):
        draft.add(key, fault)
    elif rotary == (direction == plain):
        words = {linear: turned for turned, linear in ROTARY_CHANNELS.items()}
        how, word = ("turns", words[plain]) if rotary else ("moves along a line", plain)
        draft.add(key, f'{name} {how}; write "{word}"')


def _find_drive_fault(plain: str, table: _FrfTable, *, is_input: bool) -> str:
    """Return why a channel of a drive is none of the request; empty where it is one."""
    if (plain in (FORCE, COMMAND)) != is_input:
        return "force and command of a drive are inputs, motor and scale are outputs; exchange them"
    if table.motors == "locked":
        return 'is a channel of a drive, whose motor is locked; write motors = "free"'
    if plain == COMMAND and table.motors == "free":
        return 'is a set point, which free motors ignore; write motors = "controlled"'
    return ""


def _check_load_input(
    key: KeyPath, name: str, direction: str, table: _FrfTable, draft: Draft
) -> None:
    if name in draft.table.points:
        draft.add(key, f"{name} is a point and a load; rename one of them")
    elif direction:
        draft.add(key, f'a load has its direction; write "{name}" alone')
    outputs = [one for one, _ in table.outputs or () if one not in draft.table.probes]
    if not (draft.table.points or outputs):
        draft.add(
            key,
            'there is no output for it at a point or an interface; write outputs = [["tcp", "z"]], or [points]',
        )


def _check_complete(table: _FrfTable, draft: Draft) -> None:
    """Report that there is nothing to take a response of, and drives that cannot follow it."""
    if table.inputs is None and not draft.table.points:
        draft.add(
            KEY,
            'there is no point to take a response at; write [points], or inputs = [["tcp", "x"]]',
        )
    if table.motors != "locked":
        check_motors(draft, "frf")
    if table.motors == "free" and GRAVITY_STIFFENING in draft.table.active:
        draft.add(
            (*KEY, "motors"), "free motors let the machine fall; leave out gravity_stiffening"
        )
    if table.motors == "controlled":
        check_sampling(draft, table.up_to, "frf", "up_to")


ANALYSIS = SceneAnalysis(
    _FrfTable,
    FrfRequest,
    "frequency responses, see [frequency response](frequency_response.md)",
    build=_build,
    check=_check,
    check_complete=_check_complete,
)
