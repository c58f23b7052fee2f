"""A scene while it is checked: tables that passed the schema, the names and files they refer to,
and checks of names and channels.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from headstock.geometry.frames import DIRECTIONS
from headstock.geometry.machine.joints import GROUND, JointEnd
from headstock.geometry.machine.machine import Sensor
from headstock.geometry.mechanisms.exechon import TOOL_AXES
from headstock.geometry.parts.solids import Solid
from headstock.scene.expansion.overrides import split_variant
from headstock.scene.reading.csv_files import AxisPath
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Findings, KeyPath, suggest_names
from headstock.scene.reading.names import NAMES
from headstock.scene.scene import Request, Scene
from headstock.scene.schema.scene import SceneTable, load_record
from headstock.scene.schema.types import RequestTable
from headstock.scene.studies import Sweep
from headstock.solvers.control.drive_trains import DRIVE_CHANNELS
from headstock.solvers.second_order import Channel


@dataclass(frozen=True, eq=False)
class Draft:
    """What the checks of a scene look at.

    Names are those that are written, so that a broken entry does not make everything that refers to
    it look wrong too.

    Attributes:
        table: Entries that passed the schema.
        raw: The scene in full, after its variant and overrides.
        written: The same as it is written, in short where it is: what overrides reach.
        folder: Of the scene file, for the files it refers to.
        sections: Section name to entry names.
        interfaces: Component name to interface names; None where only a file knows them.
        solids: By component, as far as they can be built.
        paths: Way of each sweep that names a file, where it could be read.
        sensors: Sensors and point masses by name, as far as they could be built.
        findings: What is wrong, so far.
    """

    table: SceneTable
    raw: TomlTable
    written: TomlTable
    folder: Path
    sections: Mapping[str, frozenset[str]]
    interfaces: Mapping[str, frozenset[str] | None]
    solids: Mapping[str, Solid]
    paths: Mapping[str, AxisPath]
    sensors: Mapping[str, Sensor]
    findings: Findings

    @property
    def poses(self) -> tuple[str, ...]:
        """Names of the poses; a scene that names none has one, ``reference``."""
        return tuple(self.table.poses) or ("reference",)

    def add(self, key: KeyPath, message: str) -> None:
        """Report a problem at a key."""
        self.findings.add(key, message)

    def check_name(self, key: KeyPath, name: str, section: str, kind: str = "") -> None:
        """Report a name that is no entry of its section.

        Args:
            section: Of the scene: ``joints``, say.
            kind: Word for an entry; that of the section in the singular when empty.
        """
        word = "axis" if section == "axes" else section.removesuffix("s")
        names = self.sections.get(section, frozenset())
        self.findings.check_name(key, name, names, kind or word, section)

    def check_end(self, key: KeyPath, end: JointEnd) -> None:
        """Report an end that means neither ground nor an interface of a component."""
        component, interface = end.component, str(end.interface)
        if component is None:
            return
        if component not in self.interfaces:
            names = [*self.interfaces, GROUND]
            self.findings.check_name(key, component, names, "component", "components")
            return
        interfaces = self.interfaces[component]
        if interfaces is not None and interface not in interfaces:
            hint = (
                suggest_names(interface, interfaces, what=f"interfaces of {component}")
                if interfaces
                else f"{component} has none"
            )
            part = self.table.components.get(component)
            given = part is not None and part.solid.point_mass is not None  # its only one
            remedy = f'; describe it: [components.{component}.interfaces] {interface[:80]} = {{ face = "z+" }}'
            self.add(
                key,
                f"component {component!r} has no interface {interface[:80]!r}; {hint}{'' if given else remedy}",
            )

    def check_channel(
        self, key: KeyPath, name: str, direction: str = "", section: str = ""
    ) -> None:
        """Report a channel that is at neither a point nor a sensor nor ``component.interface``, and a
        direction that a sensor does not measure.

        Args:
            section: Another one of the scene whose entries could be meant.
        """
        component, dot, interface = name.partition(".")
        if direction in DRIVE_CHANNELS:
            self.add(
                key,
                f"{direction!r} is a channel of a drive, for [analyses.frf] with free or controlled motors; write one of x, y, z, rx, ry, rz",
            )
        elif component in self.sections.get("sensors", ()):
            self._check_sensor(key, name, direction)
        elif dot:
            self.check_end(key, JointEnd(component, interface))
        else:
            more = "; or a sensor" if self.sensors else ""
            others = self.sections.get(section, ())
            names = [*self.sections.get("points", ()), *self.sections.get("sensors", ()), *others]
            what = f"points and {section}" if others else "points"
            self.findings.check_name(key, name, names, "point", what, more)

    def check_point(self, key: KeyPath, name: str) -> None:
        """Report what is neither a point nor a sensor that measures x, y and z."""
        if name not in self.sensors:
            names = [*self.sections.get("points", ()), *self.sensors]
            self.findings.check_name(key, name, names, "point", "points")
            return
        if lacking := [one for one in DIRECTIONS if one not in self.sensors[name].directions]:
            self.add(key, describe_unmeasured(self.sensors[name], lacking[0]))

    def _check_sensor(self, key: KeyPath, name: str, direction: str) -> None:
        named = _select_sensors(self.sensors, name)
        entry, dot, _ = name.partition(".")
        if not named and dot and entry in self.table.sensors:
            names = [one for one in self.sensors if one.startswith(f"{entry}.")]
            self.findings.check_name(key, name, names, "sensor", "sensors")
        if named and direction and not any(direction in one.directions for one in named):
            self.add(key, describe_unmeasured(named[0], direction))

    def check_output(self, key: KeyPath, name: str, direction: str) -> None:
        """Report an output that is no channel and no probe, and a probe that is a point as well or has
        a direction.
        """
        if name not in self.sections.get("probes", ()):
            self.check_channel(key, name, direction)
        elif name in self.table.points:
            self.add(key, f"{name} is a point and a probe; rename one of them")
        elif direction:
            self.add(
                key,
                f'a probe shows displacement and stress in all directions; write "{name}" alone',
            )

    def split_outputs(
        self, outputs: Sequence[tuple[str, str]] | None
    ) -> tuple[tuple[Channel, ...], tuple[str, ...]]:
        """Return the channels among outputs, and the probes: all of them where no output is named."""
        inside = self.table.probes
        probes = dict.fromkeys(name for name, _ in outputs if name in inside) if outputs else inside
        channels = [one for one in outputs or () if one[0] not in inside]
        return self.build_channels(channels), (*probes,)

    def build_channels(self, channels: Sequence[tuple[str, str]]) -> tuple[Channel, ...]:
        """Return every channel once, with its direction: those of a point in x, y and z where none is
        written, those that a sensor measures, of a table of sensors those of all of them.
        """
        every: list[Channel] = []
        for name, direction in channels:
            sensors = _select_sensors(self.sensors, name)
            measured = [(one.name, dof) for one in sensors for dof in one.directions]
            wanted = [direction] if direction else DIRECTIONS
            every += [
                channel
                for channel in measured or [(name, dof) for dof in wanted]
                if channel[1] in wanted
            ]
        return tuple(dict.fromkeys(every))

    def check_pose(self, key: KeyPath, pose: str | None) -> None:
        """Report a name that is no pose; a scene without poses has one that is called ``reference``."""
        if pose is not None and (pose != "reference" or self.sections.get("poses")):
            self.check_name(key, pose, "poses")

    def check_poses(self, key: KeyPath, poses: Iterable[str] | None) -> None:
        """Report names in a list that are no poses.

        Args:
            poses: What is written; None for nothing.
        """
        for index, pose in enumerate(poses or ()):
            self.check_pose((*key, index), pose)

    def check_variant(self, key: KeyPath, choice: str | None, more: str = "") -> None:
        """Report each of the variants joined in a choice that the scene does not offer.

        Args:
            choice: Names joined by ``+``; empty for none.
            more: What else could be written there.
        """
        for variant in split_variant(choice) if choice else ():
            names = self.table.variants
            self.findings.check_name(key, variant, names, "variant", "variants", more)


@dataclass(frozen=True, eq=False)
class SceneAnalysis[T: RequestTable, R: Request]:
    """An analysis as scenes know it: each module of ``scene/analyses`` has one, ``ANALYSIS``.

    Attributes:
        table: Schema of ``[analyses.NAME]``.
        request: What is built from the table.
        meaning: Of the analysis, for the scene reference.
        build: Builds the request of a scene that has passed every check.
        check: Reports what is wrong with the table, whatever else is; poses are checked anyway.
        check_complete: Reports what is wrong once every entry of the scene passed the schema.
        check_scene: Reports what is wrong with the machine in its poses.
        check_sweep: Raises SceneError where the poses of a sweep do not suffice.
    """

    table: type[T]
    request: type[R]
    meaning: str
    build: Callable[[T, Draft], R]
    check: Callable[[T, Draft], None] | None = None
    check_complete: Callable[[T, Draft], None] | None = None
    check_scene: Callable[[R, Scene, Findings], None] | None = None
    check_sweep: Callable[[Scene, Sweep], None] | None = None


def list_records(names: Collection[str] = NAMES) -> tuple[SceneAnalysis[Any, Any], ...]:
    """Return analyses, in the order of ``NAMES``; the modules of others are not loaded."""
    return tuple(load_record(name) for name in NAMES if name in names)


def collect_sections(raw: TomlTable) -> dict[str, frozenset[str]]:
    """Names of the entries of each section of a parsed scene, valid or not."""
    sections = {key: frozenset(value) for key, value in raw.items() if isinstance(value, dict)}
    if "mechanism" in raw:
        sections["axes"] = sections.get("axes", frozenset()) | set(TOOL_AXES)
    return sections


def collect_interfaces(raw: TomlTable) -> dict[str, frozenset[str] | None]:
    """Interface names of each component of a parsed scene; None where a file knows them."""
    interfaces: dict[str, frozenset[str] | None] = {}
    components = raw.get("components")
    for name, entry in components.items() if isinstance(components, dict) else ():
        table = entry if isinstance(entry, dict) else {}
        solid, written = table.get("solid"), table.get("interfaces", {})
        from_file = isinstance(solid, dict) and "superelement" in solid
        interfaces[name] = (
            None if from_file or not isinstance(written, dict) else frozenset(written)
        )
    return interfaces


def is_known_end(end: JointEnd, scene: SceneTable) -> bool:
    """Return whether an end means ground or an interface of a component that passed the schema."""
    if end.component is None:
        return True
    component = scene.components.get(end.component)
    return component is not None and (
        component.solid.superelement is not None or end.interface in component.interfaces
    )


def _select_sensors(sensors: Mapping[str, Sensor], name: str) -> tuple[Sensor, ...]:
    """Return the sensor of a name, or all of the table of that name; none where there is neither."""
    if name in sensors:
        return (sensors[name],) if sensors[name].directions else ()
    return tuple(
        one for place, one in sensors.items() if place.partition(".")[0] == name and one.directions
    )


def describe_unmeasured(sensor: Sensor, direction: str) -> str:
    """Say that a sensor does not measure a direction, and what it does."""
    measured = " and ".join(sensor.directions)
    return (
        f'sensor "{sensor.name}" measured {measured} only; {direction} was not: write one of {", ".join(sensor.directions)}, '
        "or add the direction to the sensor"
    )
