"""Contact patches of a record against the unreduced body: statics, places, and what is refused."""

import dataclasses
import functools

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from bracket import turned
from full_model import FullModel
from patch_loads import loads_of

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, NodalInterface, SymmetryPlane
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.node_order import NodeOrder, node_permutation
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.continuum.matrices.blocks import multiply
from flexmbd.coupling import Coupling
from flexmbd.errors import MeshError, RecordError, ReductionError
from flexmbd.forms import plate_mitc, solid_linear
from flexmbd.reduction import (
    BlockMethod,
    InterfaceModes,
    Keep,
    ModalDerivatives,
    Patch,
    Pressure,
    Truncation,
    craig_bampton,
    guyan,
    prestressed,
)
from flexmbd.reduction.contact.found_patches import find_patches
from flexmbd.reduction.contact.residual_flexibility import patch_responses, residual_shapes
from flexmbd.reduction.modes.fixed_modes import fixed_interface_modes
from flexmbd.reduction.static_shapes.body_statics import body_statics

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
SIZE, DIVISIONS = (0.06, 0.04, 0.03), (6, 4, 3)
ENDS = (
    Interface("x_min", axes=turned(0.2, -0.4, 0.1)),
    Interface("x_max", axes=turned(-0.3, 0.1, 0.7), origin=(0.065, 0.01, 0.0)),
)
#: Of the top all but what touches the ends: 4 x 4 facets of 1 cm.
TOP = Patch("top", size=0.02, facets=lambda x: (x[2] > 0.0149) & (x[0] > 0.009) & (x[0] < 0.051))
SIDE = Patch("side", size=0.015, facets=lambda x: (x[1] > 0.0199) & (x[0] > 0.009) & (x[0] < 0.051))


@functools.cache
def block(*interfaces, cell="hexahedron", shared=False, size=SIZE, divisions=DIVISIONS, degree=2, supports=()):
    """On all ranks together, or on each alone."""
    comm = MPI.COMM_WORLD if shared else MPI.COMM_SELF
    mesh = meshes.block(*size, divisions=divisions, cell=cell, comm=comm)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=degree, interfaces=interfaces, supports=supports)


def flexibility(body):
    """(3 p, 3 p) of modes and residual, the body held at its frame."""
    phi = body.contact.phi.reshape(3 * len(body.contact.area), body.n_modes)
    return (phi / body.stiffness) @ phi.T + body.contact.G


def full_flexibility(model, loads, *, held, moving):
    """(3 p, 3 p) of the unreduced block, its rigid ends held and moving."""
    full = FullModel(model)
    at = {"x_min": full.x[:, 0] < 1e-9, "x_max": full.x[:, 0] > SIZE[0] - 1e-9}
    t = full.bound([(at[name], model.interface(name).p) for name in (held, *moving)])[:, 6:]
    return loads.T @ (t @ scipy.sparse.linalg.spsolve((t.T @ full.K @ t).tocsc(), t.T @ loads))


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_statics_is_that_of_the_unreduced_body(cell):
    """With no, few and many modes, and with either end held; of free modes as well."""
    model = block(*ENDS, cell=cell)
    for frame, other in (("x_min", "x_max"), ("x_max", "x_min")):
        exact = None
        for modes in (0, 3, 12, Truncation(8, free=True)):
            body = craig_bampton(model, modes=modes, frame=frame, contact=[TOP, SIDE])
            if exact is None:
                exact = full_flexibility(model, loads_of(body, FullModel(model)), held=frame, moving=[other])
            assert abs(flexibility(body) - exact).max() < 1e-10 * abs(exact).max()


AVERAGED = Interface("x_max", coupling=Coupling.AVERAGED)
KINDS = {"rigid": ENDS, "averaged": (ENDS[0], AVERAGED), "nodal": (ENDS[0], NodalInterface("x_max"))}


@pytest.mark.parametrize("kind", KINDS)
def test_residual_flexibility_is_the_same_for_every_frame(kind):
    """Of the same modes: what stretches the body is another mode in another frame."""
    how, frames = {"modes": 6, "geometric_stiffness": False, "contact": [TOP]}, ("x_min", "x_max", None)
    frames = [one for one in frames if kind != "nodal" or one != "x_max"]
    bodies = [craig_bampton(block(*KINDS[kind]), frame=frame, **how) for frame in frames]
    first = bodies[0].contact
    for body in bodies[1:]:
        other = body.contact
        np.testing.assert_allclose(other.G, first.G, rtol=0, atol=1e-10 * abs(first.G).max())
        np.testing.assert_array_equal(other.area, first.area)
        for one in ("x", "axes"):
            mine, theirs = getattr(first, one), getattr(other, one)
            if one == "x":
                mine, theirs = mine + bodies[0].R_MB.T @ bodies[0].p_MB_M, theirs + body.R_MB.T @ body.p_MB_M
                np.testing.assert_allclose(theirs @ body.R_MB.T, mine @ bodies[0].R_MB.T, atol=1e-14)
            else:
                np.testing.assert_allclose(body.R_MB @ theirs, bodies[0].R_MB @ mine, atol=1e-14)


def test_a_floating_body_that_is_held_at_an_end():
    """By a constraint on the end's frame, in the place of the frame of the record."""
    model = block(*ENDS)
    body = craig_bampton(model, modes=4, contact=[TOP])
    exact = full_flexibility(model, loads_of(body, FullModel(model)), held="x_max", moving=["x_min"])
    contact, n = body.contact, body.n_modes
    moved = np.zeros((len(contact.area), 3, 6))
    moved[:, :, :3] = contact.axes.swapaxes(1, 2)
    arms = np.cross(np.eye(3)[:, None], contact.x).transpose(1, 2, 0)
    moved[:, :, 3:] = np.einsum("pba,pbc->pac", contact.axes, arms)
    rows = np.hstack([moved.reshape(-1, 6), contact.phi.reshape(-1, n)])
    end = body.interface("x_max")
    motion = np.zeros((6, 6))
    motion[:3, :3] = motion[3:, 3:] = np.eye(3)
    motion[:3, 3:] = np.cross(np.eye(3), end.p_BI_B).T
    held = np.hstack([motion, end.modes])
    K = scipy.linalg.block_diag(np.zeros((6, 6)), np.diag(body.stiffness))
    null = scipy.linalg.null_space(held / np.append(np.ones(6), np.sqrt(body.stiffness)))
    null = null / np.append(np.ones(6), np.sqrt(body.stiffness))[:, None]
    found = rows @ null @ np.linalg.solve(null.T @ K @ null, null.T @ rows.T) + contact.G
    assert abs(found - exact).max() < 1e-9 * abs(exact).max()


def test_a_body_that_nothing_holds():
    """Inertia relief: self-balanced loads, and displacements without momentum, by dense matrices."""
    model = block(divisions=(4, 3, 2), size=(0.04, 0.03, 0.02))
    top = Patch("top", size=0.02, facets="z_max")
    full = FullModel(model)
    K, M, R = full.K.toarray(), full.M.toarray(), full.rigid(np.zeros(3))
    for modes in (0, 9):
        body = craig_bampton(model, modes=modes, contact=[top])
        loads = loads_of(body, full)
        mass = R.T @ M @ R
        u = scipy.linalg.pinvh(K, atol=0, rtol=1e-9) @ (loads - M @ R @ np.linalg.solve(mass, R.T @ loads))
        u -= R @ np.linalg.solve(mass, R.T @ M @ u)
        exact = loads.T @ u
        assert abs(flexibility(body) - exact).max() < 1e-9 * abs(exact).max()


def test_more_modes_leave_less():
    how = {"frame": "x_min", "geometric_stiffness": False, "contact": [TOP]}
    few, more = (craig_bampton(block(*ENDS), modes=n, **how).contact.G for n in (4, 16))
    size = abs(few).max()
    assert np.linalg.eigvalsh(more)[0] > -1e-12 * size
    assert np.linalg.eigvalsh(few - more)[0] > -1e-12 * size
    assert np.trace(more) < 0.99 * np.trace(few)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.LockingWarning")
def test_all_modes_leave_nothing():
    """Of a small body, with all 54 deformations."""
    model = block(Interface("x_min"), degree=1, divisions=(3, 2, 1), size=(0.03, 0.02, 0.01))
    top = Patch("top", size=0.02, facets=lambda x: (x[2] > 0.0049) & (x[0] > 0.009))
    none, every = (
        craig_bampton(model, modes=n, frame="x_min", geometric_stiffness=False, contact=[top]) for n in (0, 54)
    )
    assert abs(every.contact.G).max() < 1e-12 * abs(none.contact.G).max()
    assert abs(flexibility(every) - flexibility(none)).max() < 1e-12 * abs(flexibility(none)).max()


@pytest.mark.parametrize("coupling", [Coupling.RIGID, Coupling.AVERAGED])
def test_residual_shapes_are_at_rest_at_the_interfaces(coupling):
    """And have no strain energy in common with the modes."""
    model = block(Interface("x_min", coupling=coupling), Interface("x_max"))
    with body_statics(model, frame="x_min") as statics:
        start = np.asfortranarray(np.random.default_rng(2).normal(size=(int(statics.mask.sum()), 3)))
        modes = fixed_interface_modes(statics, Truncation(5), start=start, eigensolver=BlockMethod()).modes
        shapes = np.zeros((model.n_owned, len(modes.eigenvalues)), order="F")
        shapes[statics.mask] = modes.shapes
        found = patch_responses(statics, find_patches(model, [TOP]))
        rest = residual_shapes(statics, dataclasses.replace(modes, shapes=shapes), found)
    assert not rest[model.interface("x_max").dofs].any()
    first, size = model.interface("x_min"), abs(rest).max()
    if coupling is Coupling.RIGID:
        assert not rest[first.dofs].any()
    else:
        means = first.average.T @ rest[first.dofs]
        assert abs(means[:3]).max() < 1e-10 * size
        assert abs(means[3:]).max() < 1e-10 * size / SIZE[2]
    forces = multiply(model.K, np.asfortranarray(rest))
    scale = np.sqrt(np.outer(modes.eigenvalues, np.einsum("ij,ij->j", rest, forces)))
    assert abs(shapes.T @ forces / scale).max() < 1e-9


@pytest.mark.parametrize("modes", [0, 10])
def test_averaged_interfaces_may_be_touched(modes):
    """Modes of any number give the same statics, with patches up to the edge of an averaged interface."""
    model = block(Interface("x_min", coupling=Coupling.AVERAGED), ENDS[1])
    near = Patch("near", size=0.02, facets=lambda x: (x[2] > 0.0149) & (x[0] < 0.051))
    found = craig_bampton(model, modes=modes, frame="x_min", contact=[near])
    many = craig_bampton(model, modes=30, frame="x_min", contact=[near])
    assert abs(flexibility(found) - flexibility(many)).max() < 1e-10 * abs(flexibility(many)).max()


def test_half_of_a_block_behind_its_plane_of_symmetry():
    """A force of 1 N on half of a patch is one of 2 N on the whole."""
    size, divisions = (0.06, 0.02, 0.03), (6, 2, 3)
    plane = (SymmetryPlane("y_min", (0, 1, 0)),)
    half = block(Interface("x_min", origin=(0, -0.01, 0)), size=size, divisions=divisions, supports=plane)
    whole = block(Interface("x_min"))
    strip = lambda x: (x[2] > 0.0149) & (x[0] > 0.019) & (x[0] < 0.041)  # noqa: E731
    one = craig_bampton(half, modes=3, frame="x_min", contact=[Patch("strip", size=0.04, facets=strip)])
    other = craig_bampton(whole, modes=3, frame="x_min", contact=[Patch("strip", size=0.04, facets=strip)])
    assert len(one.contact.area) == len(other.contact.area) == 1
    assert flexibility(one)[0, 0] == pytest.approx(2 * flexibility(other)[0, 0], rel=1e-9)


def test_patches_add_up_to_an_even_pressure():
    """The work of a pressure on the modes, which other code computes; of patches of unlike areas."""
    model = block(*ENDS, cell="tetrahedron")
    mesh = meshes.with_facet_groups(model.mesh, {"lid": TOP.facets})
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=ENDS)
    lid = Patch("lid", size=0.013)
    body = craig_bampton(model, modes=5, frame="x_min", loads=[Pressure("p", "lid")], contact=[lid])
    contact = body.contact
    assert len(set(np.round(contact.area, 12))) > 1
    assert contact.area.sum() == pytest.approx(0.04 * 0.04, rel=1e-12)
    work = np.einsum("p,pn->n", contact.area, contact.phi[:, 0])
    np.testing.assert_allclose(work, -body.loads.modal[0], atol=1e-10 * abs(work).max())


def test_the_dent_of_a_patch_is_that_of_any_fine_mesh():
    """Finer cells change it by less than two per cent; half of them let that of a point grow by more than a half."""
    dents, points = {}, {}
    on_pad = lambda x: (x[2] > 0.0099) & (abs(x[0] - 0.02) < 0.0101) & (abs(x[1]) < 0.0101)  # noqa: E731
    for n in (4, 8, 12):
        model = block(Interface("z_min"), size=(0.04, 0.04, 0.02), divisions=(n, n, n // 2))
        body = guyan(model, frame="z_min", contact=[Patch("pad", size=0.02, facets=on_pad)])
        assert len(body.contact.area) == 1
        dents[n] = body.contact.G[0, 0]
        if n < 12:
            full = FullModel(model)
            free = np.flatnonzero(np.repeat(full.x[:, 2] > -0.0099, 3))
            force = np.zeros(3 * len(full.x))
            force[3 * np.linalg.norm(full.x - (0.02, 0, 0.01), axis=1).argmin() + 2] = 1.0
            points[n] = scipy.sparse.linalg.spsolve(full.K[free][:, free].tocsc(), force[free]) @ force[free]
    assert dents[12] == pytest.approx(dents[8], rel=0.02)
    assert points[8] > 1.5 * points[4]


@pytest.mark.parametrize("modes", [3, Truncation(3, free=True)])
@pytest.mark.parametrize("stiffened", [True, False])
def test_as_many_contact_shapes_as_a_tolerance_asks(modes, stiffened):
    model, how = block(*ENDS), {"modes": modes, "frame": "x_min", "geometric_stiffness": stiffened}
    plain = craig_bampton(model, contact=[TOP, SIDE], **how)
    whole = np.diag(flexibility(guyan(model, frame="x_min", contact=[TOP, SIDE])))
    held = np.diag(guyan(model, frame="x_min", contact=[TOP, SIDE]).contact.G)
    assert (held < whole).all()
    number = None
    for tol in (0.6, 0.2):
        body = craig_bampton(model, contact=[dataclasses.replace(TOP, tol=tol), SIDE], **how)
        shares = np.diag(body.contact.G) / held
        top = np.repeat(body.contact.surface == 0, 3)
        assert (shares[top] <= tol * (1 + 1e-9)).all()
        assert (shares[~top] > tol).any()
        kept = int(body.provenance["contact shapes"])
        assert 0 < kept < 3 * (body.contact.surface == 0).sum()
        assert number is None or kept > number
        number = kept
        assert body.n_modes == plain.n_modes + kept
        assert body.partition_names[-1] == f"contact {kept}"
        # statics does not mind, and vibrations fall
        assert abs(flexibility(body) - flexibility(plain)).max() < 1e-10 * abs(flexibility(plain)).max()
        assert (body.frequencies()[:6] <= plain.frequencies()[:6] * (1 + 1e-9)).all()


def test_the_provenance_tells_what_the_modes_leave_out():
    bodies = [craig_bampton(block(*ENDS), modes=n, frame="x_min", contact=[TOP]) for n in (0, 4)]
    for body, said in zip(bodies, ("100", None), strict=True):
        text = body.provenance["contact top"]
        share = 100 * np.diag(body.contact.G)[0] / np.diag(bodies[0].contact.G)[0]
        low = float(text.split("modes leave out\n")[1].split(" ")[0])
        assert said is None or low == float(said)
        assert low <= share * 1.01
        assert "4 of 0.0004 m^2 and 4 facets;" in text
    sheet = bodies[1].inspect()
    assert "4 patches; for patches that may be touched" in sheet
    assert "top: 4 patches, 0.0004 to 0.0004 m^2; beside the modes" in sheet


def test_a_record_without_patches_is_what_it_was(tmp_path):
    """And what patches add to a record changes nothing else of it, but for the digest of all."""
    model, how = block(*ENDS), {"modes": 4, "frame": "x_min", "keep": Keep(modes=True)}
    plain, none, some = (craig_bampton(model, **how, **more) for more in ({}, {"contact": []}, {"contact": [TOP]}))
    for name, body in (("a.h5", plain), ("b.h5", none)):
        body.save(tmp_path / name)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()
    assert plain.contact is None
    mine, theirs = plain.tree(), some.tree()
    assert theirs.pop("contact") is not None
    assert theirs["provenance"].pop("contact top").startswith("Patch('top', size=0.02, facets=<function <lambda>>)")
    assert float(theirs["provenance"].pop("round-off of the contact patches")) < 1e-12
    assert mine.keys() == theirs.keys()
    for key, value in mine.items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, theirs[key])
    assert mine["provenance"] == theirs["provenance"]
    assert some.fingerprint() != plain.fingerprint()
    some.save(tmp_path / "c.h5")
    again = fm.ReducedBody.load(tmp_path / "c.h5")
    for item in dataclasses.fields(again.contact):
        np.testing.assert_array_equal(getattr(again.contact, item.name), getattr(some.contact, item.name))
    # written while it is made: the same file
    craig_bampton(model, **how, contact=[TOP], stream=tmp_path / "d.h5")
    assert (tmp_path / "c.h5").read_bytes() == (tmp_path / "d.h5").read_bytes()


def test_exports_tell_what_they_leave_out(tmp_path):
    body = craig_bampton(block(*ENDS), modes=2, frame="x_min", contact=[TOP])
    lost = fm.export.op4(body, tmp_path / "a.op4")
    assert any("the contact patches (top)" in phrase for phrase in lost)
    assert fm.export.npz(body, tmp_path / "a.npz") == ()
    np.testing.assert_array_equal(fm.export.read_npz(tmp_path / "a.npz").contact.G, body.contact.G)


def test_curved_surfaces_have_their_normals():
    """Of the outside of a tube: outwards; and the mean displacements of rigid motions."""
    mesh = meshes.tube(0.1, 0.03, 0.02, h=0.012, cell="hexahedron", degree=2, comm=MPI.COMM_SELF)
    start = Interface("start", coupling=Coupling.AVERAGED)
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[start])
    rim = Patch("outer", size=0.02)
    found = find_patches(model, [rim])
    radial = found.x * (0, 1, 1)
    assert (np.einsum("pa,pa->p", found.axes[:, :, 0], radial) > 0.98 * np.linalg.norm(radial, axis=1)).all()
    # arcs as parabolas
    assert found.area.sum() == pytest.approx(2 * np.pi * 0.03 * 0.1, rel=1e-3)
    motions = found.means(model.rigid_motions(np.zeros(3), np.eye(3))).reshape(-1, 3, 6)
    np.testing.assert_allclose(motions[:, :, :3], found.axes.swapaxes(1, 2), atol=1e-12)
    arms = np.cross(np.eye(3)[:, None], found.x).transpose(1, 2, 0)
    np.testing.assert_allclose(motions[:, :, 3:], np.einsum("pba,pbc->pac", found.axes, arms), atol=1e-13)
    with pytest.raises(ReductionError, match=r"'outer': the patch at .* is bent so far .* give a smaller size"):
        find_patches(model, [dataclasses.replace(rim, size=0.2)])


@pytest.mark.parametrize(("height", "count"), [(0.03, 28), (0.002, 18)])
def test_no_patch_goes_around_an_edge(height, count):
    """All around a block, and around a sheet that is thinner than a patch."""
    model = block(ENDS[0], ENDS[1], size=(0.06, 0.04, height), divisions=(6, 4, 3 if height > 0.01 else 1))
    around = Patch("around", size=0.0142, facets=lambda x: (x[0] > 0.009) & (x[0] < 0.051))
    found = find_patches(model, [around])
    assert len(found.area) == count
    normal = found.axes[:, :, 0]
    np.testing.assert_allclose(np.sort(abs(normal), axis=1), np.tile([0.0, 0.0, 1.0], (count, 1)), atol=1e-12)
    # each on its face of the block
    on_face = np.einsum("pa,pa->p", normal, found.x)
    np.testing.assert_allclose(on_face, abs(normal) @ [0.0, 0.02, height / 2], atol=1e-12)
    assert (found.area < 1.3 * 0.0142**2).all()


@pytest.mark.mpi
def test_two_ranks_find_the_patches_of_one():
    bodies = [
        craig_bampton(block(*ENDS, cell="tetrahedron", shared=shared), modes=4, frame="x_min", contact=[TOP, SIDE])
        for shared in (True, False)
    ]
    mine, alone = (body.contact for body in bodies)
    for name in ("names", "surface", "patch", "facet"):
        np.testing.assert_array_equal(getattr(mine, name), getattr(alone, name))
    for name in ("x", "axes", "area"):
        np.testing.assert_allclose(getattr(mine, name), getattr(alone, name), atol=1e-13)
    np.testing.assert_allclose(mine.G, alone.G, atol=1e-10 * abs(alone.G).max())
    digests = MPI.COMM_WORLD.allgather(bodies[0].fingerprint())
    assert len(set(digests)) == 1


def test_the_numbers_of_the_nodes_do_not_matter():
    """The same points in another order; a divided surface has the same patches, whose order may differ."""

    source = block(cell="tetrahedron").mesh.mesh
    back = np.argsort(node_permutation("tetrahedron", 1, NodeOrder.VTK))
    points, cells = source.geometry.x, cell_nodes(source)[:, back]
    rng = np.random.default_rng(3)
    found = []
    for order in (np.arange(len(points)), rng.permutation(len(points))):
        place = np.argsort(order)
        groups = {"x_min": lambda x: x[0] < 1e-9}
        mesh = from_arrays(
            MPI.COMM_SELF, points[order], place[cells], degree=1, order=NodeOrder.VTK, facet_groups=groups
        )
        model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min")])
        found.append(guyan(model, frame="x_min", contact=[dataclasses.replace(TOP, size=0.012)]).contact)
    np.testing.assert_allclose(found[0].x, found[1].x, atol=1e-12)
    np.testing.assert_allclose(found[0].area, found[1].area, atol=1e-12)
    np.testing.assert_allclose(found[0].G, found[1].G, atol=1e-9 * abs(found[0].G).max())


def broken(x):
    """A function that is wrong."""
    raise ZeroDivisionError


EDGE = Patch("edge", size=0.02, facets=lambda x: x[2] > 0.0149)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("patches", "error", "message"),
    [
        ([TOP, TOP], ReductionError, "two contact patches are called 'top'"),
        ([TOP, dataclasses.replace(TOP, name="lid")], ReductionError, "'top' and 'lid' overlap: they share 16 facets"),
        ([EDGE], ReductionError, "'edge' shares .* nodes with the interface 'x_min', .* leave out the facets at its"),
        ([dataclasses.replace(TOP, size=0.005)], ReductionError, "patches of 0.005 m are finer than the mesh.* 0.02 m"),
        ([Patch("bore", size=0.02)], MeshError, "contact patch 'bore' on 'bore': the mesh has no such group of facets"),
        ([Patch("far", size=0.02, facets=lambda x: x[0] > 9.0)], MeshError, "'far': no boundary facet lies in it"),
        ([Patch("odd", size=0.02, facets=broken)], MeshError, "'odd': its function raised ZeroDivisionError"),
    ],
)
def test_patches_that_are_refused(patches, error, message):
    with pytest.raises(error, match=message):
        guyan(block(*ENDS, shared=True), frame="x_min", contact=patches)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "", "size": 1.0}, "name that is not empty"),
        ({"name": "a", "size": 0.0}, "'a': size must be positive"),
        ({"name": "a", "size": "2 mm"}, "size must be a finite number"),
        ({"name": "a", "size": 1.0, "tol": 1.5}, "'a': tol must be a share between 0 and 1"),
        ({"name": "a", "size": 1.0, "facets": 3}, "facets must be a text or a function or None"),
    ],
)
def test_a_patch_that_is_not_well_formed(arguments, message):
    with pytest.raises(ReductionError, match=message):
        Patch(**arguments)


def test_bodies_that_have_no_patches():
    with pytest.raises(ReductionError, match="contact must be a list, each a Patch"):
        guyan(block(*ENDS), frame="x_min", contact="top")
    to_end = Patch("to_end", size=0.02, facets=lambda x: (x[2] > 0.0149) & (x[0] > 0.009))
    with pytest.raises(ReductionError, match="'to_end' shares 9 nodes with the interface 'x_max'"):
        guyan(block(ENDS[0], NodalInterface("x_max")), frame="x_min", contact=[to_end])
    bent = ModalDerivatives({"x_max.z": 1.0})
    with pytest.raises(ReductionError, match="goes without nonlinear="):
        craig_bampton(block(*ENDS), modes=1, frame="x_min", nonlinear=bent, contact=[TOP])
    with pytest.raises(ReductionError, match="goes without interface_modes="):
        craig_bampton(block(*ENDS), modes=1, frame="x_min", interface_modes=InterfaceModes(3), contact=[TOP])
    loaded = prestressed(block(*ENDS), frame="x_min", forces={"x_max": (1.0, 0, 0, 0, 0, 0)})
    with pytest.raises(ReductionError, match="'top', are of a body at rest"):
        guyan(loaded, frame="x_min", contact=[TOP])
    sheet = meshes.sheet(0.1, 0.1, divisions=(2, 2), comm=MPI.COMM_SELF)
    shell = ContinuumModel(
        sheet, plate_mitc, plate_mitc.Parameters(E=2e11, nu=0.3, rho=7e3, t=1e-3), degree=1,
        interfaces=[Interface("x_min")],
    )  # fmt: skip
    with pytest.raises(ReductionError, match="'x_max', are on facets of solids"):
        guyan(shell, frame="x_min", contact=[Patch("x_max", size=0.1)])


def test_records_that_do_not_fit():
    body = craig_bampton(block(*ENDS), modes=2, frame="x_min", contact=[TOP])
    contact = body.contact
    assert contact is not None
    faults = {
        "area": (-contact.area, "a patch has the area -"),
        "G": (-contact.G, "G is negative"),
        "axes": (2 * contact.axes, "axes that are no rotation"),
        "patch": (contact.patch + 4, "facets are of patches 4 to 7, and there are 4"),
        "surface": (contact.surface + 1, r"of surfaces \[1\], and there are 1 names"),
        "phi": (contact.phi[:, :, 1:], r"phi \(4, 3, \d+\), expected"),
        "x": (np.full_like(contact.x, np.nan), "x holds values that are not finite"),
    }
    for name, (value, message) in faults.items():
        with pytest.raises(RecordError, match=message):
            dataclasses.replace(body, contact=dataclasses.replace(contact, **{name: value}))
    skew = dataclasses.replace(contact, G=contact.G + np.triu(np.ones_like(contact.G), 1) * contact.G.max())
    with pytest.raises(RecordError, match="G is not symmetric"):
        dataclasses.replace(body, contact=skew)
