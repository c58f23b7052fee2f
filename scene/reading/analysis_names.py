"""Names of the analyses, in the order in which a scene lists them; each is a module of
``scene/analyses``.
"""

NAMES = (
    "static",
    "modal",
    "frf",
    "map",
    "contouring",
    "path",
    "control",
    "volumetric",
    "lobes",
    "transient",
)
