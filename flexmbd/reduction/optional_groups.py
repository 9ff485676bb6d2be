"""Parts of a record besides the modes, their inertia and stiffness: damping and the optional groups.

Which part of flexmbd needs a group:

- geometric stiffness: the machine, for bodies that spin or carry axial loads; without it they are too soft.
- loads: forces of a scene on this body by their names.
- modes: fields on the mesh by a process that has not reduced the body (`flexmbd.continuum.finite_elements.recovery`),
  and exporters that write nodes.
- surface: pictures without DOLFINx.
- stress: stress without DOLFINx.
- contact: bodies that are touched (`flexmbd.reduction.contact`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.gram_matrix import check_inertia
from flexmbd.continuum.finite_elements.interface import FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodal_interface import retained_nodes
from flexmbd.continuum.finite_elements.nodes import (
    boundary_triangles,
    dof_numbers,
    further_dofs,
    node_numbers,
    sorted_triangles,
)
from flexmbd.continuum.matrices.blocks import FloatArray, total
from flexmbd.errors import ReductionError
from flexmbd.given import checked
from flexmbd.record.groups import IntArray
from flexmbd.record.inertia_loads import PRESTRESS_SPIN
from flexmbd.record.reduced_body import (
    DistributedLoads,
    FurtherUnknowns,
    InterfaceFrame,
    NodalInterfaces,
    NodalModes,
    Surface,
)
from flexmbd.reduction.contact.found_patches import FoundPatches
from flexmbd.reduction.contact.residual_flexibility import PatchResponses, patch_responses
from flexmbd.reduction.damping import Damping, check_damping, has_dissipation, modal_damping, spring_stiffness
from flexmbd.reduction.gyroscopic import check_gyroscopic, gyroscopic_group
from flexmbd.reduction.large_displacements.modal_derivatives import (
    ModalDerivatives,
    check_nonlinear,
    refuse_other_nonlinear,
)
from flexmbd.reduction.loads import check_temperatures, heat_group, loads_group, missing_energy
from flexmbd.reduction.ports import PortResponses, check_ports, port_responses
from flexmbd.reduction.spread_groups import SpreadGroup, SpreadRows, all_numbers
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.geometric_stiffness import UnitLoads, joined, stiffening, unit_loads
from flexmbd.reduction.stress_modes import stress_group
from flexmbd.reduction.unit_loads import Load, TemperatureRise, check_loads, load_vectors, rise_of

_NO_STIFFENING = "none: the strain energy is quadratic, or does not mark the strains of its sections"


@checked(error=ReductionError)
@dataclass(frozen=True)
class Keep:
    """Fields of the modes on the mesh that a record keeps.

    Attributes:
        modes: the modes at all nodes (`NodalModes`), for stress and pictures from the model, and nodal exports.
        surface: the boundary's triangles with their modes (`Surface`), for pictures without DOLFINx.
        stress: the stress at all nodes (`StressModes`), for stress without DOLFINx.
    """

    modes: bool = False
    surface: bool = False
    stress: bool = False


@dataclass(frozen=True)
class Contents:
    """The optional contents of a record.

    Attributes:
        geometric_stiffness: whether `GeometricStiffness`.
        loads: those of `DistributedLoads`.
        damping: of the deformation, or None.
        keep: of the modes on the mesh.
        residual_vectors: of the loads of the body's motion and of `loads`, as modes.
        nonlinear: the strain energy of large displacements, or None.
        patches: where the body may be touched, or None.
    """

    geometric_stiffness: bool
    loads: tuple[Load, ...]
    damping: Damping | None
    keep: Keep
    residual_vectors: bool = False
    nonlinear: ModalDerivatives | None = None
    patches: FoundPatches | None = None

    def check(self, model: LinearModel) -> None:
        """Refuse contents that do not fit the model. Collective.

        Raises:
            ReductionError: on all ranks: loads, damping or `keep` that are not well formed, or stress modes of a
                prestressed body.
            MeshError: on all ranks: a load's facet group.
            FormulationError: on all ranks: an inertia that no record can hold.
        """
        if not isinstance(self.keep, Keep):
            raise ReductionError(f"keep must be Keep(modes=..., surface=..., stress=...), got {self.keep!r:.100}")
        if self.keep.stress and model.state is not None:
            raise ReductionError(
                "stress modes cannot hold the stress of the loaded state; leave Keep(stress=True) out, and take "
                "stresses from the prestressed model (stress_field)"
            )
        refuse_other_nonlinear(self.nonlinear)
        if self.nonlinear is not None and self.keep.stress:
            raise ReductionError(
                "stress modes are those of small displacements, and the stress of large ones is not linear: leave "
                "Keep(stress=True) out, and take stresses from the model (Keep(modes=True))"
            )
        check_loads(model, self.loads)
        check_temperatures(model, self.loads, keeps_stress=self.keep.stress, nonlinear=self.nonlinear is not None)
        check_damping(model, self.damping)
        check_inertia(model)
        check_gyroscopic(model)
        check_ports(model, nonlinear=self.nonlinear is not None)
        if self.nonlinear is not None:
            check_nonlinear(model)


@dataclass(frozen=True, eq=False)
class Responses:
    """Loads and the full model's static response to them.

    Attributes:
        loads: l of them: where geometric stiffness is wanted those of the body's motion first, then those of
            the interfaces; the named ones last.
        displacements: (owned dofs, l).
        held: (owned dofs, l) with all interfaces fixed.
        contact: to unit loads on the contact patches, or None.
        ports: to unit efforts of the ports, or None.
    """

    loads: UnitLoads
    displacements: FloatArray
    held: FloatArray
    contact: PatchResponses | None = None
    ports: PortResponses | None = None


def responses(statics: Statics, contents: Contents, interfaces: Sequence[FoundInterface]) -> Responses:
    """Apply the loads that the contents need, those of the interfaces that the record has among them. Collective."""
    names, forces = tuple(f"load {load.name}" for load in contents.loads), load_vectors(statics.model, contents.loads)
    rises = {
        name: rise_of(statics.model, load)
        for name, load in zip(names, contents.loads, strict=True)
        if isinstance(load, TemperatureRise)
    }
    named = UnitLoads(names, forces, np.zeros(len(names)), rises)
    moved = contents.geometric_stiffness or contents.residual_vectors
    loads = joined(unit_loads(statics, interfaces), named) if moved else named
    held = statics.held_response(loads.forces)
    touched = None if contents.patches is None else patch_responses(statics, contents.patches)
    displacements = statics.static_response(loads.forces, held=held)
    return Responses(loads, displacements, held, touched, port_responses(statics))


def optional_parts(
    model: LinearModel,
    contents: Contents,
    found: Responses,
    *,
    modes: FloatArray,
    stiffness: FloatArray,
    resolved: float,
    gram: FloatArray,
    interfaces: Sequence[InterfaceFrame],
    nodal: Sequence[str],
    p: FloatArray,
    R: FloatArray,
) -> tuple[dict[str, Any], dict[str, SpreadGroup[Any]], dict[str, str]]:
    """Damping and optional groups by their names in `ReducedBody`, those of the mesh spread; provenance. Collective.

    Args:
        model: the body.
        contents: what is wanted.
        found: the responses to loads.
        modes: (local dofs including ghosts, n) in normal form, in the mesh's axes.
        stiffness: (n,) 1/s^2.
        resolved: 1/s^2, the highest eigenvalue of the fixed-interface modes that were asked for.
        gram: (4 + 3 n, 4 + 3 n) mass integrals.
        interfaces: the record's, in its order.
        nodal: names of the nodal interfaces whose nodes the record has.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.

    Raises:
        ReductionError: on all ranks: a damping that does not fit the modes.
        FormulationError: on all ranks: stress modes of a stress that is not linear.
    """
    own = modes[: model.n_owned]
    parts: dict[str, Any] = {
        "damping": modal_damping(
            model, contents.damping, modes=own, stiffness=stiffness, gram=gram, interfaces=interfaces, p=p, R=R
        )
    }
    rotors = gyroscopic_group(model, modes=own, p=p, R=R)
    if rotors is not None:
        parts["gyroscopic"] = rotors
    provenance = _notes(model, contents, R=R)
    if contents.geometric_stiffness:
        groups, notes = _stiffening_groups(model, contents, found, modes=modes, stiffness=stiffness, resolved=resolved)
        parts.update(groups)
        provenance.update(notes)
    if contents.loads:
        parts["loads"], notes = _loads_group(model, contents, found, modes=own, stiffness=stiffness, p=p, R=R)
        provenance.update(notes)
        if found.loads.rises:
            parts["heat"] = heat_group(model, found.loads.rises)
    if nodal:
        parts["nodal"] = nodal_interfaces_group(model, nodal, own, p=p, R=R)
    frames = [one.name for one in interfaces]
    return parts, _kept(model, contents.keep, modes, frames=frames, p=p, R=R), provenance


def _notes(model: LinearModel, contents: Contents, *, R: FloatArray) -> dict[str, str]:
    """What the provenance says of the loaded state and of damping."""
    notes = {}
    if model.state is not None:
        notes["prestress"] = "\n".join([*model.state.loads, model.state.note])
        if model.state.spin.any():
            notes[PRESTRESS_SPIN] = " ".join(repr(float(rate)) for rate in R.T @ model.state.spin)
    said = [str(contents.damping)] if contents.damping is not None else []
    if has_dissipation(model):
        said.append("dissipation of the formulation")
    if said:
        notes["damping"] = "; ".join(said)
    return notes


def _stiffening_groups(
    model: LinearModel,
    contents: Contents,
    found: Responses,
    *,
    modes: FloatArray,
    stiffness: FloatArray,
    resolved: float,
) -> tuple[dict[str, Any], dict[str, str]]:
    """How loads change the stiffness, where the formulation tells it; provenance. Collective."""
    groups = stiffening(
        model,
        found.loads,
        displacements=with_ghosts(model, found.displacements),
        modes=modes,
        stiffness=stiffness,
        springs=spring_stiffness(model, modes=modes[: model.n_owned]),
        resolved=resolved if model.nodal else None,
    )
    notes = {"geometric stiffness": _NO_STIFFENING if groups is None else groups.note}
    if resolved == 0.0 and not contents.residual_vectors:
        notes["stretch modes"] = "none beside no modes: its motion stretches the body as interfaces do"
    return {} if groups is None else {"geometric": groups.geometric, "stretch": groups.stretch}, notes


def _loads_group(
    model: LinearModel,
    contents: Contents,
    found: Responses,
    *,
    modes: FloatArray,
    stiffness: FloatArray,
    p: FloatArray,
    R: FloatArray,
) -> tuple[DistributedLoads, dict[str, str]]:
    """The named loads, and in the provenance what the modes miss of the response to each. Collective."""
    named = slice(-len(contents.loads), None)
    forces = found.loads.forces[:, named]
    group = loads_group(model, contents.loads, forces=forces, modes=modes, p=p, R=R)
    missing = missing_energy(
        model,
        forces=forces,
        displacements=found.displacements[:, named],
        modal=group.modal,
        stiffness=stiffness,
    )
    pairs = zip(contents.loads, missing, strict=True)
    return group, {f"load {load.name}": f"{load}; static energy missing {part:.1e}" for load, part in pairs}


def _kept(
    model: LinearModel, keep: Keep, modes: FloatArray, *, frames: Sequence[str], p: FloatArray, R: FloatArray
) -> dict[str, SpreadGroup[Any]]:
    """The modes on the mesh, as far as the record keeps them. Collective."""
    spread: dict[str, SpreadGroup[Any]] = {}
    if keep.modes:
        spread["modes"] = nodal_group(model, modes, p=p, R=R)
        others = further_unknowns(model, modes)
        if others is not None:
            spread["unknowns"] = others
    if keep.surface:
        spread["surface"] = surface_group(model, modes, p=p, R=R)
    if keep.stress:
        spread["stress"] = stress_group(model, modes, frames=frames, p=p, R=R)
    return spread


def nodal_group(model: LinearModel, modes: FloatArray, *, p: FloatArray, R: FloatArray) -> SpreadGroup[NodalModes]:
    """The modes at all displacement nodes, by `node_numbers`, ascending (`NodalModes`). Collective.

    Args:
        model: the body.
        modes: (local dofs including ghosts, n), in the mesh's axes.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.
    """
    numbers = node_numbers(model)[: model.n_owned_nodes]
    node = all_numbers(model.comm, numbers)
    x, phi = _at_nodes(model, modes, node, np.arange(len(numbers)), numbers, p=p, R=R)
    return SpreadGroup(NodalModes, {"node": node, "x": x, "phi": phi})


def _at_nodes(
    model: LinearModel,
    modes: FloatArray,
    node: IntArray,
    here: NDArray[np.intp],
    numbers: IntArray,
    *,
    p: FloatArray,
    R: FloatArray,
) -> tuple[FloatArray, SpreadRows]:
    """Places (k, 3) of the nodes with numbers `node`, ascending, and the modes (k, 3, n) there, in B. Collective.

    Args:
        model: the body.
        modes: as of `nodal_group`, and so are `p` and `R`.
        node: (k,) the same on all ranks.
        here: (m,) this rank's own nodes among them.
        numbers: (m,) theirs.
        p: see there.
        R: see there.
    """
    place = np.searchsorted(node, numbers)
    x = SpreadRows(model.comm, len(node), place, (3,), lambda which: model.node_x[here[which]]).whole()

    def rows(which: NDArray[np.intp]) -> FloatArray:
        return np.einsum("ba,kbn->kan", R, modes[model.displacement_dofs[here[which]]])

    # by one rank, so that all have the same bits
    moved = parallel.on_root(model.comm, lambda: (x - p) @ R)
    return moved, SpreadRows(model.comm, len(node), place, (3, modes.shape[1]), rows)


def nodal_interfaces_group(
    model: LinearModel, names: Sequence[str], modes: FloatArray, *, p: FloatArray, R: FloatArray
) -> NodalInterfaces:
    """The nodes of the nodal interfaces of some names with their modes; arguments as in `nodal_group`. Collective."""
    nodes = retained_nodes(model, names)
    here = np.flatnonzero(nodes.local >= 0)
    phi = np.zeros((len(nodes.node), 3, modes.shape[1]))
    phi[here] = np.einsum("ba,kbn->kan", R, modes[model.displacement_dofs[nodes.local[here]]])
    return NodalInterfaces(tuple(names), nodes.node, (nodes.x - p) @ R, nodes.interface, total(model.comm, phi))


def further_unknowns(model: LinearModel, modes: FloatArray) -> SpreadGroup[FurtherUnknowns] | None:
    """What the modes hold beside displacements, by `dof_numbers`, ascending; None where that is nothing. Collective.

    Args:
        model: the body.
        modes: (local dofs including ghosts, n), in the mesh's axes.
    """
    others = further_dofs(model)
    if model.comm.allreduce(len(others)) == 0:
        return None
    owned = others < model.n_owned
    numbers, mine = dof_numbers(model, others)[owned], others[owned]
    dof = all_numbers(model.comm, numbers)
    place = np.searchsorted(dof, numbers)
    phi = SpreadRows(model.comm, len(dof), place, (modes.shape[1],), lambda which: modes[mine[which]])
    return SpreadGroup(FurtherUnknowns, {"dof": dof, "phi": phi})


def surface_group(model: LinearModel, modes: FloatArray, *, p: FloatArray, R: FloatArray) -> SpreadGroup[Surface]:
    """The boundary's triangles with their modes (`Surface`); arguments as in `nodal_group`. Collective."""
    numbers = node_numbers(model)
    triangles = np.concatenate(model.comm.allgather(numbers[boundary_triangles(model)]))
    used = np.unique(triangles)
    here = np.flatnonzero(np.isin(numbers[: model.n_owned_nodes], used))
    x, phi = _at_nodes(model, modes, used, here, numbers[here], p=p, R=R)
    rows = np.searchsorted(used, sorted_triangles(triangles))
    return SpreadGroup(Surface, {"x": x, "triangle": rows, "phi": phi})
