"""Schema of the frequency response analysis."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from headstock.scene.schema.types import (
    Count,
    Flag,
    Frequency,
    Names,
    PortName,
    PositiveFrequency,
    RequestTable,
    problem,
)

Ports = Annotated[list[PortName], Field(min_length=1, max_length=100)]


class FrfTable(RequestTable):
    """Frequency response between points, or interfaces, from one frequency to another."""

    inputs: Ports | None = None
    outputs: Ports | None = None
    start: Annotated[Frequency, Field(alias="from")] = 0.0
    to: PositiveFrequency
    points: Annotated[Count, Field(ge=2, le=100_000)] = 401
    spacing: Literal["linear", "log"] = "linear"
    adaptive: Flag = True
    motion: Literal["receptance", "mobility", "accelerance"] = "receptance"
    poses: Names | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.start >= self.to:
            raise problem(f"begins at {self.start:g} Hz and ends at {self.to:g} Hz; write a lower `from`")
        if self.spacing == "log" and self.start == 0.0:
            raise problem('a log spacing cannot begin at 0 Hz; write from = "1 Hz"')
        return self
