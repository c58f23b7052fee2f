"""Schema of studies: which keys of a scene are varied, and which results are watched."""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from headstock.scene.reading.watch_paths import MEASURED_NAMES, WatchError, parse_watch
from headstock.scene.schema.types import Count, Flag, Name, Names, StrictTable, Text, one_of, problem
from headstock.scene.studies import MAX_POINTS, TRUTH

MAX_REPEATS = 100

Values = Annotated[list[Any], Field(min_length=1, max_length=MAX_POINTS)]
Varied = Annotated[dict[str, Values], Field(min_length=1)]


def _check_watches(paths: list[str]) -> list[str]:
    for path in paths:
        try:
            parse_watch(path)
        except WatchError as error:
            raise problem(str(error)) from error
    return paths


Watches = Annotated[Names, AfterValidator(_check_watches)]


def _check_lengths(vary: dict[str, list[Any]], *, pairwise: bool) -> None:
    if not pairwise and math.prod(map(len, vary.values())) > MAX_POINTS:
        raise problem(f"has more than {MAX_POINTS} points; vary fewer keys at once, or write pairwise = true")
    lengths = {key: len(values) for key, values in vary.items()}
    if pairwise and len(set(lengths.values())) > 1:
        shown = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        raise problem(
            f"pairwise takes the first values together, then the second ones: lists must be as long as each other; {shown}"
        )


class FamilyTable(StrictTable):
    """A named part of a study: settings that are the same in all its points, and what is varied."""

    label: Text | None = None
    set: dict[str, Any] = {}
    vary: Varied
    pairwise: Flag = False
    analyses: Names | None = None
    other_model: Flag = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        _check_lengths(self.vary, pairwise=self.pairwise)
        return self


class StudyTable(StrictTable):
    """Keys of the scene that are varied and results that are watched: every combination is one point, computed like `run` would."""

    model_config = one_of("vary", "families")

    vary: Varied | None = None
    set: dict[str, Any] = {}
    pairwise: Flag = False
    families: dict[Name, FamilyTable] = {}
    watch: Watches | None = None
    analyses: Names | None = None
    store: Literal["warm", "cold"] = "warm"
    repeats: Annotated[Count, Field(le=MAX_REPEATS)] = 1
    reference: Literal["kono-cantilever", "kono-fixed-beam"] | None = None
    truth: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.vary is None) == (not self.families):
            raise problem(
                'needs either vary or families; write vary = { "components.NAME.mesh.size" = ["50 mm", "25 mm"] }'
                if self.vary is None
                else "gives both vary and families; move vary into a family"
            )
        if self.watch is None and self.reference is None:
            raise problem('watches nothing; write watch = ["modal.frequencies_hz[0:6]", "seconds"]')
        if self.truth is not None and all(parse_watch(path).steps[0] in MEASURED_NAMES for path in self.watch or ()):
            raise problem('holds nothing against its truth; write watch = ["modal.frequencies_hz[0:6]"]')
        if TRUTH in self.families:
            raise problem(f"calls a family {TRUTH!r}, which is the name of the run that the others are held against")
        _check_lengths(self.vary or {}, pairwise=self.pairwise)
        return self
