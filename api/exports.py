"""What leaves for other programs, and bodies made of matrices: ``export``, ``state_space``,
``varying_state_space`` and ``Superelement``.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from headstock.arguments import naming_arguments, read_name, read_path_argument, refuse
from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.loading import Source, take_machine
from headstock.machine import Machine, Noun
from headstock.pipeline.exchange.bodies import make_superelement
from headstock.pipeline.exchange.matrices import BodyMatrices, ExchangeError, require_matrix
from headstock.pipeline.exchange.state_spaces import MachineStateSpace
from headstock.pipeline.exchange.varying_spaces import VaryingStateSpace
from headstock.pipeline.exports import export as write_export
from headstock.pipeline.state_space_export import find_state_space, find_varying
from headstock.pipeline.storage.superelements import write_superelement
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.building.loader import build_scene
from headstock.scene.exports import ExportMotors
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Findings
from headstock.scene.scene import Scene
from headstock.scene.schema.components import SolidTable
from headstock.scene.schema.exports import ExportTable
from headstock.solvers.mpi import MPI
from headstock.values import Quantity, write_table

UNNAMED = "export"

type Channels = Sequence[str | Sequence[str]]


def export(
    machine: Source,
    to: str,
    *,
    component: str | None = None,
    pose: str | None = None,
    hz: Quantity | None = None,
    step: Quantity | None = None,
    balanced: Quantity | None = None,
    motors: ExportMotors = "locked",
    travel: Sequence[str] | str | None = None,
    error: Quantity | None = None,
    output: str | Path | None = None,
    comm: MPI.Comm | None = None,
) -> str:
    """Write a component or the machine for another program; collective.

    Args:
        machine: Machine or path of a scene file.
        to: Format: ``op4``, ``dmig``, ``abaqus``, ``calculix``, ``mtx``, ``simscape``, ``h5`` or that of
            a mesh for a component; ``fmu3``, ``fmu2``, ``mat``, ``npz`` or ``uff`` for the machine.
        component: Its name; None writes the machine.
        pose: Of the machine; None for the first.
        hz: Modes up to here become states, as ``"500 Hz"``.
        step: Over which inputs are constant, as ``"1 ms"``.
        balanced: Error that leaving out states may cause, as ``"1 %"`` of the largest response.
        motors: Locked; free, their forces go in; or under control, set points of axes go in.
        travel: Axes whose positions may change in a state space, such as ``["X", "Y"]``.
        error: Of the frequency response in poses along the travel; default: 1 %.
        output: File to write, of several files what their names begin with.
        comm: Ranks that compute together; all that were started where None.

    Returns:
        What was written, in a few words.

    Raises:
        SceneError: The machine has problems, or the arguments do not go together.
        HeadstockError: A computation or the file failed.
    """
    made, name = take_machine(machine, "export"), read_name(to, "export", "to")
    given: dict[str, object] = {
        "format": name,
        "component": component,
        "pose": pose,
        "hz": hz,
        "step": step,
    }
    given |= {"balanced": balanced, "motors": motors, "travel": travel, "error": error}
    scene = _plan_export("export", made, given)
    wanted = scene.exports[UNNAMED]
    path = wanted.name_file(component or made.scene.path.stem)
    if output is not None:
        path = read_path_argument(output, "export", "output")
    return write_export(scene, wanted, path, comm=comm or MPI.COMM_WORLD)


def state_space(
    machine: Source,
    *,
    hz: Quantity | None = None,
    inputs: Channels | None = None,
    outputs: Channels | None = None,
    pose: str | None = None,
    step: Quantity | None = None,
    balanced: Quantity | None = None,
    motors: ExportMotors = "locked",
    comm: MPI.Comm | None = None,
) -> MachineStateSpace:
    """Return the state space of a machine in a pose, with the damping of its scene; collective.

    Args:
        machine: Machine or path of a scene file.
        hz: Modes up to here become states, the others act statically [Hz]; default: ``up_to`` of
            ``[analyses.frf]``.
        inputs: Where forces act, such as ``["tcp", ("table.top", "z")]``; default: those of
            ``[analyses.frf]``, else x, y and z of every point.
        outputs: Where motion is wanted; default: likewise, or the inputs where these are given.
        pose: Name; default: the first.
        step: Time over which inputs are constant [s]; None for continuous time.
        balanced: Error that leaving out states may cause, as a share of the largest response; None
            to keep all.
        motors: Locked; free, their forces go in; or under control, set points of axes go in.
        comm: Ranks that compute together; all that were started where None.

    Raises:
        SceneError: A channel or pose is unknown, or the step too long for a mode.
        HeadstockError: A computation failed.
    """
    given: dict[str, object] = {
        "format": "npz",
        "pose": pose,
        "hz": hz,
        "step": step,
        "balanced": balanced,
    }
    given |= {"motors": motors}
    scene = _plan_space("state_space", machine, given, inputs, outputs)
    return find_state_space(scene, scene.exports[UNNAMED], comm=comm or MPI.COMM_WORLD)


def varying_state_space(
    machine: Source,
    travel: Sequence[str] | str,
    *,
    hz: Quantity | None = None,
    inputs: Channels | None = None,
    outputs: Channels | None = None,
    pose: str | None = None,
    step: Quantity | None = None,
    motors: Literal["locked", "free"] = "locked",
    error: Quantity | None = None,
    comm: MPI.Comm | None = None,
) -> VaryingStateSpace:
    """Return the state space of a machine along the travel of some axes, in states that are the same
    in all poses; collective. See ``state_space``.

    Args:
        machine: Machine or path of a scene file.
        travel: Axes whose positions may change, such as ``["X", "Y"]``; over their limits.
        hz: Responses are right up to here [Hz].
        inputs: Where forces act.
        outputs: Where motion is wanted.
        pose: Where the other axes stand.
        step: Time over which inputs are constant [s].
        motors: Locked; or free, their forces go in.
        error: Of the frequency response in poses along the travel, as a share of it; default: 1 %.
        comm: Ranks that compute together; all that were started where None.

    Raises:
        SceneError: An axis is unknown or has no limits, or as ``state_space``.
        HeadstockError: A computation failed.
    """
    given: dict[str, object] = {
        "format": "npz",
        "pose": pose,
        "hz": hz,
        "step": step,
        "motors": motors,
        "travel": travel,
        "error": error,
    }
    scene = _plan_space("varying_state_space", machine, given, inputs, outputs)
    return find_varying(scene, scene.exports[UNNAMED], comm=comm or MPI.COMM_WORLD)


def _plan_space(
    function: str,
    machine: Source,
    given: dict[str, object],
    inputs: Channels | None,
    outputs: Channels | None,
) -> Scene:
    """Return the scene with channels and an export of what a function is given."""
    made = take_machine(machine, function)
    if given["hz"] is None and FrfRequest in made.scene.analyses:
        given["hz"] = made.scene.analyses[FrfRequest].to_hz
    scene = _plan_export(function, made, given)
    if inputs is None and outputs is None:
        return scene
    channels = {"inputs": inputs, "outputs": outputs}
    frf = {name: listed for name, listed in channels.items() if listed is not None}
    with naming_arguments(function, "analyses.frf"):
        made = made.change({"analyses.frf": {"up_to": scene.exports[UNNAMED].hz, **frf}})
    return _plan_export(function, made, given)


def _plan_export(function: str, made: Machine, given: Mapping[str, object]) -> Scene:
    """Return the scene with an export of what a function is given."""
    raw = {**made.table, "exports": {UNNAMED: write_table(ExportTable, given)}}
    with naming_arguments(function, f"exports.{UNNAMED}"):
        return build_scene(cast(TomlTable, raw), Findings(f"hs.{function}"), path=made.scene.path)


class Superelement(Noun, schema=SolidTable):
    """A body made of matrices: the ``solid`` of a ``Component``, whose interfaces are ``node_NUMBER``."""

    def __init__(
        self,
        K: ArrayLike,
        M: ArrayLike,
        C: ArrayLike | None = None,
        *,
        points: ArrayLike | Mapping[int, Sequence[float]],
        dofs: Sequence[tuple[int, int | str]] | None = None,
        file: str | Path,
        supported: bool = False,
    ) -> None:
        """Check the matrices, and write them as a file that scenes can name.

        Args:
            K: Stiffness ``(n, n)``, symmetric [N/m, N, N m].
            M: Mass ``(n, n)``, symmetric [kg, kg m, kg m^2].
            C: Viscous damping ``(n, n)``.
            points: Positions of the nodes ``(m, 3)``, numbered from 1, or number to position [m].
            dofs: Node and dof of each row: ``x`` to ``rz`` or 1 to 6, ``0`` for a scalar dof, which has
                a number of its own; default: six of each node in order, then scalar ones.
            file: ``.h5`` file to write, in the folder of the machine or below.
            supported: The body is held, and no rigid motion is free of force.

        Raises:
            SceneError: An argument is of the wrong kind.
            HeadstockError: The matrices are not those of such a body, or the file cannot be written.
        """
        path = read_path_argument(file, "Superelement", "file")
        if path.suffix != ".h5":
            raise refuse("Superelement", "file", f"{path} ends in {path.suffix!r}; write .h5")
        stiffness = _read_matrix(path.stem, "K", K)
        places = _read_points(points)
        body = BodyMatrices(
            path.stem,
            _read_dofs(dofs, list(places), len(stiffness)),
            places,
            stiffness,
            _read_matrix(path.stem, "M", M),
            None if C is None else _read_matrix(path.stem, "C", C),
        )
        for letter, matrix in body.matrices.items():
            if len(matrix) != len(body.nodes):
                raise refuse(
                    "Superelement", letter, f"has {len(matrix)} rows for {len(body.nodes)} dofs"
                )
        write_superelement(path, make_superelement(body, supported=supported))
        super().__init__(superelement=path.as_posix())


def _read_matrix(name: str, letter: str, given: ArrayLike) -> FloatArray:
    dense = cast(Any, given).toarray() if hasattr(given, "toarray") else given
    try:
        return require_matrix(np.array(dense, dtype=float), f"{name}, {letter}")
    except (ExchangeError, ValueError, TypeError) as error:
        raise refuse("Superelement", letter, str(error)) from error


def _read_points(
    given: ArrayLike | Mapping[int, Sequence[float]],
) -> dict[int, tuple[float, float, float]]:
    """Return positions by number."""
    try:
        numbered = (
            given
            if isinstance(given, Mapping)
            else dict(enumerate(np.array(given, dtype=float).reshape(-1, 3).tolist(), 1))
        )
        return {int(n): (float(x), float(y), float(z)) for n, (x, y, z) in numbered.items()}
    except (ValueError, TypeError) as error:
        raise refuse("Superelement", "points", f"are no positions x, y, z: {error}") from error


def _read_dofs(
    given: Sequence[tuple[int, int | str]] | None, numbers: list[int], size: int
) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Return node and dof ``(n, 2)`` of each row."""
    names = {name: dof for dof, name in enumerate(DOF_NAMES, 1)}
    if given is None:
        every = [(number, dof) for number in numbers for dof in names.values()]
        scalars = range(max(numbers, default=0) + 1, max(numbers, default=0) + 1 + size)
        listed = [*every, *((number, 0) for number in scalars)][: max(size, len(every))]
    else:
        try:
            listed = [
                (int(node), names[str(dof)] if dof in names else int(dof)) for node, dof in given
            ]
        except (ValueError, TypeError) as error:
            raise refuse(
                "Superelement", "dofs", f"are no pairs of node and dof: {error}"
            ) from error
    strange = [dof for _, dof in listed if dof not in range(len(names) + 1)]
    if strange or len(set(listed)) < len(listed):
        what = f"{strange[0]!r} is no dof" if strange else "a dof is named twice"
        raise refuse("Superelement", "dofs", f"{what}; write (node, dof) with x, y, z, rx, ry, rz")
    return np.array(listed, dtype=np.int64).reshape(-1, 2)
