"""What is to be computed of a machine: at most one request per analysis, whose own types stand in
``scene/analyses``.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar, Literal

from headstock.geometry.frames import FloatArray
from headstock.scene.reading.analysis_names import NAMES

LOAD = "load"  # direction of an input that is a load of the scene
Motors = Literal["locked", "controlled"]


class Request:
    """What is to be computed by one analysis.

    Attributes:
        analysis: Its name, that of its table in ``[analyses]``.
    """

    analysis: ClassVar[str]


@dataclass(frozen=True, init=False)
class Analyses:
    """What is to be computed: at most one request of each kind.

    Attributes:
        requests: In the order of ``NAMES``.
    """

    requests: tuple[Request, ...]

    def __init__(self, *requests: Request | None) -> None:
        """Keep the first request of each kind; None stands for none."""
        given = {request.analysis: request for request in reversed(requests) if request is not None}
        ordered = tuple(given[name] for name in NAMES if name in given)
        object.__setattr__(self, "requests", ordered)

    def get[R: Request](self, kind: type[R]) -> R | None:
        """Return the request of a kind; None where the analysis is not requested."""
        return next((request for request in self.requests if isinstance(request, kind)), None)

    def __getitem__[R: Request](self, kind: type[R]) -> R:
        """Return the request of a kind.

        Raises:
            KeyError: The analysis is not requested.
        """
        request = self.get(kind)
        if request is None:
            raise KeyError(kind.analysis)
        return request

    def __contains__(self, kind: type[Request]) -> bool:
        """Return whether an analysis is requested."""
        return self.get(kind) is not None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the analyses that are requested."""
        return tuple(request.analysis for request in self.requests)

    def keep(self, names: Collection[str]) -> "Analyses":
        """Return the requests of the named analyses."""
        return Analyses(*(request for request in self.requests if request.analysis in names))

    def drop(self, names: Collection[str]) -> "Analyses":
        """Return all requests but those of the named analyses."""
        return self.keep(set(self.names).difference(names))


def describe_grid(axes: tuple[tuple[str, FloatArray], ...]) -> str:
    """Return how many poses a grid has, and of which axes.

    Args:
        axes: Name and positions ``(n,)`` of each.
    """
    poses = " × ".join(str(len(values)) for _, values in axes)
    *others, last = (name for name, _ in axes)
    return f"{poses} poses of {', '.join(others)} and {last}"
