"""Running validation cases by name or group."""

import difflib
from collections.abc import Callable, Sequence

from mpi4py import MPI

from headstock.geometry.errors import HeadstockError
from headstock.validation.case_registry import CASES, Case, case_names, group_names
from headstock.validation.references.rows import ValidationRow, failed_computation


class UnknownCaseError(ValueError):
    """A case or group was asked for that does not exist; the message lists those that do (bad input, exit code 2)."""


def select_cases(names: Sequence[str]) -> list[Case]:
    """The cases that names of cases or groups stand for, each once, in registry order; all when no name is given.

    A case that takes very long is run only under its own name.

    Raises:
        UnknownCaseError: A name is neither a case nor a group.
    """
    known = {*case_names(), *group_names()}
    unknown = [name for name in names if name.lower() not in known]
    if unknown:
        hints = difflib.get_close_matches(unknown[0].lower(), sorted(known), n=1)
        hint = f" (did you mean {hints[0]!r}?)" if hints else ""
        raise UnknownCaseError(
            f"unknown validation case {unknown[0]!r}{hint}; groups: {', '.join(group_names())}; cases: {', '.join(case_names())}"
        )
    wanted = {name.lower() for name in names}
    return [case for case in CASES if case.name in wanted or ((not wanted or case.group in wanted) and not case.on_request)]


def run_validation(
    names: Sequence[str], *, comm: MPI.Comm, on_case: Callable[[Case, list[ValidationRow]], None] | None = None
) -> list[ValidationRow]:
    """Compute the rows of cases and groups.

    A case whose computation ends with a named error yields one failed row that carries the error's text, so that the others are
    still computed.

    Args:
        names: Cases or groups; empty for all.
        comm: Communicator of the computations; collective.
        on_case: Called after each case, for progress.

    Raises:
        UnknownCaseError: A name is neither a case nor a group.
    """
    rows: list[ValidationRow] = []
    for case in select_cases(names):
        try:
            found = case.compute(comm)
        except HeadstockError as error:
            found = [failed_computation(case.name, f"{type(error).__name__}: {error}")]
        if on_case is not None:
            on_case(case, found)
        rows += found
    return rows
