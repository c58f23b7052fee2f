# fmt: off
# ruff: noqa: E501, I001
# written by .ci/stub.py
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from headstock.machine import Noun
from headstock.scene.schema import axes, components, joints, loads, sensors
from headstock.values import Quantity
from headstock.assemblies import new_from_assembly as new_from_assembly
from headstock.exports import Superelement as Superelement
from headstock.exports import export as export
from headstock.exports import state_space as state_space
from headstock.exports import varying_state_space as varying_state_space
from headstock.geometry.errors import HeadstockError as HeadstockError
from headstock.loading import load as load
from headstock.machine import Machine as Machine
from headstock.nouns import Box as Box
from headstock.pipeline.exchange.state_spaces import MachineStateSpace as MachineStateSpace
from headstock.pipeline.exchange.varying_spaces import VaryingStateSpace as VaryingStateSpace
from headstock.pipeline.results.files import read_mesh as read_mesh
from headstock.pipeline.results.results import Results as Results
from headstock.previews import check as check
from headstock.previews import plan as plan
from headstock.repeated_runs import compare as compare
from headstock.repeated_runs import correlate as correlate
from headstock.repeated_runs import fit_modes as fit_modes
from headstock.repeated_runs import identify as identify
from headstock.repeated_runs import study as study
from headstock.repeated_runs import sweep as sweep
from headstock.runs import open as open
from headstock.runs import run as run
from headstock.scene.reading.findings import SceneError as SceneError
from headstock.studies.comparison import Comparison as Comparison
from headstock.studies.correlation.correlation import Correlation as Correlation
from headstock.studies.correlation.modal_fit import ModalFit as ModalFit
from headstock.studies.identification.identification import Identification as Identification
from headstock.studies.parameters.tables import StudyTable as StudyTable
from headstock.studies.sweeps.results import SweepResults as SweepResults

type _Table = Noun | Mapping[str, object]
type _Numbers = Sequence[Quantity] | NDArray[np.floating[Any]]

__version__: str
__all__: list[str]

class Axis(Noun, schema=axes.AxisTable):
    def __init__(
        self, *,
        joints: Sequence[str] | str | None = ...,
        joint: str | None = ...,
        direction: Literal['x', 'y', 'z', '+x', '+y', '+z', '-x', '-y', '-z'] | _Numbers | None = ...,
        kind: Literal['linear', 'rotary'] | None = ...,
        center: _Numbers | None = ...,
        limits: _Numbers | None = ...,
        moves: Sequence[str] | str | None = ...,
        errors: _Table | None = ...,
    ) -> None: ...

class Column(Noun, schema=components.SolidTable):
    def __init__(
        self, *,
        size: _Numbers,
        wall: Quantity,
        cap: Quantity,
        rib: Quantity | None = ...,
        ribs_z: int | None = ...,
        ribs_x: int | None = ...,
        ribs_y: int | None = ...,
        core_hole: Quantity | None = ...,
    ) -> None: ...

class Component(Noun, schema=components.ComponentTable):
    def __init__(
        self, *,
        solid: _Table,
        material: str | None = ...,
        mass: Quantity | None = ...,
        at: _Numbers | None = ...,
        places: Sequence[_Numbers] | Mapping[str, _Numbers] | None = ...,
        each: Mapping[str, Mapping[str, object]] | None = ...,
        rotate: Sequence[_Table] | _Table | None = ...,
        fidelity: Literal['rigid', 'segmented', 'polynomial', 'elastic'] | None = ...,
        mesh: _Table | None = ...,
        reduction: _Table | None = ...,
        segments: _Table | None = ...,
        interfaces: Mapping[str, _Table] | None = ...,
        rayleigh: _Table | None = ...,
        free: bool | None = ...,
    ) -> None: ...

class Interface(Noun, schema=components.InterfaceTable):
    def __init__(
        self, *,
        face: str | None = ...,
        disk: _Table | None = ...,
        rect: _Table | None = ...,
        strip: _Table | None = ...,
        band: _Table | None = ...,
        ring: _Table | None = ...,
        outline: _Table | None = ...,
        patches: Sequence[_Table] | None = ...,
        places: Sequence[_Numbers] | Mapping[str, _Numbers] | None = ...,
        each: Mapping[str, Mapping[str, object]] | None = ...,
        coupling: Literal['rigid', 'average'] | _Table | None = ...,
        allow_singular: bool | None = ...,
        rail: _Table | None = ...,
    ) -> None: ...

class Joint(Noun, schema=joints.JointTable):
    def __init__(
        self, *,
        from_: str | None = ...,
        between: Sequence[str],
        kind: Literal['rigid', 'spring', 'linear_guide', 'ball_screw', 'bolted', 'bearing', 'mount', 'revolute', 'universal', 'spherical', 'prismatic'] | None = ...,
        axis: Literal['x', 'y', 'z', '+x', '+y', '+z', '-x', '-y', '-z'] | _Numbers | None = ...,
        normal: Literal['x', 'y', 'z', '+x', '+y', '+z', '-x', '-y', '-z'] | _Numbers | None = ...,
        at: _Numbers | None = ...,
        places: Sequence[_Numbers] | Mapping[str, _Numbers] | None = ...,
        carriages: _Table | None = ...,
        each: Mapping[str, Mapping[str, object]] | None = ...,
        length: Quantity | None = ...,
        screw: _Table | None = ...,
        stiffness: Mapping[str, Quantity | Literal['rigid']] | None = ...,
        stiffness_per_area: _Table | None = ...,
        damping: Mapping[str, Quantity] | None = ...,
        loss_factor: Quantity | None = ...,
        errors: _Table | None = ...,
        allow_negative: bool | None = ...,
        soft: bool | None = ...,
    ) -> None: ...

class Load(Noun, schema=loads.LoadTable):
    def __init__(
        self, *,
        face: str | None = ...,
        disk: _Table | None = ...,
        rect: _Table | None = ...,
        strip: _Table | None = ...,
        band: _Table | None = ...,
        ring: _Table | None = ...,
        outline: _Table | None = ...,
        at: str | None = ...,
        component: str | None = ...,
        force: _Numbers | None = ...,
        moment: _Numbers | None = ...,
        traction: _Numbers | None = ...,
        pressure: Quantity | None = ...,
        body: _Numbers | None = ...,
        joint: str | None = ...,
        displacement: _Numbers | None = ...,
        rotation: _Numbers | None = ...,
        base: _Numbers | None = ...,
    ) -> None: ...

class Material(Noun, schema=components.MaterialTable):
    def __init__(
        self, *,
        E: Quantity,
        nu: float,
        rho: Quantity,
        loss_factor: Quantity | None = ...,
    ) -> None: ...

class Plate(Noun, schema=components.SolidTable):
    def __init__(
        self, *,
        size: _Numbers,
        rib_height: Quantity | None = ...,
        rib: Quantity | None = ...,
        ribs_x: int | None = ...,
        ribs_y: int | None = ...,
    ) -> None: ...

class Point(Noun, schema=axes.PointTable):
    def __init__(
        self, *,
        tool: str,
        work: str,
        offset: _Numbers | None = ...,
    ) -> None: ...

class Sensor(Noun, schema=sensors.SensorTable):
    def __init__(
        self, *,
        component: str | None = ...,
        at: _Numbers | None = ...,
        file: str | None = ...,
        unit: str | None = ...,
        frame: Literal['machine', 'component'] | None = ...,
        reach: Quantity | None = ...,
        mass: Quantity | None = ...,
        directions: Sequence[Literal['x', 'y', 'z'] | _Numbers] | None = ...,
        axes: Literal['machine', 'component'] | None = ...,
        residual_modes: bool | None = ...,
    ) -> None: ...

class Support(Noun, schema=loads.SupportTable):
    def __init__(
        self, *,
        face: str | None = ...,
        disk: _Table | None = ...,
        rect: _Table | None = ...,
        strip: _Table | None = ...,
        band: _Table | None = ...,
        ring: _Table | None = ...,
        outline: _Table | None = ...,
        at: str | None = ...,
        edge: Sequence[str] | None = ...,
        fix: Sequence[Literal['x', 'y', 'z', 'normal'] | _Numbers],
    ) -> None: ...

class Tube(Noun, schema=components.SolidTable):
    def __init__(
        self, *,
        outer: Quantity,
        inner: Quantity | None = ...,
        length: Quantity,
    ) -> None: ...
