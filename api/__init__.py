"""Headstock as a library: a machine from a scene file, what can be done with it, what comes out.

    import headstock as hs

    machine = hs.load("machines/three_axis.toml", set={"joints.x_drive.stiffness.axial": "30 N/um"})
    results = hs.run(machine)
    print(results.numbers.select("frequency"))

Commands such as ``run`` and ``compare`` are functions of the same name; machines are also built of
tables such as ``hs.Component``. ``docs/python.md`` describes the public names; no other is public.
A name loads its module when it is first used, so that ``import headstock`` is quick.
"""

from importlib import import_module

_HOMES = {  # module to its public names
    "headstock.loading": ("load",),
    "headstock.previews": ("check", "plan"),
    "headstock.assemblies": ("new_from_assembly",),
    "headstock.exports": (*("export", "state_space", "varying_state_space", "Superelement"),),
    "headstock.runs": ("open", "run"),
    "headstock.repeated_runs": ("compare", "correlate", "fit_modes", "identify", "study", "sweep"),
    "headstock.machine": ("Machine",),
    "headstock.nouns": (
        *("Axis", "Box", "Column", "Component", "Interface", "Joint", "Load", "Material"),
        *("Plate", "Point", "Sensor", "Support", "Tube"),
    ),
    "headstock.geometry.errors": ("HeadstockError",),
    "headstock.pipeline.exchange.state_spaces": ("MachineStateSpace",),
    "headstock.pipeline.exchange.varying_spaces": ("VaryingStateSpace",),
    "headstock.pipeline.results.results": ("Results",),
    "headstock.pipeline.results.files": ("read_mesh",),
    "headstock.studies.comparison": ("Comparison",),
    "headstock.studies.correlation.correlation": ("Correlation",),
    "headstock.studies.correlation.modal_fit": ("ModalFit",),
    "headstock.studies.identification.identification": ("Identification",),
    "headstock.studies.parameters.tables": ("StudyTable",),
    "headstock.studies.sweeps.results": ("SweepResults",),
    "headstock.scene.reading.findings": ("SceneError",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["__version__", *_HOME_OF]


def __getattr__(name: str) -> object:
    if name == "__version__":
        value = import_module("headstock.pipeline.storage.provenance").find_version().version
    elif name in _HOME_OF:
        with import_module("headstock.geometry.loading").without_collecting():
            value = getattr(import_module(_HOME_OF[name]), name)
    else:
        raise AttributeError(f"headstock has no public name {name!r}; it has: {', '.join(__all__)}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
