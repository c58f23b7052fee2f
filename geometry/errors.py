"""The errors that end a computation (exit code 1), from the base of all to those of mechanisms."""

import errno
import resource
import unicodedata

# what libraries say that got no memory, whatever class they raise
OUT_OF_MEMORY = (
    "MemoryError",
    "bad_alloc",
    "annot allocate memory",
    "unable to map",
    "failed to map segment",
)
PETSC_OUT_OF_MEMORY = 55
# address space for the libraries; with less the BLAS waits for its work space and never gives up
LEAST_MEMORY_BYTES = 768 << 20


def printable(text: str) -> str:
    """Return the text without what a terminal would obey (escape sequences, line ends, changes of
    direction): each such character as ``?``.
    """
    return "".join(
        "?" if unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Zl", "Zp") else letter
        for letter in text
    )


class HeadstockError(Exception):
    """A computation failed for a stated reason; the command line exits with 1."""


class OutOfMemoryError(HeadstockError):
    """A computation needed more memory than the machine has or the calling shell allows."""


def out_of_memory(what: str) -> OutOfMemoryError:
    """Return the error of a piece of work, with what to do."""
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    bound = (
        ""
        if allowed == resource.RLIM_INFINITY
        else f"this shell allows {allowed / 2**30:.3g} GiB (ulimit -v): allow more, or "
    )
    return OutOfMemoryError(
        f"{what} needed more memory than there is; {bound}write a larger mesh size or keep fewer modes"
    )


def require_least_memory() -> None:
    """Try that the calling shell allows enough memory to load the libraries.

    Raises:
        OutOfMemoryError: It does not.
    """
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    if allowed != resource.RLIM_INFINITY and allowed < LEAST_MEMORY_BYTES:
        raise OutOfMemoryError(
            f"this shell allows {allowed / 2**30:.3g} GiB of address space (ulimit -v): allow at least {LEAST_MEMORY_BYTES / 2**30:g} GiB"
        )


def lacks_memory(error: BaseException | None) -> bool:
    """Return whether an error, or one that it arose from, says that there was no memory."""
    while error is not None:
        if isinstance(error, MemoryError) or getattr(error, "ierr", None) == PETSC_OUT_OF_MEMORY:
            return True
        if isinstance(error, OSError) and error.errno == errno.ENOMEM:
            return True
        if any(text in str(error) for text in OUT_OF_MEMORY):
            return True
        error = error.__cause__ or error.__context__
    return False


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


class NumberNameError(HeadstockError, KeyError):
    """No number has this name; the message lists those that exist."""

    def __str__(self) -> str:
        return str(self.args[0])
