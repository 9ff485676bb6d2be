"""Bodies that bend a lot: the energy against the form's own, turned faces, and bent beams against Euler's elastica."""

import types
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
import ufl
from dolfinx import fem
from full_model import gather
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, Roller, SymmetryPlane
from flexmbd.continuum.finite_elements.recovery import nodal_modes
from flexmbd.coupling import Coupling
from flexmbd.errors import RecordError, ReductionError
from flexmbd.forms import neo_hookean, solid_linear, st_venant_kirchhoff
from flexmbd.record.strain_polynomial import StrainPolynomial, monomials, places
from flexmbd.record.turned_face import turned_face
from flexmbd.reduction import BodyForce, Keep, ModalDerivatives, craig_bampton, load_vectors, prestressed
from flexmbd.reduction.large_displacements.energy_polynomial import by_derivatives, of_green_strain
from flexmbd.reduction.large_displacements.force_derivatives import force_derivatives

LENGTH, SIDE, MODULUS = 1.0, 0.04, 2.0e9
STIFFNESS = MODULUS * SIDE**4 / 12.0
# bends the beam by 30 % of its length
FORCE = STIFFNESS / LENGTH**2


def beam(form=st_venant_kirchhoff, *, cells=20, nu=0.0, coupling=Coupling.RIGID, comm=MPI.COMM_SELF):
    mesh = meshes.block(LENGTH, SIDE, SIDE, divisions=(cells, 1, 1), cell="hexahedron", degree=1, comm=comm)
    own = form.Parameters(E=MODULUS, nu=nu, rho=1000.0)
    ends = [Interface("x_min"), Interface("x_max", coupling=coupling)]
    return ContinuumModel(mesh, form, own, degree=2, interfaces=ends)


@pytest.fixture(scope="module")
def model():
    return beam()


@pytest.fixture(scope="module")
def body(model):
    loads = {"x_max.y": FORCE, "x_max.rz": 0.3 * FORCE * LENGTH}
    return craig_bampton(model, modes=0, frame="x_min", nonlinear=ModalDerivatives(loads), keep=Keep(modes=True))


def polynomial(body):
    return StrainPolynomial(body.stiffness, body.nonlinear.cubic, body.nonlinear.quartic)


def full_energy(model, u):
    """The form's strain energy, J, assembled by its own rule at a displacement (local dofs,)."""
    at = fem.Function(model.space)
    at.x.array[:] = u
    total = 0.0
    for group in model.groups:
        for density, rule in group.formulation.strain_energy(at, group.symbols):
            total += fem.assemble_scalar(fem.form(density * ufl.dx(metadata={"quadrature_degree": rule.degree})))
    return total


def elastica(force):
    """(x, y, angle) of the tip of an inextensible cantilever of length 1 under force L^2 / (E I), across it."""

    def slope(_, y):
        return np.array([np.cos(y[2]), np.sin(y[2]), y[3], -force * np.cos(y[2])])

    s = np.linspace(0, 1, 51)
    found = solve_bvp(slope, lambda a, b: np.array([a[0], a[1], a[2], b[3]]), s, np.zeros((4, 51)), tol=1e-8)
    return found.y[:3, -1]


def motion(body, name="x_max"):
    """(3, 4, n) [d | A] of a face."""
    number = [one.name for one in body.interfaces].index(name)
    rows, (xx, yy, zz, yz, xz, xy) = body.interfaces[number].modes, body.nonlinear.face_strain[number]
    strain = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    skew = np.array([[0.0 * xx, -rows[5], rows[4]], [rows[5], 0.0 * xx, -rows[3]], [-rows[4], rows[3], 0.0 * xx]])
    return np.concatenate([rows[:3, None], skew + strain], axis=1)


def face(body, q, name="x_max"):
    """(3,) displacement and (3, 3) I + A of a face."""
    d_A = motion(body, name) @ q
    return d_A[:, 0], np.eye(3) + d_A[:, 1:]


def turned(gradient):
    """(3, 3) by the square root of the stretch."""
    values, vectors = np.linalg.eigh(gradient.T @ gradient)
    return gradient @ (vectors / np.sqrt(values)) @ vectors.T


def under_moments(body, moments):
    """q under moments about z of fixed size, by the names of the faces."""
    own, q = polynomial(body), np.zeros(body.n_modes)
    for _ in range(30):
        rows = {name: turned_face(face(body, q, name)[1], motion(body, name)[:, 1:])[1][2] for name in moments}
        q = own.equilibrium(sum(size * rows[name] for name, size in moments.items()), start=q)
    return q


def test_the_variation_of_a_faces_rotation():
    rng = np.random.default_rng(2)
    gradient, slopes = np.eye(3) + 0.3 * rng.normal(size=(3, 3)), rng.normal(size=(3, 3, 2))
    R, rows = turned_face(gradient, slopes)
    np.testing.assert_allclose(R, turned(gradient), atol=1e-13)
    for i in range(2):
        ahead, behind = (turned(gradient + h * slopes[:, :, i]) for h in (1e-6, -1e-6))
        np.testing.assert_allclose(Rotation.from_matrix(ahead @ behind.T).as_rotvec() / 2e-6, rows[:, i], atol=1e-8)


@pytest.mark.parametrize("degree", [3, 4])
def test_the_order_of_the_coefficients(degree):
    n = 5
    every = [(i, *rest) for i in range(n) for rest in np.ndindex(*[i + 1] * (degree - 1))]
    ordered = [one for one in every if all(np.diff(one) <= 0)]
    assert monomials(n, degree).tolist() == [list(one) for one in ordered]
    shuffled = monomials(n, degree)[:, ::-1]
    assert places(shuffled).tolist() == list(range(len(ordered)))


def test_the_polynomial_is_the_energy_of_the_form():
    """Of a body with an averaged interface, whose face nothing keeps rigid."""
    model = beam(cells=10, coupling=Coupling.AVERAGED)
    choice = ModalDerivatives({"x_max.y": FORCE, "x_max.rz": 0.3 * FORCE * LENGTH})
    body = craig_bampton(model, modes=0, frame="x_min", nonlinear=choice, keep=Keep(modes=True))
    fields, rng = nodal_modes(body, model), np.random.default_rng(3)
    own = polynomial(body)
    for _ in range(3):
        # strains of some ten per cent, all coordinates alike in energy
        q = rng.normal(size=body.n_modes) / np.sqrt(body.stiffness) * 20.0
        assert own.energy(q) == pytest.approx(full_energy(model, fields @ q), rel=1e-11)
        step = rng.normal(size=body.n_modes) / np.sqrt(body.stiffness)
        # exact for a polynomial of degree four: differences of two widths, extrapolated
        wide, near = ((own.energy(q + h * step) - own.energy(q - h * step)) / (2.0 * h) for h in (0.2, 0.1))
        assert own.force(q) @ step == pytest.approx((4.0 * near - wide) / 3.0, rel=1e-10)
        wide, near = ((own.force(q + h * step) - own.force(q - h * step)) / (2.0 * h) for h in (0.2, 0.1))
        np.testing.assert_allclose(own.tangent(q) @ step, (4.0 * near - wide) / 3.0, rtol=1e-9, atol=1e-8)


def test_dense_products_against_the_derivatives_of_the_form():
    model = beam(cells=2, nu=0.3)
    modes = np.random.default_rng(5).normal(size=(model.layout.n_local, 4))
    dense, derived = of_green_strain(model, modes), by_derivatives(force_derivatives(model), modes)
    for one, other in zip(dense, derived, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11 * abs(other).max())


def test_another_energy_is_expanded_by_strains():
    """A neo-Hookean cantilever bends as its full model does; what the expansion leaves out is in the estimate."""
    model = beam(neo_hookean, cells=8, nu=0.3)
    known = ModalDerivatives({"x_max.y": FORCE}, tol=5e-3)
    body = craig_bampton(model, modes=0, frame="x_min", nonlinear=known)
    assert body.provenance["strain energy"].endswith("with the stiffness of flexmbd.forms.neo_hookean at rest")
    assert float(body.provenance["error of the strain energy at these loads"]) > 1e-8
    d, _ = face(body, polynomial(body).equilibrium(FORCE * body.interface("x_max").modes[1]))
    full = prestressed(model, frame="x_min", forces={"x_max": [0.0, FORCE, 0.0, 0.0, 0.0, 0.0]})
    moved = full.interface("x_max").p - model.interface("x_max").p
    np.testing.assert_allclose(d, moved, atol=2e-3 * moved[1])


@pytest.mark.parametrize("part", [0.5, 1.0])
def test_a_cantilever_bends_by_the_elastica(body, part):
    """By 30 % of its length with fifteen coordinates at most, within 0.5 % of it."""
    assert body.n_modes <= 15
    rows = body.interface("x_max").modes
    q = polynomial(body).equilibrium(part * FORCE * rows[1])
    d, gradient = face(body, q)
    x, y, angle = elastica(part)
    # of the block, Timoshenko's shear
    shear = part * FORCE * LENGTH / (5.0 / 6.0 * MODULUS / 2.0 * SIDE**2)
    assert d[1] == pytest.approx(y + shear, rel=1e-3)
    assert d[0] == pytest.approx(x - 1.0, rel=5e-3)
    rotation = Rotation.from_matrix(turned(gradient)).as_rotvec()
    np.testing.assert_allclose(rotation, [0.0, 0.0, angle], atol=2e-3 * angle)


def test_a_rigid_face_turns_without_strain(body):
    q = polynomial(body).equilibrium(FORCE * body.interface("x_max").modes[1])
    _, gradient = face(body, q)
    # 1 - cos 0.46 is 0.1
    np.testing.assert_allclose(turned(gradient).T @ gradient, np.eye(3), atol=1e-3)


def test_a_rigid_face_stays_rigid_however_many_shapes_there_are():
    """A thick block under a moment against its full model: shapes that strain the face must not make it softer."""
    mesh = meshes.block(0.1, SIDE, SIDE, divisions=(3, 1, 1), cell="hexahedron", comm=MPI.COMM_SELF)
    own = st_venant_kirchhoff.Parameters(E=MODULUS, nu=0.3, rho=1000.0)
    model = ContinuumModel(
        mesh, st_venant_kirchhoff, own, degree=2, interfaces=[Interface("x_min"), Interface("x_max")]
    )
    moment = MODULUS * SIDE**3 * 8e-3
    full = prestressed(model, frame="x_min", forces={"x_max": [0.0, 0.0, 0.0, 0.0, moment, 0.0]})
    loads = {"x_max.ry": moment, "x_max.x": 10.0 * moment, "fixed-interface 1": 1e-3}
    body = craig_bampton(model, modes=2, frame="x_min", nonlinear=ModalDerivatives(loads))
    q = np.zeros(body.n_modes)
    for _ in range(30):
        row = turned_face(face(body, q)[1], motion(body)[:, 1:])[1][1]
        q = polynomial(body).equilibrium(moment * row, start=q)
    F = face(body, q)[1]
    angle = Rotation.from_matrix(full.interface("x_max").R).as_rotvec()[1]
    assert angle > 0.2
    assert Rotation.from_matrix(turned(F)).as_rotvec()[1] == pytest.approx(angle, rel=1e-3)
    assert abs(F.T @ F - np.eye(3)).max() < 1e-4


def test_a_linear_reduction_locks(model, body):
    """The same load on the polynomial without derivatives: the face cannot turn, and the beam cannot shorten."""
    short = replace(ModalDerivatives({"x_max.y": FORCE}), most=1, tol=1e-3, order=2)
    with pytest.raises(ReductionError, match=r"with 1 modal derivatives the body locks .* of its strain energy"):
        craig_bampton(model, modes=0, frame="x_min", nonlinear=short)


def test_the_stress_is_that_of_the_bent_body(model, body):
    q = under_moments(body, {"x_max": 0.3 * FORCE * LENGTH})
    field = model.stress_field(body, q)
    assert field.max == pytest.approx(0.3 * FORCE * LENGTH * SIDE / 2.0 / (STIFFNESS / MODULUS), rel=0.02)
    small = beam(solid_linear)
    with pytest.raises(RecordError, match=r"stress of .*solid_linear is that of small displacements"):
        small.stress_field(body, q)


@pytest.mark.parametrize("coupling", Coupling)
@pytest.mark.parametrize(("frame", "signs"), [("x_min", {"x_max": 1.0}), (None, {"x_max": 1.0, "x_min": -1.0})])
def test_moments_at_the_ends_bend_a_circle(frame, signs, coupling):
    """By 0.8 rad, and the ends' faces turn without energy; ten quadratic cells are 9e-4 too stiff."""
    model, angle = beam(cells=10, coupling=coupling), 0.8
    moments = {name: sign * angle * STIFFNESS / LENGTH for name, sign in signs.items()}
    loads = {f"{name}.rz": abs(size) for name, size in moments.items()}
    body = craig_bampton(model, modes=0, frame=frame, nonlinear=ModalDerivatives(loads))
    q = under_moments(body, moments)
    first, last = (turned(face(body, q, name)[1]) for name in ("x_min", "x_max"))
    assert Rotation.from_matrix(first.T @ last).as_rotvec()[2] == pytest.approx(angle, rel=1e-3)
    assert polynomial(body).energy(q) == pytest.approx(0.5 * STIFFNESS / LENGTH * angle**2, rel=2e-3)


def test_small_loads_need_no_derivatives():
    body = craig_bampton(beam(cells=2), modes=2, frame="x_min", nonlinear=ModalDerivatives({"x_max.y": 1e-4}))
    assert body.n_modes == 8
    assert body.provenance["modal derivatives"] == "0"


@pytest.mark.mpi
@pytest.mark.parametrize("coupling", Coupling)
def test_ranks_make_the_same_body(coupling):
    comm, choice = MPI.COMM_WORLD, ModalDerivatives({"x_max.y": FORCE})
    bodies = [
        craig_bampton(beam(cells=6, coupling=coupling, comm=one), modes=2, frame="x_min", nonlinear=choice)
        for one in (comm, MPI.COMM_SELF)
    ]
    assert len(set(comm.allgather(bodies[0].fingerprint()))) == 1
    tips = []
    for body in bodies:
        q = polynomial(body).equilibrium(FORCE * body.interface("x_max").modes[1])
        tips.append(np.concatenate([part.ravel() for part in face(body, q)]))
    np.testing.assert_allclose(*tips, atol=1e-7)


def bad(frame="x_min", **options):
    return {"modes": 0, "frame": frame, "nonlinear": ModalDerivatives({"x_max.y": FORCE}), **options}


@pytest.mark.parametrize(("options", "message"), [
    (bad(nonlinear=1), r"nonlinear must be ModalDerivatives\(loads=...\), got 1"),
    (bad(nonlinear=ModalDerivatives({"tip.y": 1.0})), "names the load 'tip.y'; there are: .*x_max.y"),
    (bad(nonlinear=ModalDerivatives({"x_max.y": 1.0}, held=["tip"])), "no interface 'tip' to hold; there are: x_max"),
    (bad(keep=Keep(stress=True)), "stress modes are those of small displacements"),
])  # fmt: skip
def test_what_does_not_fit_is_refused(model, options, message):
    with pytest.raises(ReductionError, match=message):
        craig_bampton(model, **options)


@pytest.mark.parametrize(("options", "message"), [
    ({"loads": {}}, "takes loads by their names"),
    ({"loads": {"tip.y": -1.0}}, "'tip.y' needs a positive size, got -1.0"),
    ({"loads": {"tip.y": np.nan}}, "needs a positive size"),
    ({"loads": {"tip.y": 1.0}, "held": "tip"}, "held must be a list"),
    ({"loads": {"tip.y": 1.0}, "tol": 0.0}, "tol must lie between 0 and 1"),
    ({"loads": {"tip.y": 1.0}, "most": 0}, "most must be an integer from 1 on"),
    ({"loads": {"tip.y": 1.0}, "order": 1}, "order must be an integer from 2 on"),
])  # fmt: skip
def test_wrong_options(options, message):
    with pytest.raises(ReductionError, match=message):
        ModalDerivatives(**options)


def full_equilibrium(model, start, load, *, held):
    """Newton's method on the full model, some dofs at rest, from a displacement on: (dofs,)."""
    derivatives, u = force_derivatives(model), start.copy()
    free = np.setdiff1d(np.arange(len(u)), held)
    u[held] = 0.0
    for _ in range(30):
        tangent = gather(model.tangent(u)).tocsc()[free][:, free]
        step = scipy.sparse.linalg.spsolve(tangent, (load - derivatives.force(u))[free])
        u[free] += step
        if abs(step).max() < 1e-12:
            return u
    raise AssertionError("the full model has no equilibrium near the reduced body's")


def test_a_shallow_panel_snaps_through():
    """Clamped at both ends under its weight: the rise of 30 mm stands below the ends after it, as in the full model."""
    rise, thickness, size = 0.03, 0.01, 4e5
    mesh = meshes.block(1.0, 0.1, thickness, divisions=(16, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    x[:, 2] += 4.0 * rise * x[:, 0] * (1.0 - x[:, 0])
    material = st_venant_kirchhoff.Parameters(E=MODULUS, nu=0.0, rho=1000.0)
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, st_venant_kirchhoff, material, degree=2, interfaces=ends)
    weight = BodyForce("weight", [0.0, 0.0, -1.0])
    choice = ModalDerivatives({"load weight": size}, held=["x_max"], tol=1e-2)
    body = craig_bampton(model, modes=4, frame="x_min", loads=[weight], nonlinear=choice, keep=Keep(modes=True))
    assert body.n_modes <= 20
    fields, own = nodal_modes(body, model), polynomial(body)
    clamped = body.interface("x_max").modes
    clamped_dofs = np.concatenate([one.dofs for one in model.interfaces])
    free = scipy.linalg.null_space(clamped / abs(clamped).max(axis=1, keepdims=True))
    top = np.linalg.norm(model.node_x - [0.5, 0.05, rise + 0.5 * thickness], axis=1).argmin()
    middle, q, sunk = model.displacement_dofs[top, 2], np.zeros(body.n_modes), []
    for part in (0.5, 1.0):
        q = own.equilibrium(part * size * body.loads.modal[0], start=q, directions=free)
        full = full_equilibrium(model, fields @ q, part * size * load_vectors(model, [weight])[:, 0], held=clamped_dofs)
        assert (fields @ q)[middle] == pytest.approx(full[middle], rel=1e-2)
        sunk.append(-full[middle])
    assert sunk[0] < 0.15 * rise
    assert sunk[1] > 1.5 * rise


def frame_of_average(model, name, u):
    """(3,) displacement of the centroid of facets and (3, 3) the rotation nearest to their motion, by integrals."""
    mesh, at = model.mesh, fem.Function(model.space)
    at.x.array[:] = u
    ds = ufl.Measure("ds", domain=mesh.mesh, subdomain_data=mesh.facet_tags)(mesh.facet_groups[name])
    arm = ufl.SpatialCoordinate(mesh.mesh) - ufl.as_vector(model.interface(name).p)
    area = fem.assemble_scalar(fem.form(fem.Constant(mesh.mesh, 1.0) * ds))
    moments = [[fem.assemble_scalar(fem.form((arm + at)[a] * arm[b] * ds)) for b in range(3)] for a in range(3)]
    left, _, right = np.linalg.svd(np.array(moments))
    # of a plane face the third direction is open
    upright = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    return np.array([fem.assemble_scalar(fem.form(at[a] * ds)) for a in range(3)]) / area, left @ upright @ right


@pytest.mark.parametrize(("directions", "tol", "rel"), [((0.0, 1.0, 0.0), 1e-3, 2e-4), ((0.0, 0.5, 0.2), 5e-3, 1e-3)])
def test_an_averaged_interface_against_the_full_model(directions, tol, rel):
    """A dead force on the mean of a free face: its frame stands where that of the full model does, turned as that."""
    model = beam(cells=8, nu=0.3, coupling=Coupling.AVERAGED)
    force = FORCE * np.array(directions)
    askew = {"x_max.rz": 0.3 * FORCE, "x_max.z": 0.3 * FORCE} if force[2] != 0.0 else {}
    choice = ModalDerivatives({"x_max.y": FORCE, **askew}, tol=tol, most=40)
    body = craig_bampton(model, modes=0, frame="x_min", nonlinear=choice, keep=Keep(modes=True))
    q = polynomial(body).equilibrium(force @ body.interface("x_max").modes[:3])
    own = nodal_modes(body, model) @ q
    tip = model.interface("x_max")
    load = np.zeros(model.layout.n_local)
    load[tip.dofs] = tip.average[:, :3] @ force
    full = full_equilibrium(model, own, load, held=model.interface("x_min").dofs)
    d, R = frame_of_average(model, "x_max", full)
    mine, F = face(body, q)
    np.testing.assert_allclose(mine, d, atol=rel * np.linalg.norm(d))
    angle = np.linalg.norm(Rotation.from_matrix(R).as_rotvec())
    assert angle > 0.2
    assert np.linalg.norm(Rotation.from_matrix(R.T @ turned(F)).as_rotvec()) < rel * angle
    # and the frame is that of the reduced body's own field, to the third order
    _, R_own = frame_of_average(model, "x_max", own)
    assert np.linalg.norm(Rotation.from_matrix(R_own.T @ turned(F)).as_rotvec()) < 1e-4 * angle


def halved(*, half, height=SIDE):
    """A beam, or its half behind the plane z = 0."""
    size, lowest = (height / 2.0, -height / 4.0) if half else (height, 0.0)
    mesh = meshes.block(LENGTH, SIDE, size, divisions=(10, 1, 1 if half else 2), cell="hexahedron", comm=MPI.COMM_SELF)
    ends = [Interface("x_min", origin=[0.0, 0.0, lowest]), Interface("x_max", origin=[LENGTH, 0.0, lowest])]
    own = st_venant_kirchhoff.Parameters(E=MODULUS, nu=0.3, rho=1000.0)
    planes = [SymmetryPlane("z_min", (0, 0, 1))] if half else []
    return ContinuumModel(mesh, st_venant_kirchhoff, own, degree=2, interfaces=ends, supports=planes)


def test_a_half_bends_as_the_whole():
    tips = []
    for half, share in ((False, 1.0), (True, 0.5)):
        loads = {"x_max.y": share * FORCE, "x_max.rz": 0.3 * share * FORCE}
        choice = ModalDerivatives(loads, tol=1e-4)
        body = craig_bampton(halved(half=half), modes=0, frame="x_min", nonlinear=choice)
        d, F = face(body, polynomial(body).equilibrium(share * FORCE * body.interface("x_max").modes[1]))
        tips.append(np.append(d, Rotation.from_matrix(turned(F)).as_rotvec()))
    assert tips[0][1] > 0.29
    np.testing.assert_allclose(tips[1], tips[0], atol=2e-4 * tips[0][1])


@pytest.mark.parametrize("load", ["x_max.z", "x_max.rx"])
def test_a_load_that_a_plane_of_symmetry_takes_up_is_refused(load):
    with pytest.raises(ReductionError, match=rf"'{load}', which the supports of the part take up"):
        craig_bampton(halved(half=True), modes=0, frame="x_min", nonlinear=ModalDerivatives({load: 1.0}))


def bedded(z, *, group="z_min"):
    """A short block on a roller, its far face's origin at a height above its middle."""
    mesh = meshes.block(0.1, SIDE, SIDE, divisions=(3, 1, 1), cell="hexahedron", comm=MPI.COMM_SELF)
    own = st_venant_kirchhoff.Parameters(E=MODULUS, nu=0.3, rho=1000.0)
    ends, rollers = [Interface("x_min"), Interface("x_max", origin=[0.1, 0.0, z])], [Roller(group, (0, 0, 1))]
    return ContinuumModel(mesh, st_venant_kirchhoff, own, degree=2, interfaces=ends, supports=rollers)


def test_a_face_turns_about_the_edge_that_a_roller_holds():
    """The edge stays on the roller, wherever the frame's origin is."""
    moment, edge = MODULUS * SIDE**3 * 2e-3, -SIDE / 2.0
    turns = []
    for z in (edge, 0.0, 0.03):
        choice = ModalDerivatives({"x_max.ry": moment}, tol=2e-2)
        body, q = craig_bampton(bedded(z), modes=0, frame="x_min", nonlinear=choice), None
        assert body.provenance["modal derivatives"] != "0"
        for _ in range(20):
            at = np.zeros(body.n_modes) if q is None else q
            row = turned_face(face(body, at)[1], motion(body)[:, 1:])[1][1]
            q = polynomial(body).equilibrium(moment * row, start=at)
        d, F = face(body, q)
        assert abs((d + (F - np.eye(3)) @ [0.0, 0.0, edge - z])[2]) < 1e-12
        turns.append(Rotation.from_matrix(turned(F)).as_rotvec()[1])
    np.testing.assert_allclose(turns[1:], turns[0], rtol=5e-3)
    assert turns[0] > 1e-2


def test_a_face_that_its_roller_lets_turn_by_small_angles_only_is_refused():
    with pytest.raises(ReductionError, match=r"'x_max' is rigid, and its nodes on roller .* by small angles only"):
        craig_bampton(
            bedded(0.0, group="x_max"), modes=0, frame="x_min", nonlinear=ModalDerivatives({"x_max.y": 1.0})
        )


def founded(*, hardening):
    """A beam whose lower side stands on springs, of a force that grows with the cube of their stretch too."""
    springs = types.ModuleType("bed")
    own = {name: entry for name, entry in vars(solid_linear).items() if not name.startswith("__")}

    def surface_energy(u, p):
        return [(p.rho * ufl.inner(u, u) / 2 + p.E * ufl.inner(u, u) ** 2 / 4, solid_linear.Quadrature(8))]

    vars(springs).update(own, surface_energy=surface_energy)
    mesh = meshes.block(LENGTH, SIDE, SIDE, divisions=(8, 1, 1), cell="hexahedron", comm=MPI.COMM_SELF)
    steel = st_venant_kirchhoff.Parameters(E=MODULUS, nu=0.0, rho=1000.0)
    # the bed's E and rho are its stiffnesses
    bed = solid_linear.Parameters(E=hardening, nu=0.0, rho=3.0 * STIFFNESS / LENGTH**4 / SIDE)
    ends = [Interface("x_min"), Interface("x_max", coupling=Coupling.AVERAGED)]
    surfaces = {"y_min": (springs, bed)}
    return ContinuumModel(mesh, st_venant_kirchhoff, steel, degree=2, interfaces=ends, surfaces=surfaces)


@pytest.mark.parametrize("hardening", [1e-6, 2e6])
def test_springs_on_facets_against_the_full_model(hardening):
    model = founded(hardening=hardening)
    choice = ModalDerivatives({"x_max.y": FORCE})
    body = craig_bampton(model, modes=2, frame="x_min", nonlinear=choice, keep=Keep(modes=True))
    own, tip = polynomial(body), model.interface("x_max")
    q = own.equilibrium(FORCE * body.interface("x_max").modes[1])
    load = np.zeros(model.layout.n_local)
    load[tip.dofs] = tip.average[:, 1] * FORCE
    start = nodal_modes(body, model) @ q
    full = full_equilibrium(model, start, load, held=model.interface("x_min").dofs)
    d, _ = frame_of_average(model, "x_max", full)
    assert d[1] < 0.27
    np.testing.assert_allclose(face(body, q)[0], d, atol=1e-3 * d[1])
    # where no more than the fourth degree is there, the work of the forces is the form's own
    step = np.random.default_rng(7).normal(size=body.n_modes) / np.sqrt(body.stiffness)
    forces = force_derivatives(model).force(start)
    assert own.force(q) @ step == pytest.approx(forces @ nodal_modes(body, model) @ step, rel=1e-9)
