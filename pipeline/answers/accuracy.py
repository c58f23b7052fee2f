"""How settings were chosen for a stated accuracy, and what rigid and segmented bodies and the interfaces of rigid
joints leave out, as results.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.numbers.numbers import Key


@dataclass(frozen=True)
class BodyChoice:
    """Which model of a body was chosen, why, and what the next better one would cost and bring."""

    model: str
    why: str
    following: str


@dataclass(frozen=True)
class AccuracyRound:
    """A round of a search for settings.

    Attributes:
        quantity: The number that is furthest off.
        error: By how much of it; None where nobody knows.
        reason: Why something is refined, in plain words.
        owner: Component that makes most of the error, and how; None where no component is meshed.
        changes: Component to what is changed of its settings; None where the search ends.
    """

    quantity: str
    error: float | None
    reason: str
    owner: tuple[str, str] | None = None
    changes: Mapping[str, str] | None = None

    def summarise(self) -> dict[str, Any]:
        """Return it as it stands in ``summary.json``: without an owner where no component is meshed, without
        changes where the search ended with it.
        """
        owner, source = self.owner or (None, None)
        entries = {
            "quantity": self.quantity,
            "error": self.error,
            "reason": self.reason,
            "owner": owner,
            "source": source,
            "changes": None if self.changes is None else dict(self.changes),
        }
        return {key: value for key, value in entries.items() if value is not None or key == "error"}


@dataclass(frozen=True)
class ResponseAccuracy:
    """The peak or level of a frequency response that is furthest off.

    Attributes:
        quantity: Which one, in plain words.
        error: By how much of it; None where nobody knows.
        met: That is within what was asked for.
    """

    quantity: str
    error: float | None
    met: bool


@dataclass(frozen=True)
class AccuracyAnswer(Answer):
    """How a search for settings went.

    Attributes:
        requested: Largest relative error allowed.
        settings: Component to its mesh and modes in the end, in plain words.
        values: The same as values of the scene by dotted key, which ``load_scene`` takes.
        reason: Why the accuracy was not reached; empty when it was.
        models: Body to what was chosen among its models; empty where none was cheaper.
        responses: Peaks and levels of frequency responses; None without any.
    """

    requested: float
    rounds: tuple[AccuracyRound, ...]
    settings: dict[str, str]
    values: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ""
    models: Mapping[str, BodyChoice] = field(default_factory=dict)
    responses: ResponseAccuracy | None = None
    entry: ClassVar[str] = "accuracy"
    keys: ClassVar[str] = """accuracy(requested estimated met reason rounds[].*.** settings.*
        values.*.** models.*.* responses(quantity error met))"""

    @property
    def met(self) -> bool:
        """The accuracy was reached."""
        return not self.reason

    @property
    def estimated(self) -> float | None:
        """Relative error of the worst number in the last round."""
        return self.rounds[-1].error

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``."""
        summary: Entry = {
            "requested": self.requested,
            "estimated": self.estimated,
            "met": self.met,
            "reason": self.reason,
            "rounds": [one.summarise() for one in self.rounds],
            "settings": self.settings,
            "values": dict(self.values),
        }
        if self.models:
            summary["models"] = {
                name: {"model": body.model, "why": body.why, "next": body.following}
                for name, body in self.models.items()
            }
        if self.responses is not None:
            summary["responses"] = asdict(self.responses)
        return summary


@dataclass(frozen=True)
class BodyModel:
    """A body that is no finite element model, and the one that it was compared with."""

    fidelity: str
    compared_with: str


@dataclass(frozen=True)
class ModelErrorsAnswer(Answer):
    """What rigid and segmented bodies leave out.

    Attributes:
        changes: What all bodies change together, over the number; None where it has no partner.
        missing: Modes that the machine of simple bodies lacks, in plain words.
        left_out: Bodies of which nothing is known, with the reason.
    """

    bodies: dict[str, BodyModel]
    changes: Mapping[Key, float | None]
    alone: Mapping[str, Mapping[Key, float | None]]
    missing: tuple[str, ...] = ()
    left_out: dict[str, str] = field(default_factory=dict)
    entry: ClassVar[str] = "model_errors"
    keys: ClassVar[str] = """model_errors(bodies.*(fidelity compared_with largest number)
        numbers.*(change bodies.*) missing[] left_out.*)"""

    def largest(self, body: str) -> tuple[str, float]:
        """Return the number that a body alone changes most, and by how much of it."""
        found = {
            str(key): abs(share)
            for key, share in self.alone.get(body, {}).items()
            if share is not None
        }
        number = max(found, key=lambda name: found[name], default="")
        return number, found.get(number, 0.0)

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``."""
        bodies: dict[str, Entry] = {}
        for name, body in self.bodies.items():
            number, largest = self.largest(name)
            bodies[name] = {
                "fidelity": body.fidelity,
                "compared_with": body.compared_with,
                "largest": largest,
                "number": number,
            }
        return {
            "bodies": bodies,
            "numbers": {
                str(key): {
                    "change": change,
                    "bodies": {
                        body: shares[key] for body, shares in self.alone.items() if key in shares
                    },
                }
                for key, change in self.changes.items()
            },
            "missing": list(self.missing),
            "left_out": self.left_out,
        }


@dataclass(frozen=True)
class JointShapes:
    """A rigid joint: its interfaces, their deformation shapes, and how many it was compared with."""

    between: str
    shapes: int
    compared_with: int


@dataclass(frozen=True)
class InterfaceErrorsAnswer(Answer):
    """What the interfaces of rigid joints leave out.

    Attributes:
        parts: Joint to its part of how far numbers may be off, over the number.
        lines: Joint to the same of the line of each frequency response that changes most, over the
            largest entry of that line.
        left_out: Joints of which nothing is known, with the reason.
    """

    joints: dict[str, JointShapes]
    parts: Mapping[Key, Mapping[str, float]]
    lines: Mapping[Key, Mapping[str, float]] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    entry: ClassVar[str] = "interface_errors"
    keys: ClassVar[str] = """interface_errors(joints.*(between shapes compared_with largest number)
        numbers.*.* lines.*.* left_out.*)"""

    def largest(self, joint: str) -> tuple[Key | None, float]:
        """Return the number that a joint puts off most, and by how much of it; a line of a response only
        where there is nothing else, since next to a peak little moves it much.
        """
        found = {
            number: parts.get(joint, 0.0) for number, parts in (self.parts or self.lines).items()
        }
        number = max(found, key=lambda key: found[key], default=None)
        return number, found.get(number, 0.0) if number is not None else 0.0

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``."""
        joints: dict[str, Entry] = {}
        for name, joint in self.joints.items():
            number, largest = self.largest(name)
            joints[name] = {
                "between": joint.between,
                "shapes": joint.shapes,
                "compared_with": joint.compared_with,
                "largest": largest,
                "number": "" if number is None else str(number),
            }
        return {
            "joints": joints,
            "numbers": {str(key): dict(parts) for key, parts in self.parts.items()},
            "lines": {str(key): dict(parts) for key, parts in self.lines.items()},
            "left_out": dict(self.left_out),
        }
