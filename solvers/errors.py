"""Failures of a computation, each with what was reached, what was wanted and what to do."""

from headstock.geometry.errors import HeadstockError as HeadstockError


class ConvergenceError(HeadstockError):
    """An iteration or a solve did not reach its target residual."""


class AccuracyError(HeadstockError):
    """A result was computed but fails its own check."""


class ModelError(HeadstockError):
    """The model has no answer, such as a mechanism under a static load."""


class CompileError(HeadstockError):
    """A form could not be compiled; says what the compiler said, and how much room there is for its files."""
