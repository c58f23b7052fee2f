"""Parts of many kinds, drawn by seed, on which what stands behind ± is compared with the truth."""

import dataclasses
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Point
from headstock.geometry.parts.components import (
    Component,
    Interface,
    Material,
    MeshSettings,
    Patch,
    ReductionSettings,
)
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, StepFile, Tube

MATERIALS = (
    Material("steel", 210e9, 0.3, 7850.0),
    Material("iron", 115e9, 0.26, 7150.0),
    Material("aluminium", 70e9, 0.33, 2700.0),
    Material("polymer", 2e9, 0.45, 1000.0),
)
FIXED = tuple(range(6))
PRODUCT, PRODUCT_KIND = 48, "product STEP"  # the seed of a bracket of a real product
BRACKET = Path(__file__).resolve().parents[2] / "tests" / "data" / "support.step"
# seeds of hexahedra between the edges of patches, as searches for an accuracy begin with
FIRST_HEX = 1000
# and of STEP parts whose meshes follow the errors of the one before
FIRST_ADAPTED = 2000
ADAPTED_SHARE = 1.6  # coarser than those that are judged as they are, as searches begin
WALLS = 2.2  # thicknesses of a wall: flat tetrahedra that are wider than about three are stiff
CLAMP = "clamp"
Random = np.random.Generator


@dataclass(frozen=True, eq=False)
class CoveragePart:
    """A part of the suite.

    Attributes:
        seed: What it was drawn from.
        machine: The part alone, named ``part``, fixed at ``foot`` and loaded at ``tip`` (point
            ``tcp``).
        meshes: Settings that are judged, from coarse to finer.
        rounds: Further meshes that are judged, each with the sizes that the errors of the one before
            ask for.
        truth: Settings far finer.
    """

    seed: int
    kind: str
    machine: Machine
    meshes: tuple[MeshSettings, ...]
    reference: MeshSettings
    rounds: int = 0


@dataclass(frozen=True)
class _Drawn:
    """A solid with the patches that are fixed and loaded.

    Attributes:
        extent: Its diagonal [m].
        shares: Sizes of the judged meshes as shares of the diagonal.
        graded: Elements grow from the rims.
        across: Elements across patches of the judged meshes, at least.
        rounds: Meshes that follow errors.
    """

    solid: Solid
    foot: tuple[Patch, ...]
    tip: tuple[Patch, ...]
    extent: float
    shares: tuple[float, ...] = (0.1, 0.065)
    fine: float = 0.035
    hex: bool = False
    order: int = 2
    graded: bool = False
    across: tuple[int, ...] = (MeshSettings().across_patches,) * 2
    rounds: int = 0


def draw_part(seed: int, folder: Path) -> CoveragePart:
    """Draw the part of a seed.

    Args:
        seed: Kinds take turns by it.
        folder: Where STEP files are written.
    """
    random = np.random.default_rng([20240517, seed])
    kinds = KINDS if seed < FIRST_HEX else HEX_KINDS if seed < FIRST_ADAPTED else ADAPTED_KINDS
    if seed == PRODUCT:
        kinds = {PRODUCT_KIND: _product}
    kind = list(kinds)[seed % len(kinds)]
    drawn = kinds[kind](random, folder / f"part_{seed}.step")
    material = MATERIALS[random.integers(len(MATERIALS))]
    interfaces = {
        "foot": Interface("foot", drawn.foot, "rigid" if random.random() < 0.6 else "average"),
        "tip": Interface("tip", drawn.tip, "average" if random.random() < 0.7 else "rigid"),
    }
    part = Component(
        "part", drawn.solid, material, interfaces=interfaces, reduction=ReductionSettings(modes=0)
    )
    fixed = random.random() < 0.75
    ends = (JointEnd(), JointEnd("part", "foot"))
    stiffness = (
        material.youngs_modulus * drawn.extent * np.diag([1.0, 1.0, 2.0, *[drawn.extent**2] * 3])
    )
    joint = (
        Joint(CLAMP, ends, "rigid", fixed=FIXED)
        if fixed
        else Joint(CLAMP, ends, "spring", stiffness=stiffness)
    )
    machine = Machine(
        kind,
        {"part": part},
        {CLAMP: joint},
        {"tcp": Point("tcp", JointEnd("part", "tip"), JointEnd())},
    )
    scatter = float(random.uniform(0.85, 1.2))
    meshes = tuple(
        MeshSettings(
            size=share * scatter * drawn.extent,
            order=drawn.order,
            cells="hex" if drawn.hex else "tet",
            allow_locking=drawn.order == 1,
            growth=0.5 if drawn.graded else None,
            rim_size=0.3 * share * drawn.extent if drawn.graded else None,
            across_patches=across,
        )
        for share, across in zip(drawn.shares, drawn.across, strict=True)
    )
    fine = drawn.fine * drawn.extent
    reference = MeshSettings(size=fine, growth=0.3, rim_size=0.1 * fine, across_patches=10)
    return CoveragePart(seed, kind, machine, meshes, reference, drawn.rounds)


def _diagonal(*sides: float) -> float:
    return float(np.linalg.norm(sides))


def _range(random: Random, low: float, high: float) -> float:
    return round(float(random.uniform(low, high)), 4)


def _whole(face: str) -> tuple[Patch, ...]:
    return (Patch(face),)


def _rect(face: str, center: tuple[float, float, float], size: tuple[float, float]) -> Patch:
    return Patch(face, "rect", center, size)


def _block(random: Random, file: Path) -> _Drawn:
    """Return a block that stands on its foot, sometimes loaded at a patch of its side."""
    x, y, z = _range(random, 0.06, 0.15), _range(random, 0.06, 0.2), _range(random, 0.2, 0.6)
    side = (_rect("x+", (x / 2, 0.0, 0.8 * z), (0.5 * y, 0.15 * z)),)
    return _Drawn(
        Box((x, y, z)),
        _whole("z-"),
        _whole("z+") if random.random() < 0.5 else side,
        _diagonal(x, y, z),
    )


def _hex_block(random: Random, file: Path) -> _Drawn:
    return dataclasses.replace(
        _block(random, file), tip=_whole("z+"), hex=True, shares=(0.16, 0.09)
    )


def _linear_block(random: Random, file: Path) -> _Drawn:
    """First-order elements, hexahedra or tetrahedra."""
    return dataclasses.replace(
        _block(random, file),
        tip=_whole("z+"),
        shares=(0.05, 0.035),
        order=1,
        hex=bool(random.random() < 0.5),
    )


def _sheet(random: Random, file: Path) -> _Drawn:
    """Return a strip or sheet that is clamped at an end face."""
    x, y = _range(random, 0.2, 0.5), _range(random, 0.08, 0.25)
    thick = x / _range(random, 15.0, 40.0)
    return _Drawn(
        Box((x, y, round(thick, 5))),
        _whole("x-"),
        _whole("x+"),
        _diagonal(x, y),
        fine=0.025,
        hex=bool(random.random() < 0.5),
    )


def _plate(random: Random, file: Path) -> _Drawn:
    """Return a plate on four feet, loaded in its middle."""
    x, y, z = _range(random, 0.3, 0.6), _range(random, 0.2, 0.4), _range(random, 0.012, 0.03)
    foot = _range(random, 0.04, 0.06)
    feet = tuple(
        _rect("z-", (a * 0.4 * x, b * 0.38 * y, 0.0), (foot, foot))
        for a in (-1, 1)
        for b in (-1, 1)
    )
    return _Drawn(
        Box((x, y, z)), feet, (_rect("z+", (0.1 * x, 0.0, z), (0.07, 0.06)),), _diagonal(x, y)
    )


def _ribbed_plate(random: Random, file: Path) -> _Drawn:
    x, y, z = _range(random, 0.3, 0.6), _range(random, 0.2, 0.4), _range(random, 0.012, 0.025)
    solid = Plate(
        (x, y, z),
        _range(random, 0.03, 0.07),
        _range(random, 0.01, 0.018),
        ribs_x=2,
        ribs_y=int(random.integers(2, 4)),
    )
    feet = tuple(
        _rect("z-", (a * 0.4 * x, b * 0.38 * y, 0.0), (0.05, 0.04))
        for a in (-1, 1)
        for b in (-1, 1)
    )
    return _Drawn(
        solid,
        feet,
        (_rect("z-", (0.0, 0.0, 0.0), (0.08, 0.06)),),
        _diagonal(x, y),
        (0.1, 0.06),
        0.035,
    )


def _column(random: Random, file: Path) -> _Drawn:
    """Return a hollow column, loaded at its top or at a patch of its front."""
    x, y, z = _range(random, 0.15, 0.25), _range(random, 0.18, 0.3), _range(random, 0.4, 0.8)
    wall = _range(random, 0.008, 0.018)
    solid = HollowColumn((x, y, z), wall, 1.2 * wall, 0.01, ribs_z=int(random.integers(1, 3)))
    side = (_rect("x+", (x / 2, 0.3 * y, 0.8 * z), (0.05, 0.08)),)
    extent = _diagonal(x, y, z)
    tip = _whole("z+") if random.random() < 0.5 else side
    return _Drawn(solid, _whole("z-"), tip, extent, (0.1, 0.07), min(0.04, WALLS * wall / extent))


def _cored_column(random: Random, file: Path) -> _Drawn:
    """Return a column with round core holes through its ribs and caps."""
    x, y, z = _range(random, 0.15, 0.25), _range(random, 0.18, 0.3), _range(random, 0.35, 0.6)
    solid = HollowColumn(
        (x, y, z), 0.014, 0.016, 0.012, ribs_z=1, core_hole=_range(random, 0.05, 0.09)
    )
    return _Drawn(solid, _whole("z-"), _whole("z+"), _diagonal(x, y, z), (0.1, 0.07), 0.04)


def _tube(random: Random, file: Path) -> _Drawn:
    outer, length = _range(random, 0.06, 0.15), _range(random, 0.15, 0.5)
    inner = round(outer * _range(random, 0.3, 0.85), 5) if random.random() < 0.8 else 0.0
    return _Drawn(
        Tube(outer, inner, length),
        _whole("z-"),
        _whole("z+"),
        _diagonal(outer, outer, length),
        (0.1, 0.06),
        0.03,
    )


def _round_step(random: Random, file: Path) -> _Drawn:
    """Return a ball, a cone or an elbow from a STEP file."""
    radius = _range(random, 0.04, 0.08)
    choice = int(random.integers(3))
    if choice == 0:
        write_step(file, "ball", radius=radius, height=_range(random, 1.2, 1.6) * radius)
        return _Drawn(StepFile(file), _whole("z-"), _whole("z+"), 3.0 * radius, (0.12, 0.08), 0.045)
    if choice == 1:
        sizes = {
            "height": _range(random, 0.15, 0.3),
            "radius": radius,
            "top": 0.7 * radius,
            "bore": 0.4 * radius,
        }
        write_step(file, "cone", **sizes)
        return _Drawn(StepFile(file), _whole("z-"), _whole("z+"), 3.0 * radius, (0.12, 0.08), 0.045)
    write_step(
        file,
        "elbow",
        bend=_range(random, 2.2, 4.0) * radius,
        radius=radius,
        bore=_range(random, 0.5, 0.85) * radius,
    )
    return _Drawn(StepFile(file), _whole("z+"), _whole("x-"), 3.0 * radius, (0.12, 0.08), 0.045)


def _milled_step(random: Random, file: Path) -> _Drawn:
    """Return a block with a bore and rounded edges from a STEP file."""
    x, y, z = _range(random, 0.06, 0.12), _range(random, 0.06, 0.12), _range(random, 0.12, 0.25)
    least = min(x, y)
    write_step(
        file,
        "block",
        x=x,
        y=y,
        z=z,
        hole_z=0.5 * z,
        bore=_range(random, 0.15, 0.3) * least,
        fillet=_range(random, 0.1, 0.2) * least,
    )
    return _Drawn(StepFile(file), _whole("z-"), _whole("z+"), _diagonal(x, y, z), (0.1, 0.07), 0.04)


def _product(random: Random, file: Path) -> _Drawn:
    """Return a machined bracket, screwed down at its flange and loaded in the bore of its bearing."""
    bore = (Patch("face:12"), Patch("face:22"))
    return _Drawn(
        StepFile(BRACKET),
        _whole("z+"),
        bore,
        _diagonal(0.0685, 0.0404, 0.0331),
        (0.08, 0.055),
        0.02,
    )


def _graded_block(random: Random, file: Path) -> _Drawn:
    """Elements that grow from the rims of what is fixed."""
    return dataclasses.replace(_block(random, file), graded=True)


KINDS: dict[str, Callable[[Random, Path], _Drawn]] = {
    "block": _block,
    "hex block": _hex_block,
    "first order": _linear_block,
    "sheet": _sheet,
    "plate": _plate,
    "ribbed plate": _ribbed_plate,
    "hollow column": _column,
    "cored column": _cored_column,
    "tube": _tube,
    "round STEP": _round_step,
    "milled STEP": _milled_step,
    "graded": _graded_block,
}


def _hex_pads(random: Random, file: Path) -> _Drawn:
    """Return a block on its foot or on four pads, loaded at a patch of its side or of its end."""
    drawn = _block(random, file)
    if not isinstance(drawn.solid, Box):
        raise TypeError("a block is a box")
    x, y, z = drawn.solid.size
    a, b = random.uniform(0.25, 0.7, 2)
    pads = tuple(
        _rect("z-", (s * 0.25 * x, t * 0.25 * y, 0.0), (0.3 * x, 0.3 * y))
        for s in (-1, 1)
        for t in (-1, 1)
    )
    foot = pads if random.random() < 0.5 else _whole("z-")
    if random.random() < 0.5:
        height = _range(random, 0.6, 0.85) * z
        tip = _rect("x+", (x / 2, 0.0, height), (round(a * y, 4), round(0.3 * b * z, 4)))
    else:
        tip = _rect("z+", (0.1 * x, 0.0, z), (round(a * x, 4), round(b * y, 4)))
    return _grid(dataclasses.replace(drawn, foot=foot, tip=(tip,), shares=(0.16, 0.09)))


def _grid(drawn: _Drawn) -> _Drawn:
    """Hexahedra with few elements across patches."""
    return dataclasses.replace(drawn, hex=True, across=(2, 4))


HEX_KINDS: dict[str, Callable[[Random, Path], _Drawn]] = {
    "hex whole faces": lambda random, file: _grid(_hex_block(random, file)),
    "hex pads": _hex_pads,
    "hex plate": lambda random, file: _grid(
        dataclasses.replace(_plate(random, file), shares=(0.14, 0.08))
    ),
    "hex sheet": lambda random, file: _grid(_sheet(random, file)),
    "hex more pads": _hex_pads,
}


def _adapted(drawn: _Drawn) -> _Drawn:
    """Return a coarse even mesh, and two that follow its errors."""
    coarse = (ADAPTED_SHARE * drawn.shares[0],)
    return dataclasses.replace(drawn, shares=coarse, across=drawn.across[:1], rounds=2)


def _angle_step(random: Random, file: Path) -> _Drawn:
    """Return an angle with a sharp inner edge and a bore, from a STEP file."""
    x, y, z = _range(random, 0.08, 0.16), _range(random, 0.05, 0.12), _range(random, 0.1, 0.2)
    thick = _range(random, 0.012, 0.025)
    write_step(
        file,
        "angle",
        x=x,
        y=y,
        z=z,
        thick=thick,
        hole_z=0.6 * z,
        bore=_range(random, 0.12, 0.25) * y,
    )
    return _Drawn(StepFile(file), _whole("z-"), _whole("z+"), _diagonal(x, y, z), fine=0.03)


ADAPTED_KINDS: dict[str, Callable[[Random, Path], _Drawn]] = {
    "adapted round": lambda random, file: _adapted(_round_step(random, file)),
    "adapted milled": lambda random, file: _adapted(_milled_step(random, file)),
    "adapted angle": lambda random, file: _adapted(_angle_step(random, file)),
}


def write_step(file: Path, kind: str, **sizes: float) -> None:
    """Write a curved solid; sizes in metres."""
    scaled = json.dumps({name: 1e3 * size for name, size in sizes.items()})
    command = [
        sys.executable,
        "-m",
        "headstock.validation.coverage.curved_samples",
        kind,
        scaled,
        str(file),
    ]
    subprocess.run(command, check=True, capture_output=True)
