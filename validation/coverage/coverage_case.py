"""What suites share that ask how often ± covers the truth: measurements kept in the store, runs with an
empty one, and rows of what is covered.
"""

import contextlib
import dataclasses
import hashlib
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import headstock.geometry
import headstock.meshing
import headstock.reduction
import headstock.solvers
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import Answer, find_answers
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.content_keys import code_fingerprint
from headstock.pipeline.storage.store import Store, default_store_root, read_entry, write_entry
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.estimates.frequency_errors import TruncatedPart, truncated_parts
from headstock.reduction.estimates.mesh_errors import MeshedPart
from headstock.reduction.estimates.response_errors import (
    ErrorSources,
    ResponseSpace,
    project_response,
)
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene
from headstock.solvers.linear.frequency_response import FrfModel, prepare_frf
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.mpi import MPI
from headstock.solvers.second_order import Channel, ComplexArray, input_columns, output_rows
from headstock.validation.references.rows import ValidationRow, compare_bound

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

LAYERS = (headstock.geometry, headstock.meshing, headstock.solvers, headstock.reduction)
# the error of a fine mesh is known within this share of its estimate: estimates came out 0.7 to 1.9
# times the true errors
UNSURE = 0.5
SURE = 0.1  # of ±: what may be unknown of a truth
COVERED, COVERED_RESPONSES = 0.95, 0.9
VISIBLE = 1e-2  # 40 dB below the highest peak
# of the visible lines of a response: with fewer whose truth is sure enough it is set aside
LINES_NEEDED = 0.5
CHANNELS: tuple[Channel, ...] = (("tcp", "x"), ("tcp", "y"), ("tcp", "z"))


FREQUENCY, COMPLIANCE = 0.0, 1.0  # kinds of numbers


def compare_number(
    kind: float, value: float, truth: float, *, estimate: float | None, left: float
) -> list[float]:
    """Return a number beside its truth ``(4,)``: its kind; and over the number, its true error, its ± and
    how well the truth is known.

    Args:
        truth: Corrected by what its own estimate says is left.
        estimate: ±; None for none.
        left: What the estimate of the truth says.
    """
    size = np.nan if estimate is None else estimate / value
    return [kind, abs(value - truth) / value, size, UNSURE * left / value]


@dataclass(frozen=True)
class CoverageCase:
    """A suite of numbers with ± beside their truth.

    Attributes:
        clear: True errors above which their ratio to ± means something.
        largest_median: Of ± over the true error.
    """

    clear: float
    largest_median: float

    def evaluate(
        self,
        what: str,
        errors: FloatArray,
        estimates: FloatArray,
        note: str,
        *,
        uncovered: int = 0,
        sizes: FloatArray | float = 1.0,
    ) -> list[ValidationRow]:
        """Return a row for the numbers that ± does not cover, and one for its size.

        Args:
            what: Beginning of the rows' names; empty for none.
            errors: ``(n,)`` true errors of numbers whose truth is sure enough.
            estimates: ``(n,)`` their ±.
            uncovered: Numbers that count as not covered, beside these.
            sizes: ``(n,)`` of the numbers, where errors are not relative.
        """
        start = f"{what}: " if what else ""
        missed = int((~(errors <= estimates)).sum()) + uncovered
        plain = errors > self.clear * sizes
        ratios = estimates[plain] / errors[plain]
        low, middle, high = np.quantile(ratios, [0.1, 0.5, 0.9])
        return [
            compare_bound(
                f"{start}share of numbers that ± does not cover",
                missed / (len(errors) + uncovered),
                1.0 - COVERED,
                note,
            ),
            compare_bound(
                f"{start}± over true error, median",
                middle,
                self.largest_median,
                f"10 .. 90 %: {low:.2f} .. {high:.2f}; {plain.sum()} errors above {self.clear:g}",
            ),
        ]

    def evaluate_responses(self, what: str, shares: FloatArray, note: str = "") -> ValidationRow:
        """Return a row for the frequency responses without 95 % of their lines covered.

        Args:
            what: Beginning of the row's name.
            shares: ``(m,)`` as :func:`cover_lines` gives them; NaN for responses that are set aside.
        """
        known = shares[~np.isnan(shares)]
        return compare_bound(
            f"{what}: share of frequency responses without 95 % of their lines covered",
            1.0 - float((known >= COVERED).mean()),
            1.0 - COVERED_RESPONSES,
            f"{len(known)} responses, {len(shares) - len(known)} more whose truth is not sure enough; lines within 40 dB of"
            f" the highest peak{note}",
        )


@dataclass(frozen=True)
class Scratch:
    """A folder with a store of its own, in which scenes are run."""

    folder: Path

    def load(self, text: str, **settings: Any) -> Scene:
        """Load the scene of a text.

        Args:
            settings: As of ``load_scene``.
        """
        path = self.folder / "machine.toml"
        path.write_text(text)
        return load_scene(path, **settings)

    def run(self, scene: Scene, comm: MPI.Comm = MPI.COMM_SELF) -> Results:
        """Run all stages of a scene."""
        return run_scene(
            scene, self.folder / "results", comm=comm, store=Store(self.folder / "store")
        )

    def answer[Found: Answer](self, scene: Scene, kind: type[Found]) -> Found:
        """Run a scene and return its only answer of a kind."""
        (answer,) = find_answers(self.run(scene).answers, kind)
        return answer


@contextlib.contextmanager
def open_scratch() -> Iterator[Scratch]:
    """Make a folder for the body of a ``with`` statement."""
    with tempfile.TemporaryDirectory(prefix="headstock-") as name:
        yield Scratch(Path(name))


@dataclass(frozen=True, eq=False)
class CoverageSuite[Item, Measured: "DataclassInstance"]:
    """What is drawn, measured and compared with the truth. What was measured is kept in the store: a
    suite that was stopped goes on.

    Attributes:
        measure: Draws an item in a folder, and measures its numbers and their truth.
        kind: Type of what is measured.
        texts: What an item is and how it is measured; with another text it is measured anew.
        evaluate: Makes rows of what was measured of some items, whose names begin in one way.
    """

    measure: Callable[[Item, Scratch], Measured]
    kind: type[Measured]
    texts: Callable[[Item], Sequence[str]]
    evaluate: Callable[[str, Sequence[Measured]], Iterable[ValidationRow]]

    def compare(self, items: Mapping[str, Iterable[Item]]) -> Iterator[ValidationRow]:
        """Return the rows of items.

        Args:
            items: By how the names of their rows begin.
        """
        for what, some in items.items():
            yield from self.evaluate(what, [self._recall(item) for item in some])

    def compare_seeds(
        self: "CoverageSuite[int, Measured]", seeds: range
    ) -> Iterator[ValidationRow]:
        """Return the rows of seeds that nothing was fitted on or compared with before."""
        measured = [self._recall(seed) for seed in seeds]
        yield from self.evaluate(f"new, seeds {seeds[0]} to {seeds[-1]}", measured)

    def _recall(self, item: Item) -> Measured:
        def draw() -> Measured:
            with open_scratch() as scratch:
                return self.measure(item, scratch)

        return keep_measured(measurement_key(*self.texts(item)), self.kind, draw)


def cover_lines(
    found: ComplexArray, right: ComplexArray, *, total: FloatArray, doubt: FloatArray
) -> FloatArray:
    """Return the share that ± covers of the visible lines of responses whose truth is sure enough
    ``(k,)``; NaN where these are too few.

    Args:
        found: ``(n, k)`` lines of responses.
        right: ``(n, k)`` the true ones.
        total: ``(n, k)`` ±.
        doubt: ``(n, k)`` how well the truth is known.
    """
    visible = np.abs(right) >= VISIBLE * np.abs(right).max(axis=0)
    sure = visible & (doubt <= SURE * total)
    covered = sure & (np.abs(found - right) <= total)
    shares = covered.sum(axis=0) / np.maximum(sure.sum(axis=0), 1)
    return np.where(sure.sum(axis=0) >= LINES_NEEDED * visible.sum(axis=0), shares, np.nan)


def prepare_responses(
    coupled: CoupledMachine,
    modes: ModalResult,
    *,
    loss_factor: float,
    highest_hz: float,
    truncated: Mapping[str, TruncatedPart] | None = None,
    meshed: Mapping[str, MeshedPart] | None = None,
) -> tuple[FrfModel, ResponseSpace]:
    """Return a machine whose responses at its tool are to be evaluated, and in the space in which their
    errors are estimated.

    Args:
        modes: Of the machine without damping.
        loss_factor: Of all its components, in place of its damping.
        highest_hz: Up to where it will be asked.
        truncated: Components that leave modes out; None for those of the machine.
        meshed: Components whose mesh has an estimate; None for none.
    """
    lossy = dataclasses.replace(
        coupled.system, damping=None, hysteretic=loss_factor * coupled.system.stiffness
    )
    sources = ErrorSources(
        truncated_parts(coupled) if truncated is None else truncated,
        meshed or {},
        dict.fromkeys(coupled.layout.superelements, loss_factor),
    )
    channels = (input_columns(lossy, CHANNELS), output_rows(lossy, CHANNELS))
    space = project_response(lossy, sources, modes, channels, highest_hz)
    return prepare_frf(lossy, inputs=CHANNELS, outputs=CHANNELS, modes=modes), space


def measurement_key(*words: str) -> str:
    """Return the key of a measurement by the code of the program and by words."""
    code = (*map(code_fingerprint, LAYERS), Path(__file__).read_text(), *words)
    return hashlib.sha256("\0".join(code).encode()).hexdigest()


def keep_measured[Measured: "DataclassInstance"](
    key: str, kind: type[Measured], measure: Callable[[], Measured]
) -> Measured:
    """Return what is measured, from the store where it is there: a suite that was stopped goes on."""
    store = Store(default_store_root())
    known = read_entry(store, key, kind).value
    if known is None:
        known = measure()
        write_entry(store, key, known)
    return known


def run_afresh(scene: Scene, comm: MPI.Comm = MPI.COMM_SELF) -> Results:
    """Run all stages of a scene with an empty store."""
    with open_scratch() as scratch:
        return scratch.run(scene, comm)
