"""Distributed loads of the record: resultants, work, and what their static response lacks."""

import re

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse.linalg
import ufl
from bracket import ALUMINIUM, DIVISIONS, GROUPS, HEIGHT, LENGTH, SHIFT, TURN, WIDTH, bracket, transformation
from dolfinx import fem
from full_model import FullModel

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.grid.node_order import NodeOrder, node_permutation
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.continuum.matrices.blocks import inner
from flexmbd.errors import MeshError, ReductionError
from flexmbd.forms import solid_linear
from flexmbd.reduction import BodyForce, Keep, Pressure, Traction, craig_bampton, guyan
from flexmbd.reduction.unit_loads import load_vectors

RADIUS = 0.03


def half_bore(comm):
    """A tube along x of curved hexahedra, whose bore is tagged where y > 0."""
    source = meshes.tube(0.2, 0.05, RADIUS, h=0.05, cell="hexahedron", degree=2, comm=MPI.COMM_SELF)

    def on_bore(x):
        return (np.hypot(x[1], x[2]) < RADIUS * 1.01) & (x[1] > -1e-9)

    groups = {"start": lambda x: x[0] < 1e-9, "end": lambda x: x[0] > 0.2 - 1e-9, "bore": on_bore}
    back = np.argsort(node_permutation("hexahedron", 2, NodeOrder.VTK))
    return from_arrays(
        comm,
        source.mesh.geometry.x,
        cell_nodes(source.mesh)[:, back],
        cell="hexahedron",
        degree=2,
        order=NodeOrder.VTK,
        facet_groups=groups,
    )


@pytest.mark.mpi
def test_pressure_on_a_curved_surface():
    """Pressure times the projected area, whose edge the mesh has exactly, whatever the facets between."""
    model = ContinuumModel(
        half_bore(MPI.COMM_WORLD),
        solid_linear,
        ALUMINIUM,
        degree=2,
        interfaces=[Interface("start"), Interface("end")],
    )
    loads = [Pressure("bore", facets="bore"), Pressure("cap", facets="end")]
    found = guyan(model, frame="start", loads=loads).loads
    assert found.names == ("bore", "cap")
    force = 2 * RADIUS * 0.2
    # out of the bore, that is along y; the body frame is at the middle of the start
    assert found.force[0] == pytest.approx([0.0, force, 0.0], abs=1e-12 * force)
    assert found.moment[0] == pytest.approx([0.0, 0.0, 0.1 * force], abs=1e-12 * force)
    # arcs as parabolas
    area = np.pi * (0.05**2 - RADIUS**2)
    assert found.force[1] == pytest.approx([-area, 0.0, 0.0], rel=1e-3, abs=1e-10 * area)


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_pressure_all_around(cell):
    """On a whole surface it has no resultant; it does the work of the volume's change."""
    size = (0.3, 0.2, 0.1)
    mesh = meshes.block(*size, divisions=(3, 2, 1), cell=cell, comm=MPI.COMM_WORLD)
    faces = [f"{axis}_{end}" for axis in "xyz" for end in ("min", "max")]
    model = ContinuumModel(mesh, solid_linear, ALUMINIUM, degree=2, interfaces=[Interface("x_min")])
    forces = load_vectors(model, [Pressure(face, face) for face in faces]).sum(axis=1, keepdims=True)
    resultant = inner(model.comm, forces, model.rigid_motions([0.1, 0.2, 0.3], np.eye(3)))
    assert abs(resultant).max() < 1e-14
    # u = (x y, y, x z): its divergence y + 1 + x over the box, y and z from the middle
    x, y, z = model.node_x[: model.n_owned_nodes].T
    field = np.zeros((model.n_owned, 1))
    field[model.displacement_dofs[: model.n_owned_nodes], 0] = np.column_stack([x * y, y, x * z])
    volume = np.prod(size)
    assert inner(model.comm, forces, field).item() == pytest.approx(-volume * (1.0 + size[0] / 2), rel=1e-12)


@pytest.mark.mpi
def test_pressure_all_around_curved_cells():
    """The work on any displacement is minus the volume's change, by the divergence in the cells."""
    mesh = meshes.tube(0.2, 0.05, RADIUS, h=0.05, cell="hexahedron", degree=2, comm=MPI.COMM_WORLD)
    model = ContinuumModel(mesh, solid_linear, ALUMINIUM, degree=2, interfaces=[Interface("start")])
    faces = ("start", "end", "inner", "outer")
    forces = load_vectors(model, [Pressure(face, face) for face in faces]).sum(axis=1, keepdims=True)
    field = fem.Function(model.space)
    field.interpolate(lambda x: np.cos(np.array([[30.0, 70.0, 0.0], [50.0, 0.0, 20.0], [0.0, 90.0, 40.0]]) @ x))
    change = fem.assemble_scalar(fem.form(ufl.div(field) * ufl.dx(metadata={"quadrature_degree": 12})))
    work = inner(model.comm, forces, field.x.array[: model.n_owned, None]).item()
    assert work == pytest.approx(-model.comm.allreduce(change), rel=1e-11)


def pad_forces(model, full, traction):
    """Uniform traction on the triangles of the pad, a third on each corner: (3 n,) by the numbers of the nodes."""
    on_pad = GROUPS["pad"](full.x.T)
    forces = np.zeros_like(full.x)
    area = 0.0
    cells = model.space.dofmap.list
    numbers = node_numbers(model)
    for cell in cells:
        corners = numbers[cell]
        on = corners[on_pad[corners]]
        if len(on) == 3:
            a, b, c = full.x[on]
            part = np.linalg.norm(np.cross(b - a, c - a)) / 2
            forces[on] += part / 3 * np.asarray(traction)
            area += part
    return forces.reshape(-1), area


@pytest.mark.parametrize("frame", ["root", None])
def test_work_and_resultant_of_a_traction(frame):
    """By the triangles' areas, in the axes of a body frame that lies askew."""
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    full = FullModel(model)
    direction = np.array([0.3, -0.5, 0.8])
    unit = direction / np.linalg.norm(direction)
    forces, area = pad_forces(model, full, unit)
    assert area == pytest.approx(WIDTH * LENGTH / DIVISIONS[0], rel=1e-12)
    body = craig_bampton(
        model, modes=6, frame=frame, loads=[Traction("wind", "pad", direction)], keep=Keep(modes=True)
    )
    p, R = body.p_MB_M, body.R_MB
    found = body.loads
    assert found.force[0] == pytest.approx(R.T @ unit * area, rel=1e-12)
    moment = np.cross(full.x - p, forces.reshape(-1, 3)).sum(axis=0)
    assert found.moment[0] == pytest.approx(R.T @ moment, rel=1e-10, abs=1e-12)
    work = np.einsum("ka,kan->n", forces.reshape(-1, 3) @ R, body.modes.phi)
    assert found.modal[0] == pytest.approx(work, rel=1e-9, abs=1e-12 * abs(work).max())
    pushed = guyan(model, frame=frame, loads=[Pressure("push", "pad")]).loads
    assert pushed.force[0] == pytest.approx(-area * R.T @ TURN[:, 2], rel=1e-12)


def test_body_force():
    """Its work is that of a uniform acceleration, over the density."""
    body = guyan(bracket(comm=MPI.COMM_SELF), frame="tip", loads=[BodyForce("field", (0.0, 3.0, 4.0))])
    direction = body.R_MB.T @ [0.0, 0.6, 0.8]
    volume = LENGTH * WIDTH * HEIGHT
    assert body.loads.force[0] == pytest.approx(volume * direction, rel=1e-12)
    expected = body.gram[0, 4:].reshape(-1, 3) @ direction / ALUMINIUM.rho
    assert body.loads.modal[0] == pytest.approx(expected, rel=1e-9, abs=1e-12 * abs(expected).max())
    assert body.loads.moment[0] == pytest.approx(np.cross(body.com, volume * direction), rel=1e-9)


def missing(body, name):
    return float(re.search(r"missing (\S+)$", body.provenance[f"load {name}"])[1])


def static_energies(full, t, loads, *, held):
    """Twice the strain energies of the unreduced response to each of the loads (3 n + ..., k) in coordinates t."""
    k, m = (t.T @ matrix @ t for matrix in (full.K, full.M))
    if held:
        k, f = k[6:, 6:].tocsc(), loads[6:]
        return (f * scipy.sparse.linalg.spsolve(k, f)).sum(axis=0)
    rigid = np.linalg.lstsq(t.toarray(), full.rigid(np.zeros(3)), rcond=None)[0]
    f = loads - m @ rigid @ np.linalg.solve(rigid.T @ m @ rigid, rigid.T @ loads)
    return (f * np.linalg.lstsq(k.toarray(), f, rcond=1e-11)[0]).sum(axis=0)


@pytest.mark.parametrize("frame", ["root", None])
def test_what_the_static_response_lacks(frame):
    """Against the energy of the full model's response; it falls with the modes.

    On an interface it is none where the frame is held; else the body's inertia answers, which is not a load of the
    interface.
    """
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    full = FullModel(model)
    t = transformation(full, axes=np.eye(3))
    side, hold = Traction("side", "pad", TURN[:, 1]), Traction("hold", "tip", (1.0, 2.0, 3.0))
    force = WIDTH * HEIGHT * hold.direction
    arm = TURN @ [LENGTH, 0.0, 0.0] + SHIFT - model.interface("tip").p
    loads = np.zeros((t.shape[1], 2))
    loads[:, 0] = t.T @ pad_forces(model, full, TURN[:, 1])[0]
    loads[6:12, 1] = [*force, *np.cross(arm, force)]
    energy = static_energies(full, t, loads, held=frame is not None)
    parts = []
    for modes in (0, 2, 8, 33):
        body = craig_bampton(
            model, modes=modes, frame=frame, loads=[side, hold], geometric_stiffness=modes == 2
        )
        expected = 1.0 - (body.loads.modal**2 / body.stiffness).sum(axis=1) / energy
        found = [missing(body, "side"), missing(body, "hold")]
        assert found == pytest.approx(expected, rel=0.06, abs=1e-9)
        parts.append(expected)
    parts = np.array(parts)
    assert np.all(np.diff(parts[:, 0]) < 0.0)
    assert parts[0, 0] > 0.01
    assert parts[-1, 0] < 0.3 * parts[0, 0]
    if frame is None:
        assert parts[0, 1] > 0.1
        assert parts[-1, 1] < 0.3 * parts[0, 1]
    else:
        assert abs(parts[:, 1]).max() < 1e-9


@pytest.mark.parametrize("frame", ["root", None])
def test_a_load_on_an_interface_is_a_load_of_the_interface(frame):
    """Modal forces and geometric stiffness follow from those of the interface's force and moment."""
    body = craig_bampton(
        bracket("root", "tip", comm=MPI.COMM_SELF), modes=4, frame=frame, loads=[Traction("pull", "tip", (1, 2, -2))]
    )
    tip = body.interface("tip")
    force = body.loads.force[0]
    moment = body.loads.moment[0] - np.cross(tip.p_BI_B, force)
    wrench = np.concatenate([force, moment])
    assert body.loads.modal[0] == pytest.approx(wrench @ tip.modes, rel=1e-8)
    loads = body.geometric.loads
    assert loads[-1] == "load pull"
    first = loads.index("tip.x")
    expected = np.einsum("l,lij->ij", wrench, body.geometric.K[first : first + 6])
    assert abs(body.geometric.K[-1] - expected).max() < 1e-8 * abs(expected).max()


@pytest.mark.mpi
def test_any_number_of_ranks():
    loads = [Pressure("p", "pad"), Traction("t", "pad", (1, 1, 0)), BodyForce("b", (0, 0, 1))]
    world, alone = (
        craig_bampton(bracket("root", "tip", comm=comm, degree=2), modes=2, frame="root", loads=loads)
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    for item in ("force", "moment", "modal"):
        one, other = (getattr(body.loads, item) for body in (world, alone))
        assert abs(one - other).max() < 1e-10 * abs(other).max()
    assert len(set(MPI.COMM_WORLD.allgather(world.fingerprint()))) == 1


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("loads", "error", "match"),
    [
        ([Pressure("p", "lid")], MeshError, "no facet group 'lid'"),
        ([Pressure("p", "pad"), BodyForce("p", (1, 0, 0))], ReductionError, "two loads are called 'p'"),
        ([("p", "pad")], ReductionError, "loads must be a list, each a Pressure or a Traction or a BodyForce"),
        (Pressure("p", "pad"), ReductionError, "loads must be a list, each a Pressure"),
    ],
)
def test_bad_loads_are_refused_on_every_rank(loads, error, match):
    with pytest.raises(error, match=match):
        guyan(bracket("root", "tip", degree=1), frame="root", loads=loads)


@pytest.mark.parametrize("direction", [(0, 0, 0), (1, 2), (np.nan, 0, 0), "up", None, (1, 2, "x")])
def test_bad_directions_are_refused(direction):
    with pytest.raises(ReductionError, match="load 'wind': direction must be three finite numbers"):
        Traction("wind", "pad", direction)
    with pytest.raises(ReductionError, match="load 'wind': direction must be three finite numbers"):
        BodyForce("wind", direction)


def test_saved_and_loaded(tmp_path):
    body = guyan(bracket("root", "tip", comm=MPI.COMM_SELF, degree=1), frame="root", loads=[Pressure("p", "pad")])
    body.save(tmp_path / "body.h5")
    again = type(body).load(tmp_path / "body.h5")
    assert again.loads.names == ("p",)
    for item in ("force", "moment", "modal"):
        assert np.array_equal(getattr(again.loads, item), getattr(body.loads, item))
