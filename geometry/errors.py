"""The base of every error that ends a computation (exit code 1)."""


class HeadstockError(Exception):
    """A computation failed for a stated reason; the command line exits with 1."""
