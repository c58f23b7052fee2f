"""What leaves for other programs: one record a format, and one of what is asked for."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

DEFAULT_STEP_S = 1e-3
SAMPLES = 0.5  # periods of the highest mode that a step may last: below, it is seen as it vibrates
ExportMotors = Literal["locked", "free", "controlled"]
MOTORS: dict[str, ExportMotors] = {"locked": "locked", "free": "free", "controlled": "controlled"}
WHOLE_MACHINE = ("space", "test")


@dataclass(frozen=True)
class ExportFormat:
    """A format in which something leaves.

    Attributes:
        of: What leaves: matrices of a reduced component (``body``), its ``mesh``, a state space of the
            machine (``space``), or its modes and responses as a test has them (``test``).
        endings: Of its file, the usual one first; of several files that of the first.
    """

    of: Literal["body", "mesh", "space", "test"]
    endings: tuple[str, ...]


EXPORT_FORMATS = {
    "h5": ExportFormat("body", (".h5",)),
    "op4": ExportFormat("body", (".op4",)),
    "dmig": ExportFormat("body", (".bdf",)),
    "abaqus": ExportFormat("body", ("_STIF1.mtx",)),
    "calculix": ExportFormat("body", (".sti",)),
    "mtx": ExportFormat("body", ("_K.mtx",)),
    "simscape": ExportFormat("body", (".mat",)),
    "fmu3": ExportFormat("space", (".fmu",)),
    "fmu2": ExportFormat("space", (".fmu",)),
    "mat": ExportFormat("space", (".mat",)),
    "npz": ExportFormat("space", (".npz",)),
    "uff": ExportFormat("test", (".uff", ".unv", ".uf")),
    "msh": ExportFormat("mesh", (".msh",)),
    "bdf": ExportFormat("mesh", (".bdf", ".nas")),
    "xdmf": ExportFormat("mesh", (".xdmf", ".xmf")),
    "med": ExportFormat("mesh", (".med",)),
    "exo": ExportFormat("mesh", (".exo", ".e", ".ex2")),
}


def find_share_fault(share: float) -> str:
    """Say why an error is no share of a response; empty where it is one."""
    return "" if 0.0 < share < 1.0 else f'is {share:g}; write a share of 1, such as "1 %"'


def find_step_fault(step: float, highest_hz: float) -> str:
    """Say why a step [s] samples a mode less than twice in a period; empty where it does not."""
    if step * highest_hz < SAMPLES:
        return ""
    shortest = f"write a step below {1e3 * SAMPLES / highest_hz:.3g} ms"
    return f"{1e3 * step:g} ms is too long for a mode at {highest_hz:.4g} Hz; {shortest}"


def list_formats(*kinds: str) -> str:
    """Return the names of the formats in which one of some kinds of things leaves."""
    return ", ".join(name for name, form in EXPORT_FORMATS.items() if form.of in kinds)


@dataclass(frozen=True)
class Export:
    """What leaves, and in which format.

    Attributes:
        component: Which one leaves; None for the whole machine, or for the only one with a shape.
        pose: Of the machine; None for the first.
        hz: Modes up to here become states [Hz].
        step: Over which inputs are constant [s]; None for continuous time, and of an FMU for 1 ms, or
            less where a mode is too fast for it.
        balanced: Error that leaving out states may cause, as a share of the largest response; None
            to keep all states.
        motors: Of a state space: locked; free, with their forces as inputs; under control, with set
            points as inputs.
        travel: Axes whose positions may change.
        error: Of the frequency response in poses along the travel that is aimed at; None for 1 %.
        file: What is written, of several files what their names begin with; None for the usual name.
    """

    format: str
    component: str | None = None
    pose: str | None = None
    hz: float | None = None
    step: float | None = None
    balanced: float | None = None
    motors: ExportMotors = "locked"
    travel: tuple[str, ...] = ()
    error: float | None = None
    file: str | None = None

    @property
    def kind(self) -> ExportFormat:
        """The format itself."""
        return EXPORT_FORMATS[self.format]

    def name_file(self, name: str) -> Path:
        """Return what is written, ``name`` and the usual ending where no file is named."""
        if self.file is not None:
            return Path(self.file)
        several = self.kind.endings[0].startswith("_")
        return Path(
            f"{name}{Path(self.kind.endings[0]).suffix if several else self.kind.endings[0]}"
        )

    def find_faults(self) -> Iterator[tuple[str, str]]:
        """Yield what does not go together: the key at fault, empty where one is missing, and what to
        write.
        """
        if self.format not in EXPORT_FORMATS:
            yield (
                "format",
                f"format {self.format!r} is unknown; of a component: {list_formats('body', 'mesh')}; "
                f"of the machine: {list_formats(*WHOLE_MACHINE)}",
            )
            return
        kind = self.kind
        whole, space = kind.of in WHOLE_MACHINE, kind.of == "space"
        spaces = list_formats("space")
        step_fault = find_step_fault(self.step or 0.0, self.hz or 0.0)
        named = Path(self.file or f"x{kind.endings[0]}")
        rules = (
            (
                whole and self.component is not None,
                "component",
                f"{self.format} is of the whole machine; leave out the component",
            ),
            (
                kind.of == "body" and self.component is None,
                "",
                f"{self.format} is of one component; name it",
            ),
            (
                space and self.hz is None,
                "",
                f'{self.format} is a state space with modes up to a frequency; write hz, such as "500 Hz"',
            ),
            *(
                (
                    not space and bool(getattr(self, name)),
                    name,
                    f"{self.format} takes no {name}, which goes with {spaces}",
                )
                for name in ("hz", "step", "balanced", "travel", "error")
            ),
            (
                not space and self.motors != "locked",
                "motors",
                f"{self.format} takes no motors, which go with {spaces}",
            ),
            (
                self.motors == "free" and self.balanced is not None,
                "balanced",
                "free motors have no steady response, which balanced truncation needs; leave out balanced",
            ),
            (
                not whole and self.pose is not None,
                "pose",
                f"{self.format} takes no pose, which goes with {list_formats(*WHOLE_MACHINE)}",
            ),
            (
                bool(self.travel and self.balanced),
                "balanced",
                "a balanced state space is that of one pose; leave out balanced or travel",
            ),
            (
                bool(self.travel) and self.motors == "controlled",
                "motors",
                "controllers are not exported where axes travel; write free motors, and close the loops around them",
            ),
            (
                bool(self.travel and step_fault),
                "step",
                f"{step_fault}, or a lower hz",
            ),
            (
                bool(self.error) and not self.travel,
                "error",
                "error goes with travel, the axes whose positions may change",
            ),
            (
                kind.of in ("mesh", "test") and named.suffix.lower() not in kind.endings,
                "file",
                f"file {self.file!r}: files of {self.format} end in {', '.join(kind.endings)}",
            ),
        )
        yield from ((key, text) for wrong, key, text in rules if wrong)
