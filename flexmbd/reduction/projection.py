"""From a basis of displacement shapes to the record of a reduced body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.gram_matrix import gram_matrix
from flexmbd.continuum.finite_elements.interface import FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.recovery import SHARE, model_share
from flexmbd.continuum.matrices.blocks import FloatArray, inner, symmetric
from flexmbd.continuum.matrices.eigen import TOLERANCE
from flexmbd.errors import ReductionError
from flexmbd.record.reduced_body import InterfaceFrame, ReducedBody
from flexmbd.reduction.contact.contact_group import contact_group, contact_notes
from flexmbd.reduction.contact.residual_flexibility import ResidualFlexibility
from flexmbd.reduction.large_displacements.basis import LargeDisplacements
from flexmbd.reduction.modes.signs import determined_rotation
from flexmbd.reduction.normal_form import normal_form
from flexmbd.reduction.optional_groups import Contents, Responses, optional_parts
from flexmbd.reduction.ports import PortCapacity, port_notes, ports_group
from flexmbd.reduction.record_stream import write_record
from flexmbd.reduction.static_shapes.stiffness_round_off import MARGIN, WORTHLESS, round_off


@dataclass(frozen=True, eq=False)
class Basis:
    """A Craig-Bampton basis in its own coordinates.

    Attributes:
        frame: name of the interface that carries the body frame B, or None where B floats.
        p: (3,) m, B's origin in the mesh's axes.
        R: (3, 3) rotation from B's axes to the mesh's.
        interfaces: the frames, b of them.
        nodal: names of the nodal interfaces that keep their nodes.
        rows: (6 b, n) their motions (m, rad) per unit coordinate, in B's axes.
        names: (n,) of the coordinates.
        shapes: (owned dofs, n) static shapes, then fixed-interface modes, in the mesh's axes.
        forces: (owned dofs, n) K times the shapes.
        eigenvalues: (m,) of the fixed-interface modes, 1/s^2.
        resolved: 1/s^2, the highest of these that was asked for; 0 where there is none.
        rigid_part: (6, n) of the mass-normalised rigid modes, what was taken off the shapes; zero
            where B is attached.
        projections: (n, fields) shapes^T M w for the rule of the signs.
        responses: to the loads that the record's contents need.
        large: what a body that bends a lot has besides, or None.
        contact: what the modes leave out of the flexibility of the contact patches, or None.
        ports: what the modes leave out of the ports' flow, or None.
    """

    frame: str | None
    p: FloatArray
    R: FloatArray
    interfaces: tuple[FoundInterface, ...]
    nodal: tuple[str, ...]
    rows: FloatArray
    names: tuple[str, ...]
    shapes: FloatArray
    forces: FloatArray
    eigenvalues: FloatArray
    resolved: float
    rigid_part: FloatArray
    projections: FloatArray
    responses: Responses
    large: LargeDisplacements | None = None
    contact: ResidualFlexibility | None = None
    ports: PortCapacity | None = None


def project(
    model: LinearModel,
    basis: Basis,
    *,
    provenance: Mapping[str, str],
    contents: Contents,
    stream: str | Path | None = None,
) -> ReducedBody:
    """Project the model on a basis and bring the result to normal form. Collective.

    The record is made on rank 0 and handed to the others bit for bit; where it goes to a file, without the groups of
    the mesh, which are in that alone.

    Raises:
        RecordError: on all ranks: the file cannot be written.
        ReductionError: on all ranks: the basis has lost its orthonormality, or a damping does not fit.
        FormulationError: on all ranks: stress modes of a stress that is not linear.
    """
    p, R = basis.p, basis.R
    gram = gram_matrix(model, basis.shapes, p=p, R=R)
    raw = inner(model.comm, basis.shapes, basis.forces)
    if basis.large is not None:
        raw = raw + basis.large.stiffness
    stiffness = symmetric(raw)
    with round_off(model.K) as measure:
        lost = measure.work(basis.shapes, basis.shapes)

    def make() -> tuple[dict[str, Any], FloatArray]:
        n = len(stiffness)
        mass = np.einsum("iaja->ij", gram[4:, 4:].reshape(n, 3, n, 3))
        whole = mass + basis.rigid_part.T @ basis.rigid_part
        error, noise = _check_orthonormality(raw, whole, basis.eigenvalues, lost=lost)
        k, x = normal_form(stiffness, mass)
        x = x @ determined_rotation(k, x.T @ basis.projections)
        k = np.einsum("ij,ij->j", x, stiffness @ x)
        parts = _parts(basis, _change_basis(gram, x), k, x)
        parts["provenance"] = {
            **provenance,
            "orthonormality error": f"{error:.1e}",
            "round-off of the stiffness": f"{noise:.1e}",
        }
        return parts, x

    parts, x = parallel.on_root(model.comm, make)
    modes = with_ghosts(model, basis.shapes @ x)
    more, spread, notes = optional_parts(
        model,
        contents,
        basis.responses,
        modes=modes,
        stiffness=parts["stiffness"],
        resolved=basis.resolved,
        gram=parts["gram"],
        interfaces=parts["interfaces"],
        nodal=basis.nodal,
        p=p,
        R=R,
    )
    parts["provenance"].update(notes)
    if basis.large is not None:
        more["nonlinear"], parts["provenance"]["strain energy"] = basis.large.group(modes, parts["partition"])
    if contents.patches is not None and basis.contact is not None:
        more["contact"] = contact_group(contents.patches, basis.contact, modes=modes[: model.n_owned], p=p, R=R)
        parts["provenance"].update(contact_notes(contents.patches, basis.contact))
    if basis.ports is not None:
        more["ports"] = ports_group(model, basis.ports, modes=modes[: model.n_owned])
        parts["provenance"].update(port_notes(basis.ports))
    if len(stiffness) and (basis.large is not None or model.state is not None):
        parts["provenance"][SHARE] = repr(model_share(model, modes[: model.n_owned], parts["stiffness"])[0])
    if stream is None:
        more.update((name, group.whole()) for name, group in spread.items())
    body = ReducedBody(**parts, **more)
    if stream is not None:
        write_record(model.comm, stream, body, spread)
    return body


# Of a double's digits: what is lost below that shows nowhere, whatever its cause.
_HALF_THE_DIGITS = float(np.sqrt(np.finfo(float).eps))


def _check_orthonormality(
    stiffness: FloatArray, mass: FloatArray, eigenvalues: FloatArray, *, lost: FloatArray
) -> tuple[float, float]:
    """The largest error of what the basis should fulfil by construction, and the largest round-off of a stiffness.

    Args:
        stiffness: (n, n) of the static shapes and the modes.
        mass: (n, n).
        eigenvalues: (m,) of the modes.
        lost: (n, n) the measure of the stiffness' round-off.

    Raises:
        ReductionError: it is more than round-off and the eigensolver's tolerance explain, or that is too much.
    """
    n, static = len(mass), len(mass) - len(eigenvalues)
    if n == 0:
        return 0.0, 0.0
    size = np.sqrt(np.diag(stiffness))
    relative, noise = stiffness / np.outer(size, size), TOLERANCE + lost / np.outer(size, size)
    modal = slice(static, None)
    # each with its measure of what cannot be helped
    errors = {
        "asymmetry of the stiffness": (abs(relative - relative.T), noise),
        "mass of the fixed-interface modes": (abs(mass[modal, modal] - np.eye(n - static)), noise[modal, modal]),
        "stiffness between modes": (abs(relative - np.eye(n))[:, modal], noise[:, modal]),
        "eigenvalues": (abs(np.diag(stiffness)[modal] / eigenvalues - 1.0), np.diag(noise)[modal]),
    }
    excess = {what: float((error / least).max(initial=0.0)) for what, (error, least) in errors.items()}
    largest = max(float(error.max(initial=0.0)) for error, _ in errors.values())
    worst = max(excess, key=lambda what: excess[what])
    error = float(errors[worst][0].max())
    if not (excess[worst] <= MARGIN or error <= _HALF_THE_DIGITS):
        raise ReductionError(
            f"the basis has lost its orthonormality: error of the {worst} {error:.1e}, and up to {excess[worst]:.1e} "
            f"times the error that round-off and the eigensolver's tolerance explain, bound {MARGIN:.0f}; the "
            "stiffness is singular or nearly so, or the formulation has deformations without energy"
        )
    share = float((np.diag(lost) / size**2).max())
    if not max(largest, share) <= WORTHLESS:
        raise ReductionError(
            "double precision cannot resolve the softest deformations of the body beside its stiffest: round-off is "
            f"{max(largest, share):.1e} of a stiffness, bound {WORTHLESS:.0e}; the body is very thin, slender or "
            "nearly incompressible, for which there are formulations of plates, beams and mixed solids, or its mesh "
            "has slivers"
        )
    return largest, share


def _change_basis(gram: FloatArray, x: FloatArray) -> FloatArray:
    """The Gram matrix for the modes phi x."""
    n = len(x)
    change = np.eye(4 + 3 * n)
    change[4:, 4:] = np.kron(x, np.eye(3))
    changed = change.T @ gram @ change
    return symmetric(changed)


def _parts(basis: Basis, gram: FloatArray, k: FloatArray, x: FloatArray) -> dict[str, Any]:
    frames = []
    for i, one in enumerate(basis.interfaces):
        p_BI_B = basis.R.T @ (one.p - basis.p)
        rows = basis.rows[6 * i : 6 * i + 6] @ x
        frames.append(InterfaceFrame(one.name, p_BI_B, basis.R.T @ one.R, rows))
    return {
        "gram": gram,
        "stiffness": k,
        "interfaces": tuple(frames),
        "frame": basis.frame,
        "p_MB_M": basis.p,
        "R_MB": basis.R,
        "partition": x,
        "partition_names": basis.names,
    }
