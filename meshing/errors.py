"""Failures of meshing and of reading meshes, each with numbers and a remedy."""

from headstock.geometry.errors import HeadstockError


class MeshError(HeadstockError):
    """A component cannot be meshed as described, or its mesh fails a check."""


class MeshQualityError(MeshError):
    """A mesh has unusable elements or misses a volume or area of its CAD shape; finer imprints and curved faces may mend it."""
