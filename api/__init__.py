"""Headstock as a library: ``import headstock as hs``. docs/python.md describes these names; no
other is public.

The folder ``api`` is the package ``headstock`` itself. A name loads its module when it is first
used, so that ``import headstock.geometry.frames`` loads that module and nothing else.
"""

from importlib import import_module

_HOMES = {
    "headstock.runs": (
        *("check", "compare", "identify", "load", "open", "plan", "run", "study", "sweep"),
    ),
    "headstock.machine": ("Machine",),
    "headstock.nouns": (
        *("Axis", "Box", "Column", "Component", "Interface", "Joint", "Load", "Material"),
        *("Plate", "Point", "Support", "Tube"),
    ),
    "headstock.geometry.errors": ("HeadstockError",),
    "headstock.pipeline.results.results": ("Results",),
    "headstock.pipeline.results.files": ("read_mesh",),
    "headstock.studies.comparison": ("Comparison",),
    "headstock.studies.identification.identification": ("Identification",),
    "headstock.studies.parameters.tables": ("StudyTable",),
    "headstock.studies.sweeps.results": ("SweepResults",),
    "headstock.scene.reading.findings": ("SceneError",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["__version__", *_HOME_OF]


def __getattr__(name: str) -> object:
    if name == "__version__":
        found = import_module("headstock.pipeline.storage.provenance").find_version().version
    elif name in _HOME_OF:
        found = getattr(import_module(_HOME_OF[name]), name)
    else:
        raise AttributeError(f"headstock has no public name {name!r}; it has: {', '.join(__all__)}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
