"""Curves of a run that reports draw: over frequency, along a path, over time."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Answer, find_answers
from headstock.pipeline.answers.frf import PoseResponse, ResponseCurves, parse_curves
from headstock.pipeline.answers.path import PathCurves, PathResult, parse_path
from headstock.pipeline.answers.transient import TransientAnswer, TransientCurves, parse_transient
from headstock.pipeline.numbers.folders import read_results_file

type Curves = ResponseCurves | PathCurves | TransientCurves

# group of results.h5 to what reads one of its members by name
PARSERS: Mapping[str, Callable[[str, "h5py.Group"], Curves]] = {
    "frf": parse_curves,
    "path": lambda _, group: parse_path(group),
    "transient": parse_transient,
}


def collect_curves(answers: Iterable[Answer]) -> list[Curves]:
    """Return the curves of what a run found."""
    answers = tuple(answers)
    return [
        *(response.curves for response in find_answers(answers, PoseResponse)),
        *(feed.curves for path in find_answers(answers, PathResult) for feed in path.runs),
        *(history.curves for history in find_answers(answers, TransientAnswer)),
    ]


def read_curves(folder: Path) -> list[Curves]:
    """Return the curves in ``results.h5`` of a folder of results; empty without any.

    Raises:
        UnusableOutputError: The file is missing, damaged, of an earlier version or of another run than the
            summary.
    """
    return read_results_file(
        folder,
        lambda file: [
            parse(name, member)
            for group, parse in PARSERS.items()
            for name, member in file.get(group, {}).items()
        ],
    )


def find_curves[Kind: Curves](curves: Iterable[Curves], kind: type[Kind]) -> list[Kind]:
    """Return the curves of one kind, in the order of their stages."""
    return [each for each in curves if isinstance(each, kind)]
