"""Root folders are sub-packages of headstock, and ``api`` is headstock itself; the rooms in them are
found, not listed.
"""

from setuptools import find_packages, setup

LAYERS = (
    "geometry",
    "meshing",
    "solvers",
    "reduction",
    "scene",
    "pipeline",
    "studies",
    "validation",
    "app",
)

setup(
    packages=[
        "headstock",
        *(
            f"headstock.{name}"
            for layer in LAYERS
            for name in (layer, *(f"{layer}.{room}" for room in find_packages(layer)))
        ),
        "headstock.environment",  # the launcher, for the program of an installed package
    ],
    package_dir={"headstock": "api"}
    | {f"headstock.{folder}": folder for folder in (*LAYERS, "environment")},
)
