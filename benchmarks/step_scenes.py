"""Scenes of the STEP parts of `step_parts.py`: fixed at one face and loaded at another, with a cost
study of four frequencies and three compliances.

./headstock exec python3 benchmarks/step_scenes.py NAME FOLDER
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from step_parts import write_part

SCENE = """name = "Part from STEP: {name}"

[materials.cast_iron]
E = "115 GPa"
nu = 0.26
rho = "7150 kg/m^3"

[components.part]
solid = {{ step = "{name}.step" }}
material = "cast_iron"
mesh = {{ size = "{sizes[1]:g} mm" }}

[components.part.interfaces]
foot = {{ {fixed} }}
load = {{ {loaded}, coupling = "average" }}

[joints.screws]
between = ["ground", "part.foot"]
kind = "rigid"

[points]
load = {{ tool = "part.load", work = "ground" }}

[analyses.static]
at = "load"

[analyses.modal]
count = 4

[studies.cost]
watch = [
    "modal.frequencies_hz[0:4]", "static.load.compliance_um_per_kN[0][0]",
    "static.load.compliance_um_per_kN[1][1]", "static.load.compliance_um_per_kN[2][2]",
]
store = "cold"

[studies.cost.reference_run]  # whose rims and inner edges are as fine as their errors ask for
accuracy = "{reference}"

[studies.cost.families.size]
label = "second-order tets (tet10)"
vary = {{ "components.part.mesh.size" = [{even}] }}

[studies.cost.families.graded]
label = "graded from the rims (tet10)"
set = {{ "components.part.mesh.growth" = 0.3 }}
pairwise = true
vary = {{ "components.part.mesh.size" = [{even}], "components.part.mesh.rim_size" = [{rims}] }}

[studies.cost.families.corrected]
label = "corrected by the estimate (tet10)"
set = {{ "components.part.reduction.correct_mesh" = true }}
vary = {{ "components.part.mesh.size" = [{even}] }}

[studies.cost.families.automatic]
label = "automatic"
vary = {{ accuracy = ["5 %", "1 %"] }}
"""


@dataclass(frozen=True)
class PartScene:
    """How a part is fixed, loaded and meshed by hand.

    Attributes:
        fixed: Patch of its foot, in the words of a scene.
        loaded: Patch of its load.
        sizes: Of its elements, from coarse to fine [mm].
        reference: Accuracy of what all others are compared with.
    """

    fixed: str
    loaded: str
    sizes: tuple[float, float, float]
    reference: str = "0.1 %"


SCENES = {
    "angle": PartScene('face = "z-"', 'face = "z+"', (16.0, 10.0, 6.0)),
    "housing": PartScene('face = "z-"', 'face = "x+"', (40.0, 20.0, 12.0), "0.5 %"),
    "elbow": PartScene('face = "z+"', 'face = "x-"', (30.0, 16.0, 10.0)),
    "bolt_plate": PartScene(
        'face = "x-"',
        'face = "z+", rect = { center = ["560 mm", "200 mm"], size = ["60 mm", "120 mm"] }',
        (40.0, 25.0, 15.0),
        "0.3 %",
    ),
}


def write_scene(name: str, folder: Path) -> Path:
    """Write a part that is not there yet and its scene, and return the scene's path."""
    folder.mkdir(parents=True, exist_ok=True)
    part = folder / f"{name}.step"
    if not part.exists():  # a file of another date would be another part to a study that goes on
        write_part(name, part)
    scene = SCENES[name]
    even = ", ".join(f'"{size:g} mm"' for size in scene.sizes)
    rims = ", ".join(f'"{size / 8.0:g} mm"' for size in scene.sizes)
    path = folder / f"{name}.toml"
    path.write_text(SCENE.format(name=name, even=even, rims=rims, **vars(scene)))
    return path


if __name__ == "__main__":
    write_scene(sys.argv[1], Path(sys.argv[2]))
