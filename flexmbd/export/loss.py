"""Capabilities of formats, and losses of a reduced body in them: refused, or reported.

What changes the linear body itself (interfaces, damping, rotations of frames, mass distribution) is
refused unless a caller accepts the loss; what a format never asks for (stress, pictures, named loads,
stiffening by load) is reported, never refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.given import checked, refuse_no_truth
from flexmbd.record.reduced_body import ReducedBody

#: For writers of formats: all their arguments but the body and units, which have errors of their own.
checked_writer = checked(but=("body", "units"), error=ExportError)


@dataclass(frozen=True)
class Capabilities:
    """The parts of a reduced body that a format can carry; docs/export.md shows them as a table.

    Attributes:
        interfaces: the largest number of interface frames, None for any number.
        rotations: whether an interface frame's rotation is carried, not only its displacement.
        nodal_interfaces: whether the nodes of nodal interfaces are carried as dofs of their own.
        damping: whether a damping matrix is carried.
        gyroscopic: whether the forces of rotors inside the body are carried.
        ports: whether pairs of effort and flow, as electrodes' voltage and charge, are carried.
        large_motion: whether the inertia of the moving body is carried: the integrals from which
            velocity-dependent forces follow. Else the file is good for small motions of B.
        stiffening: whether stiffening by load or stretch is carried.
        floating: whether a body whose frame floats on the mean axis is carried as it is.
        nodes: whether the displacements at the mesh's nodes are carried, where the record has them.
        stress: whether stress modes are carried, where the record has them.
        unknowns: whether the further unknowns of the modes are carried, as electric potentials.
        nonlinear: whether the strain energy of large displacements is carried.
        loads: whether the named loads are carried, rises of temperature among them.
        heat: whether the stress that these rises have of themselves is carried.
        contact: whether the contact patches are carried, with their flexibility beside the modes.
    """

    interfaces: int | None = None
    rotations: bool = True
    nodal_interfaces: bool = False
    damping: bool = True
    gyroscopic: bool = False
    ports: bool = False
    large_motion: bool = True
    stiffening: bool = False
    floating: bool = True
    nodes: bool = False
    stress: bool = False
    unknowns: bool = False
    nonlinear: bool = False
    loads: bool = False
    heat: bool = False
    contact: bool = False


def check_body(body: object) -> None:
    """Raise an ExportError for other objects than a reduced body, as a body of a scene or the scene itself."""
    if not isinstance(body, ReducedBody):
        raise ExportError(
            f"formats of bodies take a ReducedBody, as craig_bampton and ReducedBody.load return it, not a "
            f"{type(body).__name__}; a whole System goes by fm.export.fmu_machine"
        )


def check_losses(body: ReducedBody, capabilities: Capabilities, *, kind: str, lossy: bool) -> tuple[str, ...]:
    """The parts of this body that a file of this kind leaves out.

    Args:
        body: to be written.
        capabilities: of the format.
        kind: the format, for messages.
        lossy: write although the body itself becomes another.

    Returns:
        The parts that are not in the file, a phrase each.

    Raises:
        ExportError: it is not a reduced body; the body itself would become another, and ``lossy`` does not say that it
            may.
    """
    check_body(body)
    refuse_no_truth(ExportError, lossy=lossy)
    refused = list(_losses_of_the_body(body, capabilities))
    if refused and not lossy:
        raise ExportError(
            f"{kind} cannot carry all of this body; lost would be {', and '.join(refused)}: choose another format, or "
            "say lossy=True (--lossy) to write it without"
        )
    return (*refused, *_losses_of_extras(body, capabilities))


def _losses_of_the_body(body: ReducedBody, capabilities: Capabilities) -> list[str]:
    losses = []
    if capabilities.interfaces is not None and len(body.interfaces) > capabilities.interfaces:
        names = ", ".join(frame.name for frame in body.interfaces)
        losses.append(f"interfaces: it takes {capabilities.interfaces}, the body has {len(body.interfaces)} ({names})")
    if not capabilities.rotations and any(np.any(frame.modes[3:]) for frame in body.interfaces):
        losses.append("the rotations of the interface frames")
    if not capabilities.nodal_interfaces and body.nodal is not None:
        losses.append(f"the nodal interfaces ({', '.join(body.nodal.names)})")
    if not capabilities.damping and np.any(body.damping):
        losses.append("the damping matrix")
    if not capabilities.gyroscopic and body.gyroscopic is not None:
        losses.append("the gyroscopic forces of the rotors inside it")
    if not capabilities.ports and body.ports is not None:
        losses.append(f"the ports ({', '.join(body.ports.names)}), whose efforts would all be zero")
    if not capabilities.floating and body.frame is None and body.n_modes > 0:
        losses.append("the floating frame: it takes bodies whose frame sits on an interface")
    return losses


def _losses_of_extras(body: ReducedBody, capabilities: Capabilities) -> list[str]:
    losses = []
    if not capabilities.large_motion and body.n_modes > 0:
        losses.append("the inertia of large motions: the file holds the body near its undeformed place")
    if not capabilities.stiffening and (body.stretch is not None or body.geometric is not None):
        losses.append("stiffening by load and by spinning")
    if not capabilities.nonlinear and body.nonlinear is not None:
        losses.append("the strain energy of large displacements: the body in the file is linear")
    if not capabilities.nodes and body.modes is not None:
        losses.append("the modes at the mesh's nodes")
    if not capabilities.stress and body.stress is not None:
        losses.append("the stress modes")
    if not capabilities.unknowns and body.unknowns is not None:
        losses.append("the further unknowns of the modes at the mesh's nodes")
    if not capabilities.loads and body.loads is not None:
        losses.append(f"the named loads ({', '.join(body.loads.names)})")
    if not capabilities.heat and body.heat is not None:
        losses.append(f"the stress of rises of temperature ({', '.join(body.heat.names)})")
    if not capabilities.contact and body.contact is not None:
        losses.append(f"the contact patches ({', '.join(body.contact.names)}) and their flexibility beside the modes")
    return losses
