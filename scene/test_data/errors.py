"""The error of files of test data."""

from headstock.geometry.errors import HeadstockError


class MeasurementError(HeadstockError):
    """A file of test data cannot be used; the message begins with file and line. Exit code 2."""
