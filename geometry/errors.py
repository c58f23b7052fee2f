"""The errors that end a computation (exit code 1), from the base of all to those of mechanisms."""

import unicodedata


def printable(text: str) -> str:
    """The text without what a terminal would obey (escape sequences, line ends, changes of direction): each such character as ``?``."""
    return "".join("?" if unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Zl", "Zp") else letter for letter in text)


class HeadstockError(Exception):
    """A computation failed for a stated reason; the command line exits with 1."""


class ClosureError(HeadstockError):
    """The loops of a mechanism cannot be closed."""


class PoseError(HeadstockError):
    """A pose that a mechanism cannot take; the kinds below say why."""


class UnreachablePoseError(PoseError):
    """No assembly of the mechanism reaches the pose."""


class SingularPoseError(PoseError):
    """The mechanism loses a motion, or gains one, in the pose."""


class JointLimitError(PoseError):
    """The pose needs a joint beyond its limits."""
