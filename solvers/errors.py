"""Failures of a computation, each with what was reached, what was wanted and what to do."""

from headstock.geometry.errors import HeadstockError as HeadstockError


class ConvergenceError(HeadstockError):
    """An iteration or a solve did not reach its target residual."""


class AccuracyError(HeadstockError):
    """A result was computed but fails its own check."""


class ModelError(HeadstockError):
    """The model has no answer, such as a mechanism under a static load."""


class CompileError(HeadstockError):
    """A form could not be compiled; says what the compiler said, and how much room there is for its
    files.
    """


class UnstableControlError(ModelError):
    """The control of an axis makes a motion grow; there is no time run to make of it."""

    def __init__(self, message: str, *, axis: str, frequency_hz: float) -> None:
        super().__init__(message)
        self.axis = axis
        self.frequency_hz = frequency_hz
