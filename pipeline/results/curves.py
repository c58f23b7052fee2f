"""Curves of a run that reports draw: over frequency, along a path, over time."""

from collections.abc import Iterable
from pathlib import Path

from headstock.pipeline.answers.answer import Answer, find_answers
from headstock.pipeline.answers.frf import PoseResponse, ResponseCurves
from headstock.pipeline.answers.path import PathCurves, PathResult
from headstock.pipeline.answers.transient import TransientAnswer, TransientCurves
from headstock.pipeline.results.files import open_results

type Curves = ResponseCurves | PathCurves | TransientCurves


def collect_curves(answers: Iterable[Answer]) -> list[Curves]:
    """Return the curves of what a run found."""
    answers = tuple(answers)
    return [
        *(response.curves for response in find_answers(answers, PoseResponse)),
        *(feed.curves for path in find_answers(answers, PathResult) for feed in path.runs),
        *(history.curves for history in find_answers(answers, TransientAnswer)),
    ]


def read_curves(folder: Path) -> list[Curves]:
    """Return the curves of a folder of results; empty without any.

    Raises:
        UnusableOutputError: The files are missing, damaged, of another version or of different runs.
    """
    return collect_curves(open_results(folder).answers)


def find_curves[Kind: Curves](curves: Iterable[Curves], kind: type[Kind]) -> list[Kind]:
    """Return the curves of one kind, in the order of their stages."""
    return [each for each in curves if isinstance(each, kind)]
