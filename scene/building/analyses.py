"""What is computed: compliances, modes and frequency responses built from their tables, and what
may be wrong with them.
"""

from collections.abc import Sequence

from headstock.geometry.frames import DIRECTIONS
from headstock.scene.building.draft import Draft, check_channel, check_name, check_pose_names
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.positions import KeyPath
from headstock.scene.requests import LOAD, FrfRequest, ModalRequest, StaticRequest
from headstock.scene.schema.effects import find_effect_fault
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.second_order import Channel

DEFAULT_MODES = 6


def build_static(scene: SceneTable, poses: tuple[str, ...]) -> StaticRequest | None:
    """The compliances a scene asks for; in ``poses`` unless it names some."""
    static = scene.analyses.static
    return (
        None
        if static is None
        else StaticRequest(tuple(static.at or scene.points), tuple(static.poses or poses))
    )


def build_modal(scene: SceneTable, poses: tuple[str, ...]) -> ModalRequest | None:
    """The natural frequencies a scene asks for; in ``poses`` unless it names some."""
    modal = scene.analyses.modal
    if modal is None:
        return None
    count = DEFAULT_MODES if modal.count is None and modal.up_to is None else modal.count
    return ModalRequest(
        count,
        modal.up_to,
        tuple(modal.poses or poses),
        modal.spread,
        modal.start,
        stated=modal.count is not None,
    )


def build_frf(scene: SceneTable, poses: tuple[str, ...]) -> FrfRequest | None:
    """The frequency response a scene asks for; in ``poses`` unless it names some."""
    frf = scene.analyses.frf
    if frf is None:
        return None
    every = [(name, "") for name in scene.points]
    inputs = build_channels([(n, LOAD if n in scene.loads else d) for n, d in frf.inputs or every])
    moved = tuple(channel for channel in inputs if channel[1] != LOAD)
    outputs = [one for one in frf.outputs or () if one[0] not in scene.probes]
    inside = [name for name, _ in frf.outputs or () if name in scene.probes]
    return FrfRequest(
        inputs=inputs,
        outputs=build_channels(outputs) if outputs else moved or build_channels(every),
        probes=tuple(dict.fromkeys(inside if frf.outputs else scene.probes)),
        to_hz=frf.to,
        from_hz=frf.start,
        points=frf.points,
        spacing=frf.spacing,
        adaptive=frf.adaptive,
        motion=frf.motion,
        poses=tuple(frf.poses or poses),
        motors=frf.motors,
        fields_at=tuple(dict.fromkeys(frf.fields_at)),
    )


def build_channels(channels: Sequence[tuple[str, str]]) -> tuple[Channel, ...]:
    """Every channel once, with its direction."""
    found = [(name, dof) for name, given in channels for dof in ([given] if given else DIRECTIONS)]
    return tuple(dict.fromkeys(found))


def check_requests(draft: Draft, findings: Findings) -> None:
    """Report names in analyses that mean nothing, and effects that cannot be switched on."""
    analyses = draft.table.analyses
    for index, point in enumerate(analyses.static.at or () if analyses.static else ()):
        check_name(("analyses", "static", "at", index), point, "points", draft, findings)
    for key, channels in (
        (("inputs", analyses.frf.inputs), ("outputs", analyses.frf.outputs)) if analyses.frf else ()
    ):
        for index, (name, direction) in enumerate(channels or ()):
            place = ("analyses", "frf", key, index)
            if key == "inputs" and name in draft.sections.get("loads", ()):
                _check_load_input(place, name, direction, draft, findings)
            elif key == "outputs" and name in draft.sections.get("probes", ()):
                check_probe_output(place, name, direction, draft, findings)
            else:
                check_channel(place, name, draft, findings)
    for name, table in (
        ("static", analyses.static),
        ("modal", analyses.modal),
        ("frf", analyses.frf),
        ("control", analyses.control),
    ):
        check_pose_names(
            ("analyses", name, "poses"), table.poses if table else None, draft, findings
        )
    for name, value in draft.table.effects.items():
        if fault := find_effect_fault(name, value):
            findings.add(("effects", name), fault)


def _check_load_input(
    key: KeyPath, name: str, direction: str, draft: Draft, findings: Findings
) -> None:
    load = draft.table.loads.get(name)
    if name in draft.table.points:
        findings.add(key, f"{name} is a point and a load; rename one of them")
    elif direction:
        findings.add(key, f'a load has its direction; write "{name}" alone')
    elif load is not None and load.joint is not None:
        findings.add(key, "is a displacement, which is a static load only; write a force or moment")
    frf = draft.table.analyses.frf
    outputs = [
        one for one, _ in (frf.outputs or () if frf else ()) if one not in draft.table.probes
    ]
    if frf is not None and not (draft.table.points or outputs):
        findings.add(
            key,
            'there is no output for it at a point or an interface; write outputs = [["tcp", "z"]], or [points]',
        )


def check_probe_output(
    key: KeyPath, name: str, direction: str, draft: Draft, findings: Findings
) -> None:
    """Report a probe as an output that is a point as well, or has a direction."""
    if name in draft.table.points:
        findings.add(key, f"{name} is a point and a probe; rename one of them")
    elif direction:
        findings.add(
            key, f'a probe shows displacement and stress in all directions; write "{name}" alone'
        )


def check_subjects(draft: Draft, findings: Findings) -> None:
    """Report analyses without anything to compute them of."""
    scene = draft.table
    static = scene.analyses.static
    if static is not None and static.at is None and not scene.points and not scene.loads:
        example = 'tcp = { tool = "component.interface", work = "ground" }'
        findings.add(
            ("analyses", "static"),
            f"there is no point to compute a compliance at; write [points] {example}",
        )
    frf = scene.analyses.frf
    if frf is not None and frf.inputs is None and not scene.points:
        findings.add(
            ("analyses", "frf"),
            'there is no point to take a response at; write [points], or inputs = [["tcp", "x"]]',
        )
    if not scene.components:
        findings.add(
            ("components",),
            "there are no components; write [components.NAME] with a solid and a material",
        )
