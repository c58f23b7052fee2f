"""Failures of meshing and of reading meshes, each with numbers and a remedy."""

from headstock.geometry.errors import HeadstockError


class MeshError(HeadstockError):
    """A component cannot be meshed as described, or its mesh fails a check."""


class MeshTimeError(MeshError):
    """Meshing took more processor time than it may."""


class PartFileError(MeshError):
    """A part's file cannot be meshed as chosen; the user chooses or exports another."""


class PatchError(PartFileError):
    """A patch selects nothing that a part's file holds, or too little of it.

    Attributes:
        group: The interface, ``support:NAME`` or ``load:NAME`` it belongs to.
        patch: Which patch of the group, from 0; None for all of them together.
    """

    def __init__(self, message: str, group: str = "", patch: int | None = None) -> None:
        """Keep where the patch is described (an error that ranks share is made of its text
        first).
        """
        super().__init__(message)
        self.group = group
        self.patch = patch


class MeshQualityError(MeshError):
    """A mesh has unusable elements or misses a volume or area of its CAD shape; finer imprints and
    curved faces may mend it.
    """
