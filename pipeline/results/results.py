"""``Results``: everything that a run found, with its warnings, costs and provenance."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import MeshQuality
from headstock.pipeline.answers.answer import Answer, find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.numbers import Number, Numbers, make_key
from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.results.grids import MESH_MODULE, Grid, pose_numbers, surface_grid
from headstock.pipeline.results.short_forms import Displayed, ShortForm, list_few, show_short
from headstock.pipeline.results.views import MachineView, pick_name
from headstock.pipeline.storage.frames import Frame
from headstock.pipeline.storage.provenance import Provenance

if TYPE_CHECKING:
    import pyvista

# of which a few lines say something of their own
SHOWN_ANSWERS = ("PoseModes", "StaticAnswer", "PoseResponse")

type MeshReader = Callable[[str, str | None], pyvista.UnstructuredGrid]


@dataclass(frozen=True, eq=False)
class ComponentFacts:
    """What became of a component.

    Attributes:
        fidelity: ``rigid``, ``elastic`` or ``superelement``.
        mass_kg: Mass [kg].
        cutoff_hz: Its fixed-interface modes are complete up to here; inf for rigid bodies.
        residual: Largest relative residual of its solves.
        quality: Of its mesh; None without one.
    """

    fidelity: str
    full_dofs: int
    reduced_dofs: int
    mass_kg: float
    cutoff_hz: float
    residual: float
    quality: MeshQuality | None = None
    corrected: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Results(Displayed):
    """Everything a run found.

    Attributes:
        stages: What ran, in order.
        answers: Of the analyses, in the order of their stages.
        joint_springs: Joint name to ``(6, 6)`` stiffness in its joint frame [N/m, N m/rad].
        labels: A name for each row of the mode shapes.
        assumptions: Which values are the catalogue's, and how uncertain they are.
        failures: Analyses that were refused, with the reason; the others were still computed.
        view: What pictures of the machine are drawn from.
        files: SHA-256 by file name of what was written beside the summary.
        provenance: Where it comes from; None where nobody said.
        volumes: Pose and component to its volume mesh, None where it has none; None after a run
            that kept no meshes.
        saved_mesh: Component and pose to its mesh in the files of the run; None where the results
            are those of a run just made.
    """

    name: str
    versions: dict[str, str]
    stages: tuple[StageRecord, ...]
    components: dict[str, ComponentFacts]
    answers: tuple[Answer, ...]
    joint_springs: dict[str, FloatArray]
    labels: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()
    view: MachineView = field(default_factory=MachineView)
    files: dict[str, str] = field(default_factory=dict)
    provenance: Provenance | None = None
    volumes: Callable[[str, str], Grid | None] | None = None
    saved_mesh: MeshReader | None = None

    def _short_form(self) -> ShortForm:
        mass = sum(facts.mass_kg for facts in self.components.values())
        facts = [("components", f"{list_few(list(self.components))}; {mass:.4g} kg")]
        rows = []
        for pose, modes in self.modes.items():
            found = modes.frequencies_hz
            span = f"{found[0]:.4g} to {found[-1]:.4g} Hz" if len(found) else "none"
            facts.append((f"modes[{pose!r}]", f"{len(found)}, {span}"))
            rows += [
                (pose, str(modes.below + number + 1), f"{hz:.5g}", _show_error(estimate), name)
                for number, (hz, estimate, name) in enumerate(
                    zip(map(float, found), modes.list_errors(), modes.mode_names, strict=True)
                )
            ]
        for pose, points in self.static.items():
            facts.append((f"static[{pose!r}]", f"compliance at {list_few(list(points))}"))
        for pose, response in self.frf.items():
            lines = response.curves.frequencies_hz
            facts.append((f"frf[{pose!r}]", f"{len(lines)} lines up to {lines[-1]:.4g} Hz"))
        kinds = dict.fromkeys(type(answer).__name__ for answer in self.answers)
        if others := [kind for kind in kinds if kind not in SHOWN_ANSWERS]:
            facts.append(("also", list_few(others)))
        facts += [
            (name, str(len(texts)))
            for name, texts in (("warnings", self.warnings), ("failures", self.failures))
            if texts
        ]
        head = ("pose", "mode", "Hz", "± Hz", "name") if rows else ()
        return ShortForm(f"Results of {self.name}", facts, head, rows)

    @property
    def status(self) -> Literal["done", "failed"]:
        """``failed`` where something that was asked for could not be computed."""
        return "failed" if self.failures else "done"

    def find[T: Answer](self, kind: type[T]) -> tuple[T, ...]:
        """Return the answers of one kind, in the order of their stages."""
        return find_answers(self.answers, kind)

    @property
    def static(self) -> dict[str, dict[str, PointCompliance]]:
        """Pose name to point name to compliance."""
        return {answer.pose: answer.points for answer in self.find(StaticAnswer)}

    @property
    def modal(self) -> tuple[PoseModes, ...]:
        """Natural modes, one per pose."""
        return self.find(PoseModes)

    @property
    def modes(self) -> dict[str, PoseModes]:
        """Pose name to natural modes."""
        return {modes.pose.name: modes for modes in self.modal}

    @property
    def compliance(self) -> dict[str, FloatArray]:
        """Point name to ``(6, 6)`` static compliance in the first pose [m/N, 1/N, 1/(N m)]; of all
        poses, with budget and errors, in ``static``.
        """
        points = next(iter(self.static.values()), {})
        return {name: point.compliance for name, point in points.items()}

    @property
    def frf(self) -> dict[str, PoseResponse]:
        """Pose name to frequency response."""
        return {response.curves.pose: response for response in self.find(PoseResponse)}

    def to_pandas(self, table: str) -> Frame:
        """A table as a pandas frame, in SI units but for names that say another: ``modes``,
        ``compliance``, ``frf`` (receptance), ``components`` or ``stages``.

        Raises:
            KeyError: There is no such table; the message has those that are.
            HeadstockError: pandas is missing.
        """
        frames = importlib.import_module("headstock.pipeline.results.frames")
        frame: Frame = frames.make_frame(self, table)
        return frame

    @cached_property
    def numbers(self) -> Numbers:
        """Every number with its place, unit and ±, by name such as ``frequency(pose=reference,mode=1)``."""
        return Numbers.collect(
            (
                *(
                    Number(make_key("mass", component=name), facts.mass_kg, "kg")
                    for name, facts in self.components.items()
                ),
                *(number for answer in self.answers for number in answer.list_numbers()),
            )
        )

    def mesh(self, component: str, pose: str | None = None) -> "pyvista.UnstructuredGrid":
        """A component at its position in a pose [m], with its modes and responses as named arrays.

        An elastic one has the cells of its mesh with shapes, stresses and strain energy, others
        have their surface with shapes. docs/files.md lists the arrays.

        Args:
            pose: Name of a pose; the first where none is named.

        Raises:
            KeyError: There is no such component or pose; the message has those that are.
        """
        if self.saved_mesh is not None:
            return self.saved_mesh(component, pose)
        found = pick_name("component", component, self.view.skins)
        name = pick_name("pose", pose, self.view.poses)
        volume = self.volumes and self.volumes(name, found)
        below = self.modes[name].below if name in self.modes else 0
        grid = volume or surface_grid(self.view, name, found, pose_numbers(self.modal, name), below)
        return importlib.import_module(MESH_MODULE).make_mesh(grid)


def _show_error(error: Estimate) -> str:
    """An error as a notebook shows it, ``0.3 + ?`` where other sources are not known."""
    partly = error.total is None and error.known is not None
    return f"{show_short(error.known)} + ?" if partly else show_short(error.total)
