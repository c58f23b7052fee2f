"""A part of your own: how stiff is it, and at what frequencies does it vibrate?

    ./headstock python examples/own_part.py

Gmsh makes a bracket here. With a STEP file of yours leave the first half out; `headstock show
PART.step` numbers its faces.
"""

from pathlib import Path

import gmsh

import headstock as hs

part = Path("bracket.step")
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
cad = gmsh.model.occ
plate = cad.addBox(0, 0, 0, 120, 80, 12)  # mm
wall = cad.addBox(0, 0, 0, 12, 80, 100)
(angle,), _ = cad.fuse([(3, plate)], [(3, wall)])
holes = [(3, cad.addCylinder(90, y, 0, 0, 0, 12, 5)) for y in (20, 60)]
cad.cut([angle], holes)
cad.synchronize()
gmsh.write(str(part))
gmsh.finalize()

bracket = hs.Component(
    solid={"step": str(part)},
    material="steel",
    interfaces={
        "foot": hs.Interface(face="z-"),
        "top": hs.Interface(face="z+", coupling="average"),
    },
)
machine = hs.Machine(
    name="bracket",
    materials={"steel": hs.Material(E="210 GPa", nu=0.3, rho=7850.0)},
    components={"bracket": bracket},
    joints={"bolts": hs.Joint(between=["ground", "bracket.foot"], kind="rigid")},
    points={"tip": hs.Point(tool="bracket.top", work="ground")},
    analyses={"static": {"at": "tip"}, "modal": {"count": 4}},
    accuracy="2 %",
)
result = hs.run(machine, output="results/bracket")
for axis, compliance in zip("xyz", result.compliance["tip"].diagonal()[:3], strict=True):
    print(f"{axis}: {1e-6 / compliance:8.1f} N/um")
print(result.to_pandas("modes"))
