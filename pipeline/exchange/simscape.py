"""Bodies for the block Reduced Order Flexible Solid of Simscape Multibody: a MATLAB file, and a script
that loads it and says which variable belongs to which parameter.

Source: MathWorks, reference page of the block: six dofs Tx Ty Tz Rx Ry Rz of each boundary node in
the axes of one common frame, then all others; origin and unit quaternion of each node in that frame.
"""

import io

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.scipy_library import scipy
from headstock.pipeline.exchange.matrices import ExchangeError, eliminate_constraints
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.linear.symmetric_matrices import symmetrise

_SCRIPT = """% {name}: {nodes} interfaces and {others} further dofs; m, kg, s
body = load([mfilename('fullpath') '.mat']);
% Reduced Order Flexible Solid, Interface Frames:  Origins      body.origins
%                                                  Orientations body.orientations (w x y z)
%                               Stiffness Matrix:  body.K
%                               Mass Matrix:       body.M
%                               Damping Matrix:    body.C{damping}
% interfaces, in the order of the frames: {interfaces}
"""


def encode_simscape(superelement: Superelement) -> dict[str, bytes]:
    """Return the files of a body, by what they end in.

    Raises:
        ExchangeError: It is rigid, has no interface with six dofs, or interfaces that are tied.
    """
    superelement = eliminate_constraints(superelement)
    if not superelement.frames or not superelement.stiffness.any():
        raise ExchangeError(
            f"component {superelement.name!r} is rigid or has rails alone; Reduced Order Flexible Solid takes elastic bodies with interfaces"
        )
    basis = _relative_basis(superelement)
    stiffness, mass = (
        symmetrise(basis.T @ matrix @ basis)
        for matrix in (superelement.stiffness, superelement.mass)
    )
    damping = superelement.damping
    names = [
        [name for name, entry in superelement.interface_maps.items() if entry.node == node]
        for node in range(len(superelement.frames))
    ]
    turned = [
        superelement.interface_maps[group[0]].frame.rotation if group else np.eye(3)
        for group in names
    ]
    content = {
        "origins": np.array([frame.origin for frame in superelement.frames]),
        "orientations": scipy.spatial.transform.Rotation.from_matrix(np.array(turned)).as_quat(
            canonical=True, scalar_first=True
        ),
        "K": stiffness,
        "M": mass,
        "C": np.zeros_like(mass) if damping is None else symmetrise(basis.T @ damping @ basis),
        "interfaces": np.array([" ".join(group) for group in names], dtype=object),
    }
    image = io.BytesIO()
    scipy.io.savemat(image, content)
    script = _SCRIPT.format(
        name=superelement.name,
        nodes=len(names),
        others=len(stiffness) - superelement.node_size,
        damping=" (zero: choose another method)" if damping is None else "",
        interfaces=", ".join(" ".join(group) for group in names),
    )
    return {".mat": image.getvalue(), ".m": script.encode()}


def _relative_basis(superelement: Superelement) -> FloatArray:
    """Return the basis ``(n, n)`` in which only dofs of boundary nodes move with a rigid body: control
    points of rails move relative to the first node.
    """
    basis = np.eye(len(superelement.labels))
    motions = rigid_motions(superelement, superelement.frames[0].origin)
    basis[superelement.node_size :, :6] = motions[superelement.node_size :]
    return basis
