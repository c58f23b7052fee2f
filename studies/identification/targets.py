"""What an identification is asked for: targets per variant and pose, and parameters with bounds and
priors. SI units.
"""

from dataclasses import dataclass

from headstock.reduction.coupling.slopes import ObservedDof
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.units import Dimension
from headstock.studies.identification.schema import FitTable


@dataclass(frozen=True)
class ShapeTarget:
    """A mode shape as motions at places, compared by MAC.

    Attributes:
        entries: ``(observer, dof, value)``; observers are points, interfaces
            (``component.interface``) or components.
        tolerance: Standard deviation of ``sqrt(1 - MAC)``.
        described: It comes from a description in words (which bodies turn), not from measured
            vectors.
    """

    entries: tuple[tuple[str, int, float], ...]
    tolerance: float
    described: bool


@dataclass(frozen=True)
class ModeTarget:
    """A measured natural frequency.

    Attributes:
        frequency_hz: [Hz].
        sigma: Standard deviation of its logarithm, weight counted.
        hold_out: Predicted, not fitted.
        number: Of the mode that meets it, from 1 with those below the floor; None for any mode.
    """

    name: str
    frequency_hz: float
    sigma: float
    shape: ShapeTarget | None = None
    hold_out: bool = False
    number: int | None = None


@dataclass(frozen=True)
class ComplianceTarget:
    """A measured compliance.

    Attributes:
        motion: That is measured, along x, y or z.
        value: [m/N].
        sigma: Standard deviation relative to the value, weight counted.
        either_sign: Only its size was measured.
        hold_out: Predicted, not fitted.
    """

    name: str
    motion: ObservedDof
    force: ObservedDof
    value: float
    sigma: float
    either_sign: bool = False
    hold_out: bool = False

    @property
    def logarithmic(self) -> bool:
        """Its sign is certain, so that the ratio of model and measurement has a logarithm."""
        return self.motion == self.force or self.either_sign


@dataclass(frozen=True)
class ModeLimit:
    """At most so many modes below a frequency [Hz]; sigma of the logarithm by which the next one
    may miss it.
    """

    modes: int
    below_hz: float
    sigma: float


@dataclass(frozen=True)
class TargetCase:
    """What was measured in one variant and pose.

    Attributes:
        variant: Of the scene; None for the scene as written.
        pose: Name of a pose of the scene; None for its first.
        floor_hz: Modes below are none of the targets (rigid-body modes, the machine on its mounts).
    """

    name: str
    variant: str | None
    pose: str | None
    floor_hz: float
    modes: tuple[ModeTarget, ...]
    compliances: tuple[ComplianceTarget, ...]
    limit: ModeLimit | None = None

    @property
    def most_modes(self) -> int:
        """Number of modes that its targets take at least, those below the floor among them."""
        return max(len(self.modes), *(target.number or 0 for target in self.modes), 0)

    @property
    def held_out(self) -> tuple[bool, ...]:
        """Of each target, modes first: whether it is predicted and not fitted."""
        return (
            *(target.hold_out for target in self.modes),
            *(target.hold_out for target in self.compliances),
        )


@dataclass(frozen=True)
class KeyRule:
    """How one scene key follows a parameter p with reference r.

    Attributes:
        kind: ``set``: factor p + offset; ``multiply``: times (p / r)^factor; ``shift``: plus factor
            (p - r).
    """

    key: KeyPath
    kind: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Parameter:
    """A number that is fitted.

    Attributes:
        rules: Scene keys that follow it.
        lower: Smallest value, SI.
        upper: Largest value, SI.
        start: Where the first start begins, SI.
        reference: Value at which multiplied and shifted keys are as written, SI.
        prior: Expected value, SI; None without a prior.
        prior_sigma: Standard deviation of the prior in the fitted coordinate.
        logarithmic: The fitted coordinate is ln p, else p.
    """

    name: str
    rules: tuple[KeyRule, ...]
    lower: float
    upper: float
    start: float
    reference: float
    prior: float | None
    prior_sigma: float | None
    logarithmic: bool
    dimension: Dimension
    unit: str


@dataclass(frozen=True)
class IdentificationTask:
    """A checked target file."""

    name: str
    cases: tuple[TargetCase, ...]
    parameters: tuple[Parameter, ...]
    settings: FitTable
