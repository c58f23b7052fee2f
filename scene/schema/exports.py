"""Schema of what a run writes for other programs."""

from typing import Annotated

from headstock.scene.exports import EXPORT_FORMATS, ExportMotors, find_share_fault
from headstock.scene.schema import types


def _find_file_fault(name: str) -> str:
    plain = name and name == name.rpartition("/")[2] and name[0] not in ".\\~" and "\\" not in name
    return (
        ""
        if plain
        else 'is a name without folders, such as "mill.fmu"; it lies in the folder of the results'
    )


ErrorShare = Annotated[
    types.Ratio,
    types.without_fault(find_share_fault),
    types.describe_ratio(
        "ratio above 0, below 1", (0.01, "1 %"), exclusiveMinimum=0.0, exclusiveMaximum=1.0
    ),
]


class ExportTable(types.StrictTable):
    """What leaves for another program: `run` writes it into its folder, see [other programs](exchange.md)."""

    format: Annotated[types.Text, types.JsonForm({"type": "string", "enum": list(EXPORT_FORMATS)})]
    """of a component `h5, op4, dmig, abaqus, calculix, mtx, simscape`, or a mesh; of the machine `fmu3, fmu2, mat, npz, uff`"""
    component: types.Text | None = None
    """component that leaves; default: the whole machine, or the only component with a shape"""
    pose: types.Text | None = None
    """pose of the machine; default: the first"""
    hz: types.PositiveFrequency | None = None
    """modes up to here become states of `fmu3, fmu2, mat, npz`, the others act statically"""
    step: types.PositiveTime | None = None
    """step of `fmu3, fmu2, mat, npz`, over which inputs are constant; default: 1 ms of an FMU, less for fast modes, else continuous time"""
    balanced: ErrorShare | None = None
    """leaves out states up to this error, as a share of the largest response: `"1 %"`"""
    motors: ExportMotors = "locked"
    """motors of `fmu3, fmu2, mat, npz` with the effect `drive_control`: `locked`; `free`, their forces go in, motors and scales come out;
    `controlled`, set points of axes go in, encoders and forces come out"""
    travel: types.Names | None = None
    """axes whose positions may change in `fmu3, fmu2, mat, npz`: `["X", "Y"]`; default: none, the pose is fixed"""
    error: ErrorShare | None = None
    """error of the frequency response anywhere along the travel; default: 1 %"""
    file: Annotated[types.Text, types.without_fault(_find_file_fault)] | None = None
    """name of the file, of several files what their names begin with; default: the name of the export"""
