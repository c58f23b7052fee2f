"""Machines of three to eight bodies, drawn by seed: blocks, plates and columns in series, on pads of
guides, bolted, and portals of two columns, on which models of bodies are compared.
"""

import itertools
from dataclasses import dataclass, field

import numpy as np

SHAPES = ("block", "plate", "wall", "column")
MODELS = ("rigid", "segmented", "elastic")
MODEL_SHARES = (0.45, 0.4, 0.15)
HEAD = """\
name = "machine {seed}"
model_errors = true
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[materials.iron]
E = "115 GPa"
nu = 0.26
rho = "7150 kg/m^3"
[effects]
damping = {{ modal = "3 %" }}
[analyses.static]
[analyses.modal]
count = {count}
[analyses.frf]
inputs = [["tcp", "x"], ["tcp", "y"], ["tcp", "z"]]
up_to = "{to:.0f} Hz"
points = 120
"""
FREQUENCIES, HIGHEST_HZ = 8, 300.0
Random = np.random.Generator
Sides = tuple[float, float, float]


@dataclass
class _Body:
    """A block of some sides [m] with its lowest face at a height, and interfaces as lines of TOML."""

    name: str
    sides: Sides
    place: Sides
    model: str
    material: str
    interfaces: list[str] = field(default_factory=list)

    @property
    def top(self) -> float:
        """Height of its upper face [m]."""
        return self.place[2] + 0.5 * self.sides[2]

    def add_patch(
        self,
        name: str,
        face: str,
        center: tuple[float, float],
        size: tuple[float, float],
        coupling: str,
    ) -> None:
        """Add an interface on a horizontal face, at a place in the machine [m]."""
        own = [center[axis] - self.place[axis] for axis in range(2)]
        self.interfaces.append(
            f'{name} = {{ face = "{face}", coupling = "{coupling}", rect = {{ center = [{_mm(own[0])}, {_mm(own[1])}],'
            f" size = [{_mm(size[0])}, {_mm(size[1])}] }} }}"
        )

    def write(self) -> str:
        """As a table of a scene."""
        along = "xyz"[int(np.argmax(self.sides))]
        return "\n".join(
            [
                f"[components.{self.name}]",
                f"solid = {{ box = [{', '.join(map(_mm, self.sides))}] }}",
                f"at = [{', '.join(map(_mm, self.place))}]",
                f'material = "{self.material}"',
                f'fidelity = "{self.model}"',
                f'segments = {{ count = 6, along = "{along}" }}',
                f"[components.{self.name}.interfaces]",
                *self.interfaces,
            ]
        )


def draw_machine_scene(seed: int) -> str:
    """Return a scene with analyses, as TOML.

    Args:
        seed: The same seed draws the same machine.
    """
    random = np.random.default_rng([17, seed])
    drawn = _Drawn(random)
    count = 3 + seed % 6
    base = drawn.add("block", (0.0, 0.0), 0.0)
    base.interfaces.append(f'ground = {{ face = "z-", coupling = "{drawn.coupling()}" }}')
    drawn.joints.append(
        _spring("mounts", "ground", f"{base.name}.ground", random.uniform(100, 800))
    )
    top, left = base, count - 1
    if seed % 3 == 2 and left >= 3:
        top, left = drawn.add_portal(base), left - 3
    for _ in range(left):
        top = drawn.stack(top)
    reach = 0.5 * np.array(top.sides[:2])
    size = (0.4 * reach[0], 0.4 * reach[1])
    center = (top.place[0] + 0.6 * reach[0], top.place[1] - 0.5 * reach[1])
    top.add_patch("tool", "z+", center, size, drawn.coupling())
    parts = [
        HEAD.format(seed=seed, count=FREQUENCIES, to=HIGHEST_HZ),
        *(body.write() for body in drawn.bodies),
        *drawn.joints,
        f'[points]\ntcp = {{ tool = "{top.name}.tool", work = "ground" }}',
    ]
    return "\n".join(parts) + "\n"


class _Drawn:
    """Bodies and joints drawn so far."""

    def __init__(self, random: Random) -> None:
        self.random = random
        self.bodies: list[_Body] = []
        self.joints: list[str] = []

    def coupling(self) -> str:
        """Kind of an interface."""
        return str(self.random.choice(["rigid", "average"]))

    def add(self, shape: str, at: tuple[float, float], height: float) -> _Body:
        """Add a body of a shape that stands at a height [m]."""
        sides = _sides(shape, self.random)
        model = str(self.random.choice(MODELS, p=MODEL_SHARES))
        material = str(self.random.choice(["steel", "iron"]))
        place = (at[0], at[1], height + 0.5 * sides[2])
        body = _Body(f"{shape}_{len(self.bodies) + 1}", sides, place, model, material)
        self.bodies.append(body)
        return body

    def stack(self, below: _Body) -> _Body:
        """Add a body on top of another, bolted over an area or on four pads of two guides."""
        shape = str(self.random.choice(SHAPES))
        body = self.add(shape, below.place[:2], below.top)
        # shifted as far as the smaller one stays on the larger one, whose middle is that of the contact
        shift = [
            0.25 * self.random.uniform(-1.0, 1.0) * abs(body.sides[axis] - below.sides[axis])
            for axis in (0, 1)
        ]
        body.place = (body.place[0] + shift[0], body.place[1] + shift[1], body.place[2])
        smaller = [body if body.sides[axis] < below.sides[axis] else below for axis in (0, 1)]
        overlap = (smaller[0].sides[0], smaller[1].sides[1])
        middle = (smaller[0].place[0], smaller[1].place[1])
        if shape in ("block", "plate") and self.random.uniform() < 0.6:
            self._guide(below, body, middle, overlap)
        else:
            self._bolt(below, body, middle, (0.85 * overlap[0], 0.85 * overlap[1]))
        return body

    def add_portal(self, base: _Body) -> _Body:
        """Two equal columns on the base and a beam across them."""
        columns = [self.add("column", base.place[:2], base.top) for _ in range(2)]
        sides = columns[0].sides
        span = 0.5 * (base.sides[1] - 1.4 * sides[1])
        for column, sign in zip(columns, (-1.0, 1.0), strict=True):
            column.sides = sides
            column.model = columns[0].model
            column.material = columns[0].material
            column.place = (base.place[0], base.place[1] + sign * span, base.top + 0.5 * sides[2])
            self._bolt(base, column, column.place[:2], (0.95 * sides[0], 0.95 * sides[1]))
        beam = self.add("plate", base.place[:2], columns[0].top)
        beam.sides = (1.3 * sides[0], 2.0 * span + 1.4 * sides[1], 0.8 * sides[0])
        beam.place = (base.place[0], base.place[1], columns[0].top + 0.5 * beam.sides[2])
        for column in columns:
            self._bolt(column, beam, column.place[:2], (0.95 * sides[0], 0.95 * sides[1]))
        return beam

    def _bolt(
        self, below: _Body, above: _Body, center: tuple[float, float], size: tuple[float, float]
    ) -> None:
        name = f"bolts_{len(self.joints)}"
        kind = self.coupling()
        below.add_patch(f"{name}_a", "z+", center, size, kind)
        above.add_patch(f"{name}_b", "z-", center, size, kind)
        self.joints.append(
            f'[joints.{name}]\nbetween = ["{below.name}.{name}_a", "{above.name}.{name}_b"]\nkind = "rigid"'
        )

    def _guide(
        self, below: _Body, above: _Body, center: tuple[float, float], overlap: tuple[float, float]
    ) -> None:
        size = (0.22 * overlap[0], 0.18 * overlap[1])
        stiffness = self.random.uniform(60, 400)
        kind = self.coupling()
        for sign in itertools.product((-1.0, 1.0), repeat=2):
            name = f"pad_{len(self.joints)}"
            own = (center[0] + 0.3 * sign[0] * overlap[0], center[1] + 0.33 * sign[1] * overlap[1])
            below.add_patch(f"{name}_a", "z+", own, size, kind)
            above.add_patch(f"{name}_b", "z-", own, size, kind)
            self.joints.append(
                _spring(
                    name, f"{below.name}.{name}_a", f"{above.name}.{name}_b", stiffness, turns=False
                )
            )


def _spring(name: str, first: str, second: str, stiffness: float, *, turns: bool = True) -> str:
    """Return a joint of springs [N/um] in every direction."""
    table = dict.fromkeys("xyz", f"{stiffness:.4g} N/um")
    if turns:
        table |= {f"r{axis}": f"{0.02 * stiffness:.4g} N m/urad" for axis in "xyz"}
    lines = [f'stiffness.{axis} = "{value}"' for axis, value in table.items()]
    return "\n".join(
        [f"[joints.{name}]", f'between = ["{first}", "{second}"]', 'kind = "spring"', *lines]
    )


def _sides(shape: str, random: Random) -> Sides:
    """Sides of a body [m], to the millimetre."""
    low, high = {
        "block": ((0.35, 0.35, 0.15), (0.7, 0.7, 0.35)),
        "plate": ((0.3, 0.3, 0.03), (0.6, 0.6, 0.07)),
        "wall": ((0.05, 0.3, 0.3), (0.1, 0.5, 0.5)),
        "column": ((0.08, 0.08, 0.3), (0.16, 0.16, 0.6)),
    }[shape]
    x, y, z = (round(float(side), 3) for side in random.uniform(low, high))
    return x, y, z


def _mm(value: float) -> str:
    return f'"{1e3 * value:.4g} mm"'
