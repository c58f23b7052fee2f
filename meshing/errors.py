"""Failures of meshing and of reading meshes, each with numbers and a remedy."""

from headstock.geometry.errors import HeadstockError


class MeshError(HeadstockError):
    """A component cannot be meshed as described, or its mesh fails a check."""


class PartFileError(MeshError):
    """A part's file is none that can be meshed as it is chosen; the user chooses or exports
    another.
    """


class MeshQualityError(MeshError):
    """A mesh has unusable elements or misses a volume or area of its CAD shape; finer imprints and
    curved faces may mend it.
    """
