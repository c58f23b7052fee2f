"""The nouns a machine is built of in Python, each a table of the scene (docs/scene_reference.md)."""

from headstock.machine import Noun
from headstock.scene.expansion.catalogue import fill_joint
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Findings
from headstock.scene.schema.axes import AxisTable, PointTable
from headstock.scene.schema.components import (
    ComponentTable,
    InterfaceTable,
    MaterialTable,
    SolidTable,
)
from headstock.scene.schema.joints import JointTable
from headstock.scene.schema.loads import LoadTable, SupportTable
from headstock.scene.schema.sensors import SensorTable
from headstock.values import Quantity


class Material(Noun, schema=MaterialTable):
    """An isotropic, linear elastic material."""


class Box(Noun, schema=SolidTable):
    """A block with its sides along x, y and z; the origin is the middle of its lower face."""

    def __init__(self, x: Quantity, y: Quantity, z: Quantity) -> None:
        """Make it of its three sides [m]."""
        super().__init__(box=[x, y, z])


class Tube(Noun, schema=SolidTable, kind="tube"):
    """A hollow or full cylinder along z."""


class Plate(Noun, schema=SolidTable, kind="plate"):
    """A plate in the x-y plane, with ribs on its upper side if wanted."""


class Column(Noun, schema=SolidTable, kind="column"):
    """A closed rectangular column with internal ribs."""


class Interface(Noun, schema=InterfaceTable):
    """An area of a component that joints are attached to."""


class Component(Noun, schema=ComponentTable):
    """One body of a machine."""


class Joint(Noun, schema=JointTable):
    """A joint between two interfaces, or an interface and ground. ``from_`` takes an element of the
    catalogue: ``from_="catalogue:guide_35"``.
    """

    def _in_full(self, findings: Findings) -> TomlTable:
        return fill_joint(self.table, (), findings)


class Axis(Noun, schema=AxisTable):
    """An axis of motion of a machine."""


class Point(Noun, schema=PointTable):
    """Where results are wanted: the motion of a tool relative to a work piece."""


class Support(Noun, schema=SupportTable):
    """A face, or the patches of an interface, fixed in some directions."""


class Load(Noun, schema=LoadTable):
    """A static load: force, traction, pressure or acceleration."""


class Sensor(Noun, schema=SensorTable):
    """A place on a component where motion is measured or a force acts, or a table of them."""
