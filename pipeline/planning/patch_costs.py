"""What patches cost, before anything is computed: elements across small ones add to a mesh, deformation
shapes of large ones to a reduction.
"""

import dataclasses
from collections.abc import Callable, Sequence

from headstock.geometry.parts.components import Component
from headstock.geometry.parts.plane_shapes import patch_width
from headstock.meshing.components.mesh_request import patch_groups
from headstock.meshing.components.meshing import MeshEstimate
from headstock.pipeline.planning.budgets import displacement_dofs
from headstock.pipeline.planning.rail_meshes import find_coarse_rails
from headstock.scene.scene import Scene

FEWEST_DOFS = 50_000  # smaller meshes cost little, whatever decides them
DECIDED = 0.6  # dofs without most of the elements across patches, over those with them
FEWEST_ACROSS = (1, 2)


def count_dofs(component: Component, estimate: MeshEstimate) -> int:
    """Return the displacement dofs of a mesh to be made."""
    if estimate.nodes:
        return 3 * estimate.nodes
    return displacement_dofs(estimate.cells, component.mesh)


def describe_patch_costs(
    component: Component,
    scene: Scene,
    estimate: MeshEstimate,
    survey: Callable[[Component], MeshEstimate],
) -> str:
    """Return which patch makes most of a mesh by the elements across it, and how large it would be
    with fewer of them; empty where none does.

    Args:
        estimate: Of the mesh.
        survey: Estimates the mesh of a component.
    """
    mesh, dofs = component.mesh, count_dofs(component, estimate)
    narrowest = min(_list_widths(component, scene), default=None)
    if narrowest is None or dofs < FEWEST_DOFS or mesh.growth is not None or mesh.cells == "hex":
        return ""
    fewer = next(
        (
            across
            for across in FEWEST_ACROSS
            if across < mesh.across_patches
            and not find_coarse_rails(_with_across(scene, component, across))[0]
        ),
        None,
    )
    if fewer is None:
        return ""
    coarse = _with_across(scene, component, fewer).machine.components[component.name]
    without = count_dofs(coarse, survey(coarse))
    if without > DECIDED * dofs:
        return ""
    width, _, name = narrowest
    thousands = float(f"{1e-3 * without:.2g}")
    return (
        f"; most of it by {mesh.across_patches} elements across {name}, {1e3 * width:.4g} mm wide: about"
        f" {thousands:g} 000 dofs with mesh.across_patches = {fewer}"
    )


def describe_shape_costs(component: Component, count_seconds: Callable[[Component], float]) -> str:
    """Return what the deformation shapes of flexible interfaces cost, over averaging ones; empty
    without any.

    Args:
        count_seconds: Estimates the processor time of the reduction of a component [s].
    """
    flexible = {name: one for name, one in component.interfaces.items() if one.flexible}
    if not flexible:
        return ""
    plain = {
        name: dataclasses.replace(one, coupling="average", flexible=0)
        for name, one in flexible.items()
    }
    averaging = dataclasses.replace(component, interfaces=component.interfaces | plain)
    ratio = count_seconds(component) / count_seconds(averaging)
    shapes = sum(one.flexible for one in flexible.values())
    return f"; {shapes} deformation shapes of {', '.join(flexible)} take {ratio:.2g} times the time of averaging"


def _list_widths(component: Component, scene: Scene) -> Sequence[tuple[float, float, str]]:
    """Return width and negative length [m] of each imprinted patch of a component, and its group."""
    machine = scene.machine
    groups = patch_groups(
        component, tuple(machine.supports.values()), tuple(machine.loads.values())
    )
    return [
        (patch_width(patch), -max(patch.size, default=0.0), name)
        for name, patches in groups.items()
        for patch in patches
        if patch.shape != "whole"
    ]


def _with_across(scene: Scene, component: Component, across: int) -> Scene:
    """Return a scene with other elements across the patches of a component."""
    mesh = dataclasses.replace(component.mesh, across_patches=across)
    changed = {component.name: dataclasses.replace(component, mesh=mesh)}
    machine = scene.machine
    components = {**machine.components, **changed}
    return dataclasses.replace(scene, machine=dataclasses.replace(machine, components=components))
