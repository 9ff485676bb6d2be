"""Plane strain and plane stress of solids' forms: closed forms, thin solids, and motion in a plane."""

from functools import cache

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import brentq

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import (
    BulkViscosity,
    ContinuumModel,
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    PressureOnFacets,
    RigidPlane,
    clamped_dofs,
    equilibrium_path,
    follow,
    plane_form,
    prescribed_dofs,
)
from flexmbd.errors import FlexmbdError, FormulationError, InterfaceError, MeshError, SceneError
from flexmbd.forms import hencky_plasticity, neo_hookean, plate_mitc, updated_lagrangian
from flexmbd.forms import j2_plasticity as j2
from flexmbd.forms import st_venant_kirchhoff as svk

E, NU, RHO, T = 2e11, 0.3, 7800.0, 0.01
RUBBER = svk.Parameters(E=2e7, nu=NU, rho=1000.0)
STANDING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # the plane x z; its normal is -y


def steel(**more):
    return j2.Parameters(E=E, nu=NU, rho=RHO, yield_stress=2.4e8, **more)


@cache
def plane(form, *, strain=False):
    return plane_form(form, plane_strain=strain)


def strip(form, parameters, *, strain=False, divisions=(3, 2), degree=1, cell="quadrilateral", ends=(), comm=None):
    mesh = meshes.sheet(1.0, 0.2, divisions=divisions, cell=cell, comm=comm or MPI.COMM_SELF)
    made = plane(form, strain=strain)
    interfaces = [Interface(name) for name in ends]
    return NonlinearModel(mesh, made, made.Parameters(parameters, T), degree=degree, interfaces=interfaces)


def pulled(body, strains):
    """The mean stresses, Pa, at strains of a strip that is free to become narrower."""
    held = prescribed_dofs(body, {"x_min": "x", "x_max": "x"})
    corner = np.argmin(np.hypot(body.layout.node_x[:, 0], body.layout.node_x[:, 1] + 0.1))
    held = np.append(held, 3 * corner + 1).astype(np.int32)
    moves = (held % 3 == 0) & (body.layout.node_x[held // 3, 0] > 0.5)
    path = follow(body, strains, prescribed=held, displacement=lambda strain: strain * moves)
    return [step.reactions[moves].sum() / (0.2 * T) for step in path.steps]


LAWS = {"linear": j2.LinearHardening(2e9), "Voce": j2.VoceHardening(1e8, 100.0)}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_strip_in_plane_stress_yields_as_a_bar(law):
    p = steel(hardening=law)
    body = strip(j2, p)
    found = pulled(body, [1e-3, 5e-3])

    def flow(strain):  # the stress at which the plastic strain is what the elastic one leaves
        return brentq(lambda s: p.yield_stress + law_growth(law, strain - s / E) - s, 0.0, 1e9, xtol=1e-3)

    np.testing.assert_allclose(found, [1e-3 * E, flow(5e-3)], rtol=1e-9)
    # volume changes by the elastic strain alone
    thickness = body.history()[0][:, -1]
    elastic = found[1] / E
    np.testing.assert_allclose(thickness, -NU * elastic - 0.5 * (5e-3 - elastic), rtol=1e-7)
    stress = body.stress()[0]
    assert abs(stress[..., 2, 2]).max() < 1e-9 * abs(stress).max()


def law_growth(law, strain):
    if isinstance(law, j2.LinearHardening):
        return law.modulus * strain
    return 1e8 * (1 - np.exp(-100.0 * strain))


def test_a_strip_in_plane_strain_is_stiffer():
    (stress,) = pulled(strip(j2, steel(), strain=True), [1e-3])
    np.testing.assert_allclose(stress, 1e-3 * E / (1 - NU**2), rtol=1e-9)


def test_rubber_stretched_far_becomes_thin():
    """Nearly incompressible, to twice its length: the nominal stress mu (l - 1 / l^2), the thickness 1 / sqrt(l)."""
    mu, kappa = 1e6, 5e9
    nu = (3 * kappa - 2 * mu) / (6 * kappa + 2 * mu)
    body = strip(neo_hookean, neo_hookean.Parameters(2 * mu * (1 + nu), nu, 1000.0))
    stresses = pulled(body, [0.25, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(stresses, [mu * (s - s**-2) for s in (1.25, 1.5, 1.75, 2.0)], rtol=2e-3)
    np.testing.assert_allclose(body.history()[0][:, 0], 2**-0.5 - 1, rtol=2e-3)


def test_the_tangent_is_the_derivative_of_the_forces():
    body = strip(j2, steel(hardening=LAWS["Voce"]), cell="triangle")
    u = np.zeros(body.layout.n_local)
    x = body.layout.node_x
    u.reshape(-1, 3)[:, :2] = 4e-3 * np.column_stack([x[:, 0] + x[:, 1] ** 2, x[:, 0] * x[:, 1]])
    along = np.sin(1.0 + np.arange(len(u)))
    along.reshape(-1, 3)[:, 2] = 0.0
    matrix = body.tangent(u)
    right, left = matrix.createVecs()
    right.array[:] = along
    matrix.mult(right, left)
    h = 1e-8
    difference = (body.force(u + h * along) - body.force(u - h * along)) / (2 * h)
    inside = np.arange(len(u)) % 3 < 2
    assert abs(left.array - difference)[inside].max() < 1e-6 * abs(difference).max()


def swung(body, *, explicit, R=None, end=0.3):
    """Where a pendulum's end is, in the axes that R turns, and the sum of the body's energies (J) over time."""
    parts = {name: fm.RigidBody(0.3, (1e-3, 1e-3, 1e-3)) for name in ("x_min", "x_max")}
    interior = (ExplicitContinuum if explicit else ImplicitContinuum)(body, rigid_parts=parts)
    R = np.eye(3) if R is None else R
    scene = fm.System(gravity=R @ (0.0, -9.81, 0.0), team=MpiTeam(body.comm))
    rod = scene.add(fm.ContinuumBody(interior), name="rod")
    scene.connect(fm.joint.Revolute(axis="z"), scene.ground.frame(R=R), rod.frame("x_min"))
    how = {"integrator": fm.CentralDifference()}
    if not explicit:
        how = {"integrator": fm.GeneralizedAlpha(rho=0.9), "h": 5e-3}
    run = scene.simulate(end, **how)
    energy = run.energy()
    total = sum(run.energies(rod).values()) + energy.total
    return run.position(rod.frame("x_max"))[-1] @ R, total, run.energies(rod)


ENDS = ("x_min", "x_max")


@pytest.mark.parametrize("explicit", [False, True], ids=["implicit", "explicit"])
def test_a_pendulum_swings_as_a_thin_solid_in_any_plane(explicit):
    degree, divisions = (1, (10, 2)) if explicit else (2, (5, 1))
    sheet, turned = (
        swung(strip(svk, RUBBER, degree=degree, divisions=divisions, ends=ENDS), explicit=explicit, R=R)
        for R in (None, STANDING)
    )
    mesh = meshes.block(1.0, 0.2, T, divisions=(*divisions, 1), comm=MPI.COMM_SELF)
    interfaces = [Interface(name) for name in ENDS]
    solid = swung(NonlinearModel(mesh, svk, RUBBER, degree=degree, interfaces=interfaces), explicit=explicit)
    np.testing.assert_allclose(turned[0], sheet[0], atol=1e-9)
    assert abs(sheet[0][2]) == 0.0
    # it bends; a solid's clamped ends are a little stiffer
    assert np.linalg.norm(sheet[0] - solid[0]) < 1e-4
    assert sheet[2]["elastic"].max() > 1e-3
    np.testing.assert_allclose(sheet[1], sheet[1][0], atol=2e-3 * np.ptp(sheet[2]["gravitational"]))


def test_frequencies_are_those_of_a_beam():
    """A slender cantilever in its plane; out of it there are none."""
    made, p = plane(svk), svk.Parameters(RUBBER.E, 0.0, RUBBER.rho)  # the clamp does not hinder the width
    mesh = meshes.sheet(1.0, 0.02, divisions=(20, 1), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, made, made.Parameters(p, T), degree=2, interfaces=[Interface("x_min")])
    scene = fm.System()
    interior = ImplicitContinuum(body, rigid_parts={"x_min": fm.RigidBody(1.0, (1.0, 1.0, 1.0))})
    rod = scene.add(fm.ContinuumBody(interior), name="rod")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), rod.frame("x_min"))
    found = scene.linearize().frequencies()[:2]
    speed = np.sqrt(RUBBER.E * 0.02**2 / (12 * RUBBER.rho))
    exact = np.array([1.8751041, 4.6940911]) ** 2 * speed / (2 * np.pi)
    assert (abs(found / exact - 1.0) < [3e-4, 2e-3]).all()  # rotary inertia and shear


@pytest.mark.parametrize("viscosity", [None, BulkViscosity()], ids=["plain", "viscous"])
def test_a_plate_in_plane_strain_is_hit_as_one_layer_of_bricks_between_walls(viscosity):
    """Finite strains and a wall; the size of cells that bulk viscosity takes is another one of flat cells."""
    p = hencky_plasticity.Parameters(E, NU, RHO, 3e8, hardening=j2.LinearHardening(1e9))
    wall = RigidPlane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), penalty=None)  # which would be by the stable step
    made = plane(hencky_plasticity, strain=True)
    sheet = NonlinearModel(
        meshes.sheet(0.1, 0.05, divisions=(6, 3), comm=MPI.COMM_SELF), made, made.Parameters(p, 0.02), degree=1
    )
    block = meshes.block(0.1, 0.05, 0.02, divisions=(6, 3, 1), comm=MPI.COMM_SELF)
    solid = NonlinearModel(block, hencky_plasticity, p, degree=1)
    found = []
    for body, supports in ((sheet, []), (solid, [("z_min", "z"), ("z_max", "z")])):
        held = [fm.continuum.Support(name, **{axis: True}) for name, axis in supports]
        run = ExplicitRun(
            body, velocity=(-150.0, 0.0, 0.0), planes=[wall], supports=held, bulk_viscosity=viscosity
        )
        account = run.simulate(4e-5, h=4e-7, outputs=1)
        assert account.error < 1e-2
        x = run.motion.x
        rows = np.lexsort(np.round(body.layout.node_x[: len(x), :2].T, 9))
        found.append((x[rows], account["plastic"][-1]))
    (flat, work), (thick, other) = found
    assert work > 10.0
    np.testing.assert_allclose(work, other, rtol=2e-2 if viscosity else 1e-9)
    np.testing.assert_allclose(flat[:, 0], thick[::2, 0], atol=5e-5 if viscosity else 1e-10)


@pytest.mark.mpi
@pytest.mark.parametrize("explicit", [False, True], ids=["implicit", "explicit"])
def test_all_ranks_together_do_what_one_does(explicit):
    degree, divisions = (1, (8, 2)) if explicit else (2, (4, 1))
    one, every = (
        swung(strip(svk, RUBBER, degree=degree, divisions=divisions, ends=ENDS, comm=comm), explicit=explicit, end=0.05)
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    np.testing.assert_allclose(every[0], one[0], rtol=1e-9, atol=1e-12)


def test_a_frame_that_leaves_the_plane_is_refused():
    body = strip(svk, RUBBER, ends=ENDS)
    parts = {name: fm.RigidBody(0.3, (1e-3, 1e-3, 1e-3)) for name in ENDS}
    for kind, integrator in ((ImplicitContinuum, fm.GeneralizedAlpha()), (ExplicitContinuum, fm.CentralDifference())):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))  # along the normal
        rod = scene.add(fm.ContinuumBody(kind(body, rigid_parts=parts)), name="rod")
        scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), rod.frame("x_min"))
        with pytest.raises(FlexmbdError, match=r"'x_(min|max)' leaves the plane of its plane body"):
            scene.simulate(0.1, integrator=integrator)
        hinge = fm.System()
        rod = hinge.add(fm.ContinuumBody(kind(body, rigid_parts=parts)), name="rod")
        hinge.connect(fm.joint.Revolute(axis="y"), hinge.ground.frame(), rod.frame("x_min")).velocity = 1.0
        with pytest.raises(SceneError, match="begins to move out of the plane"):
            hinge.simulate(0.1, integrator=integrator)


def test_what_cannot_be_plane_is_refused():
    with pytest.raises(FormulationError, match=r"lagrangian refers to the updated.*plane_strain=True"):
        plane_form(updated_lagrangian, plane_strain=False)
    with pytest.raises(FormulationError, match="plate_mitc has no cells of a solid"):
        plane_form(plate_mitc, plane_strain=True)
    with pytest.raises(FormulationError, match="solid_mixed has unknowns besides the displacement"):
        plane_form(forms.solid_mixed, plane_strain=True)
    with pytest.raises(FormulationError, match="plane_strain"):
        plane_form(svk, plane_strain="yes")  # type: ignore[arg-type]
    made = plane(svk)
    for t in (0.0, -1.0, float("nan"), "1", True):
        with pytest.raises(ValueError, match="thickness t"):
            made.Parameters(RUBBER, t)
    with pytest.raises(ValueError, match=r"the Parameters of .*st_venant_kirchhoff"):
        made.Parameters(steel(), T)
    tube = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    with pytest.raises(FormulationError, match="has no hexahedron"):
        NonlinearModel(tube, made, made.Parameters(RUBBER, T), degree=1)
    mesh = meshes.sheet(1.0, 0.2, divisions=(2, 2), comm=MPI.COMM_SELF)
    mesh.mesh.geometry.x[:, 2] += 0.1 * mesh.mesh.geometry.x[:, 0]
    with pytest.raises(FormulationError, match="the mesh lies in no plane along two axes"):
        NonlinearModel(mesh, made, made.Parameters(RUBBER, T), degree=1)
    with pytest.raises(InterfaceError, match="needs two that are apart"):
        strip(svk, RUBBER, ends=("x_min y_min",))
    sheet, made = meshes.sheet(1.0, 0.2, divisions=(2, 2), comm=MPI.COMM_SELF), plane(svk, strain=True)
    with pytest.raises(FormulationError, match=r"plane_strain.* moves in its plane alone.*NonlinearModel"):
        ContinuumModel(sheet, made, made.Parameters(RUBBER, T), degree=1, interfaces=[Interface("x_min")])
    body = strip(svk, RUBBER)
    held = clamped_dofs(body, ["x_min", "x_max"])
    across = np.isin(held, body.held_dofs) & (body.layout.node_x[held // 3, 0] > 0.5)
    with pytest.raises(FormulationError, match="moves nodes out of the plane of the body at 1"):
        follow(body, [1.0], prescribed=held, displacement=lambda t: 0.1 * t * across)
    # what a rotation of the plane rounds is none of it
    pulled = np.where(across, 1e-19, 1e-2 * (held % 3 == 0) * (body.layout.node_x[held // 3, 0] > 0.5))
    follow(body, [1.0], prescribed=held, displacement=lambda t: t * pulled)
    assert not body.displacement[body.held_dofs].any()


def test_made_twice_it_takes_the_same_parameters():
    mesh = meshes.sheet(1.0, 0.2, divisions=(1, 1), comm=MPI.COMM_SELF)
    p = plane_form(svk, plane_strain=True).Parameters(RUBBER, T)
    NonlinearModel(mesh, plane_form(svk, plane_strain=True), p, degree=1)


def test_forms_with_rotations_are_told_what_there_is():
    mesh = meshes.sheet(1.0, 0.2, divisions=(2, 1), comm=MPI.COMM_SELF)
    p = forms.plane_stress.Parameters(E=1e4, nu=0.25, rho=5.0, t=1.0)
    body = NonlinearModel(mesh, forms.plane_stress, p, degree=2, interfaces=[Interface("x_min")])
    with pytest.raises(FormulationError, match=r"Implicit.*condensed_rot.*follow\).*craig_bampton.*plane_form"):
        ExplicitContinuum(body)


@pytest.mark.parametrize("interior", [ExplicitContinuum, ImplicitContinuum])
def test_a_ball_beside_the_plane_pushes_the_body_in_it_alone(interior):
    """The part of the push out of the plane is the guide's; the ball feels the whole, and energy is kept."""
    body = strip(svk, RUBBER, strain=True, divisions=(20, 4), ends=("x_min",))
    scene = fm.System(gravity=(0.0, 0.0, 0.0))
    part = {"x_min": fm.RigidBody(0.1, (1e-4, 1e-4, 1e-4))}
    sheet = scene.add(fm.ContinuumBody(interior(body, rigid_parts=part)), name="sheet")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), sheet.frame("x_min"))
    ball = scene.add(fm.RigidBody(0.05, (1e-5, 1e-5, 1e-5)), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(p=(0.9, 0.12, 0.008)), ball.frame())
    free.velocity = (0.0, -2.0, 0.0, 0.0, 0.0, 0.0)
    scene.touch(fm.contact.Nodes(sheet, "y_max", name="hit"), fm.contact.Sphere(ball.frame(), 0.021), fm.contact.Hard())
    explicit = interior is ExplicitContinuum
    run = scene.simulate(0.003, integrator=fm.CentralDifference() if explicit else fm.GeneralizedAlpha())
    x = body.displacement.reshape(-1, 3)
    assert not x[:, 2].any()
    assert abs(x[:, 1]).max() > 1e-4
    push = run.outer_forces(sheet)["hit"]
    assert push[:, 2].min() < 0.3 * push[:, 1].min() < 0.0
    total = run.energy().total + sum(run.energies(sheet).values())
    assert abs(total - 0.1).max() < 0.02 * 0.1  # in halves of a step, while they touch


def test_a_column_in_plane_strain_buckles_as_one_layer_of_bricks():
    """Held across, these are the same equations; a push out of the plane is the guide's."""

    def buckling(mesh, form, parameters, push):
        body = NonlinearModel(mesh, form, parameters, degree=1)
        held = clamped_dofs(body, ["x_min"])
        if mesh.dim == 3:
            across = body.displacement_dofs[: body.layout.n_owned_nodes, 2]
            held = np.union1d(held, across).astype(np.int32)
        x, dofs = body.layout.node_x, body.displacement_dofs
        end = dofs[x[:, 0] > 0.999]
        force = np.zeros(body.n_owned)
        force[end] = np.asarray(push) / len(end)
        path = equilibrium_path(body, fm.Continuation(to=1.0), prescribed=held, load=lambda factor: factor * force)
        assert not body.displacement[dofs[:, 2]].any()
        return [one.t for one in path.critical], body

    flat = plane(svk, strain=True)
    sheet = meshes.sheet(1.0, 0.1, divisions=(10, 2), comm=MPI.COMM_SELF)
    bricks = meshes.block(1.0, 0.1, T, divisions=(10, 2, 1), comm=MPI.COMM_SELF)
    euler = np.pi**2 / 4 * RUBBER.E / (1 - RUBBER.nu**2) * T * 0.1**3 / 12
    push = (-3.0 * euler, 0.0, 0.0)
    (exact,), _ = buckling(bricks, svk, RUBBER, push)
    (found,), _ = buckling(sheet, flat, flat.Parameters(RUBBER, T), push)
    (beside,), _ = buckling(sheet, flat, flat.Parameters(RUBBER, T), (*push[:2], euler))
    np.testing.assert_allclose([found, beside], exact, rtol=1e-6)
    assert 0.3 < exact < 0.6


def test_a_load_on_edges_is_refused():
    body = strip(svk, RUBBER)
    with pytest.raises(MeshError, match=r"facets of the mesh are edges.*ForceAtNodes"):
        follow(body, [1.0], prescribed=clamped_dofs(body, ["x_min"]), loads=[PressureOnFacets("x_max", 1.0)])


def test_edges_of_plane_bodies_are_touched_by_no_nodes():
    scene = fm.System(gravity=(0.0, 0.0, 0.0))
    part = {"x_min": fm.RigidBody(0.1, (1e-4, 1e-4, 1e-4))}
    sheets = []
    for name in ("low", "high"):
        body = strip(svk, RUBBER, ends=("x_min",))
        sheets.append(scene.add(fm.ContinuumBody(ExplicitContinuum(body, rigid_parts=part)), name=name))
        place = scene.ground.frame(p=(0.0, 0.3 * len(sheets), 0.0))
        scene.connect(fm.joint.Fixed(), place, sheets[-1].frame("x_min"))
    low, high = sheets
    scene.touch(fm.contact.Nodes(high, "y_min"), fm.contact.SurfaceFacets(low, "y_max"), fm.contact.Hard())
    with pytest.raises(SceneError, match="'y_max' is of edges of a plane body"):
        scene.simulate(1e-4, integrator=fm.CentralDifference())
