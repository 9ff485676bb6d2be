"""The spatial beam against closed forms: frequencies, arches, columns, large rotation, its inertia."""

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import ufl
from dof_keys import everywhere, keys, matrix
from dolfinx import fem
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.finite_elements.assembly import integral
from flexmbd.continuum.finite_elements.gram_matrix import gram_matrix
from flexmbd.continuum.finite_elements.recovery import nodal_modes
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.errors import FormulationError, RecordError, ReductionError
from flexmbd.forms import beam_timoshenko as beam
from flexmbd.reduction import Keep, craig_bampton

PLATE = beam.Parameters.rectangle(7e10, 0.33, 2700.0, width=0.03, height=0.01, orientation=(0.2, 1.0, 0.5))
# with rotary inertia and shear that matter
STOUT = beam.Parameters.rectangle(1e9, 0.3, 7850.0, width=0.4, height=0.4, orientation=(0.0, 1.0, 0.0))


def along(curve, *, divisions, degree, ends=(0.0, 1.0), comm=MPI.COMM_WORLD):
    """A line mesh whose nodes lie on a curve from parameters in (n,) to points (n, 3)."""
    s = np.linspace(*ends, degree * divisions + 1)
    start, end = curve(np.array(ends))
    cells = np.arange(divisions)[:, None] * degree + np.array([0, degree, 1][: degree + 1])
    groups = {
        "start": lambda x: np.linalg.norm(x.T - start, axis=1) < 1e-9,
        "end": lambda x: np.linalg.norm(x.T - end, axis=1) < 1e-9,
    }
    return from_arrays(comm, curve(s), cells, cell="interval", degree=degree, facet_groups=groups)


def arch(a):
    return np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)


def helix(a):
    return np.stack([np.cos(3 * a), np.sin(3 * a), 0.4 * a], axis=1)


def helix_slope(a):
    return np.stack([-3 * np.sin(3 * a), 3 * np.cos(3 * a), 0.4 + 0 * a], axis=1)


def model(mesh, p, degree=2, interfaces=()):
    return ContinuumModel(mesh, beam, p, degree=degree, interfaces=[Interface(name) for name in interfaces])


def line(length, divisions, comm=MPI.COMM_SELF):
    return meshes.line(length, divisions=divisions, comm=comm)


def at(body, place, components=range(6)):
    """Rows of the body's dofs at a place, in the order of `everywhere`, by component."""
    every = everywhere(body, keys(body))
    there = np.linalg.norm(every[:, 1:4] - place, axis=1) < 1e-9
    return np.array([np.flatnonzero(there & (every[:, 4] == c)).item() for c in components])


def angular_frequencies(body, fixed, count=200, shift=0.0):
    """The lowest ones; a shift, of squares, for a body that can move."""
    free = np.setdiff1d(np.arange(len(everywhere(body, keys(body)))), fixed)
    k, m = (matrix(body, which)[np.ix_(free, free)] for which in (body.K, body.M))
    k = k + shift * m
    d = 1 / np.sqrt(np.diag(k))
    # mass by stiffness: the lowest come out to the last digits
    values = scipy.linalg.eigh(d[:, None] * m * d, d[:, None] * k * d, eigvals_only=True)
    return np.sqrt(np.maximum(1 / values[::-1][:count] - shift, 0.0))


def test_simply_supported_beam_has_timoshenkos_frequencies():
    """Bending in both planes, first and second branch, torsion and stretch, by closed forms."""
    p, length = STOUT, 2.0
    by_cells = {}
    for cells in (20, 40):
        body = model(line(length, cells), p)
        ends = [at(body, (0, 0, 0), (0, 1, 2, 3)), at(body, (length, 0, 0), (1, 2))]
        by_cells[cells] = angular_frequencies(body, np.concatenate(ends))
    shear = p.E / (2 * (1 + p.nu)) * p.ky
    bending = []
    for n in range(1, 7):
        k = n * np.pi / length
        i = p.Iy / p.A
        bending += list(
            np.sqrt(
                np.roots(
                    [p.rho**2 * p.Iy / shear, -p.rho * p.A * (1 + i * k**2 * (1 + p.E / shear)), p.E * p.Iy * k**4]
                )
            )
        )
    # the values printed in the literature for this beam
    assert sorted(bending)[:3] == pytest.approx([95.63398088, 332.23451364, 635.69628837], rel=1e-9)
    polar, half = p.Iy + p.Iz, np.pi * (np.arange(6) + 0.5) / length
    twist = half * np.sqrt(p.E / (2 * (1 + p.nu)) * p.J / (p.rho * polar))
    stretch = half * np.sqrt(p.E / p.rho)
    assert 2 * twist[0] == pytest.approx(319.34980860, rel=1e-4)
    assert stretch[0] == pytest.approx(280.3206251329, rel=1e-9)
    # the section swings in shear alone, where the axis stays
    thickness = np.sqrt(shear * p.A / (p.rho * p.Iy))
    exact = np.sort([*bending, *bending, thickness, thickness, *twist, *stretch])
    exact = exact[exact < 1500]
    errors = {cells: found[: len(exact)] / exact - 1 for cells, found in by_cells.items()}
    assert abs(errors[40]).max() < 3e-5
    # order four, from above
    assert (errors[40] > 0).all()
    assert errors[20] / errors[40] == pytest.approx(16, rel=0.05)


@pytest.mark.parametrize("degree", [1, 2])
def test_a_thin_beam_does_not_lock(degree):
    """Tip deflection of a cantilever a thousand times as long as thick, in four cells."""
    p = beam.Parameters.rectangle(7e10, 0.3, 2700.0, width=1e-3, height=1e-3, orientation=(0, 1, 0))
    body = model(line(1.0, 4), p, degree)
    k, tip = matrix(body, body.K), at(body, (1, 0, 0))
    free = np.setdiff1d(np.arange(len(k)), at(body, (0, 0, 0)))
    load = np.zeros(len(k))
    load[tip[2]] = 1.0
    found = np.linalg.solve(k[np.ix_(free, free)], load[free])[np.searchsorted(free, tip[2])]
    exact = 1 / (3 * p.E * p.Iy)
    # linear cells are exact but for (h / L)^2 / 4, quadratic ones in their nodes
    assert found == pytest.approx(exact * (1 - (1 / 64 if degree == 1 else 0)), rel=1e-5)


def test_quarter_arch_in_and_out_of_its_plane():
    """Deflection under a force at the tip, by Castigliano's theorem with stretch, shear and twist."""
    p = beam.Parameters.rectangle(7e10, 0.33, 2700.0, width=0.06, height=0.04, orientation=(0, 0, 1.0))
    body = model(along(arch, divisions=16, degree=2, ends=(0, np.pi / 2), comm=MPI.COMM_SELF), p)
    k, tip = matrix(body, body.K), at(body, (0, 1, 0))
    free = np.setdiff1d(np.arange(len(k)), at(body, (1, 0, 0)))
    flexibility = np.linalg.inv(k[np.ix_(free, free)])
    found = flexibility.diagonal()[np.searchsorted(free, tip[1:3])]
    g = p.E / (2 * (1 + p.nu))
    quarter = np.pi / 4
    in_plane = quarter * (1 / (p.E * p.Iy) + 1 / (p.E * p.A) + 1 / (g * p.A * p.kz))
    out_of_plane = quarter / (p.E * p.Iz) + (3 * quarter - 2) / (g * p.J) + 2 * quarter / (g * p.A * p.ky)
    assert found == pytest.approx([in_plane, out_of_plane], rel=2e-6)


SOFT = beam.Parameters.rectangle(2e9, 0.3, 1000.0, width=0.05, height=0.02, orientation=(0, 1, 0))


def column():
    """Euler's load of a cantilever of SOFT, and the stiffness of shear in the direction it gives way."""
    return np.pi**2 * SOFT.E * SOFT.Iy / 4, SOFT.kz * SOFT.A * SOFT.E / (2 * (1 + SOFT.nu))


def test_tangent_of_a_compressed_column_is_singular_at_its_critical_load():
    """With shear and the shortening before it: P (1 + P / (k G A) - P / (E A)) = P_E (Reissner 1972)."""
    body = model(line(1.0, 32), SOFT)
    free = np.setdiff1d(np.arange(body.n_owned), at(body, (0, 0, 0)))
    along_x, stretching = at_all(body, 0), SOFT.E * SOFT.A
    euler, shear = column()
    softer = 1 / shear - 1 / stretching
    exact = (np.sqrt(1 + 4 * euler * softer) - 1) / (2 * softer)
    for load, negative in ((exact * (1 - 2e-6), 0), (exact * (1 + 2e-6), 1)):
        u = np.zeros(body.n_owned)
        u[along_x] = -load / stretching * everywhere(body, keys(body))[along_x, 1]
        tangent = body.tangent(u[np.argsort(order(body))])
        values = scipy.linalg.eigvalsh(matrix(body, tangent)[np.ix_(free, free)])
        tangent.destroy()
        assert np.count_nonzero(values < 0) == negative


def at_all(body, component):
    """Rows of one component of the displacement, in the order of `everywhere`."""
    every = everywhere(body, keys(body))
    return np.flatnonzero((every[:, 4] == component) & (every[:, 0] == 0))


def test_geometric_stiffness_buckles_the_column():
    """Linear in the load: Haringx' P (1 + P / (k G A)) = P_E, by the record of a reduced beam."""
    body = craig_bampton(model(line(1.0, 16), SOFT, interfaces=("start", "end")), modes=40, frame="start")
    of_load = body.geometric.K[body.geometric.loads.index("end.x")]
    euler, shear = column()
    exact = shear / 2 * (np.sqrt(1 + 4 * euler / shear) - 1)
    values = scipy.linalg.eigh(of_load, np.diag(body.stiffness), eigvals_only=True)
    assert 1 / values[-1] == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize(("speed", "frequency"), [(1, 3.6816), (5, 6.4495), (10, 11.2023)])
def test_a_spinning_beam_stiffens(slender, speed, frequency):
    """Flapping of a cantilever at its axis of rotation, by E I / (rho A L^4) (Wright & others 1982)."""
    body = craig_bampton(slender, modes=12, frame="start")
    # bends along y: spins about z with it in the plane, about y with it normal to the plane
    of_spin = body.geometric.K[body.geometric.loads.index("angular velocity yy")]
    squared = np.linalg.eigvalsh(np.diag(body.stiffness) + (speed * 1e-3) ** 2 * of_spin)
    assert np.sqrt(squared[0]) * 1e3 == pytest.approx(frequency, rel=1e-4)


def order(body):
    """Own dofs of a body of one rank in the order of `everywhere`."""
    return everywhere(body, np.arange(body.n_owned))


def test_moment_bends_a_cantilever_to_a_quarter_of_a_circle():
    """Newton's method with the model's own tangent, the rotation of the tip prescribed."""
    p = SOFT
    body = model(line(1.0, 24), p)
    own = order(body)
    fixed = own[np.concatenate([at(body, (0, 0, 0)), at(body, (1, 0, 0), (4,))])]
    free = np.setdiff1d(np.arange(body.n_owned), fixed)
    u, v = fem.Function(body.space), ufl.TestFunction(body.space)
    forms = [fem.form(term) for term in body.internal_work(u, v)]
    # about -y, so that it bends upwards; the unknown is twice the tangent of half the angle
    for angle in np.linspace(0, np.pi / 2, 7)[1:]:
        u.x.array[fixed[-1]] = -2 * np.tan(angle / 2)
        for _ in range(20):
            force = sum(fem.assemble_vector(form).array for form in forms)
            if np.linalg.norm(force[free]) < 1e-8:
                break
            tangent = body.tangent(u.x.array)
            indptr, indices, data = tangent.getValuesCSR()
            dense = scipy.sparse.csr_array((data, indices, indptr)).toarray()
            tangent.destroy()
            u.x.array[free] -= np.linalg.solve(dense[np.ix_(free, free)], force[free])
    end = own[at(body, (1, 0, 0))]
    # a circle: curvature pi/2 everywhere, no stretch
    assert u.x.array[end[:3]] + [1, 0, 0] == pytest.approx([2 / np.pi, 0, 2 / np.pi], abs=1e-6)
    moment = -sum(fem.assemble_vector(form).array for form in forms)[end[4]]
    # the unknown's conjugate: moment times d(angle) / d(2 tan(angle / 2))
    assert moment * (1 + np.tan(np.pi / 4) ** 2) == pytest.approx(p.E * p.Iy * np.pi / 2, rel=1e-5)


def test_energy_of_a_large_bend_does_not_change_when_the_bent_beam_is_turned():
    """As the mesh is refined: components of the rotation are interpolated, and not in the same way turned."""
    turn = Rotation.from_rotvec([0.4, -0.3, 0.5])
    gibbs = np.array([[0.3, 0.8, -0.5], [0.4, -0.2, 0.6], [-0.7, 0.3, 0.2]])
    differences = []
    for divisions in (8, 16):
        body = model(along(arch, divisions=divisions, degree=2, comm=MPI.COMM_SELF), SOFT)
        x, u = body.node_x, fem.Function(body.space)
        bent = Rotation.from_mrp((x + np.array([0.0, 0.2, 0.0])) @ gibbs.T / 4)
        moved = x + 0.1 * (x @ gibbs)
        energies = []
        for position, rotation in ((moved, bent), (turn.apply(moved), turn * bent)):
            angle = rotation.magnitude()[:, None]
            vector = 2 * np.tan(angle / 2) * rotation.as_rotvec() / angle
            u.x.array[body.layout.displacement_dofs] = position - x
            u.x.array[body.layout.displacement_dofs + 3] = vector
            energies.append(
                [
                    fem.assemble_scalar(fem.form(integral(term, body.groups[0], body.mesh.mesh)))
                    for term in beam.strain_energy(u, body.groups[0].symbols)
                ]
            )
        differences.append(abs(np.divide(*energies) - 1))
    coarse, fine = differences
    assert fine.max() < 1e-6
    assert (coarse / fine).min() > 7


def test_resultants_of_a_cantilever():
    """Forces and moments at the middle, for a force at the tip, in the section's axes."""
    p = dataclasses.replace(PLATE, orientation=(3.0, 1.0, 0.0))
    body = model(line(1.0, 8), p)
    k, tip = matrix(body, body.K), at(body, (1, 0, 0))
    free = np.setdiff1d(np.arange(len(k)), at(body, (0, 0, 0)))
    load = np.zeros(len(k))
    load[tip] = [5.0, 2.0, -3.0, 0.7, 0.0, 0.0]
    solved = np.zeros(len(k))
    solved[free] = np.linalg.solve(k[np.ix_(free, free)], load[free])
    u = fem.Function(body.space)
    u.x.array[order(body)] = solved
    # the Gauss points of the degree are where the stresses are exact
    cells = np.arange(8, dtype=np.int32)
    points = np.array([[0.5 - np.sqrt(1 / 12)], [0.5 + np.sqrt(1 / 12)]])
    x = fem.Expression(ufl.SpatialCoordinate(body.mesh.mesh), points).eval(body.mesh.mesh, cells).reshape(-1, 3)
    symbols = body.groups[0].symbols
    found = fem.Expression(beam.stress(u, None, symbols), points).eval(body.mesh.mesh, cells).reshape(-1, 6)
    arm = 1 - x[:, 0]
    exact = np.stack([5 + 0 * arm, 2 + 0 * arm, -3 + 0 * arm, 0.7 + 0 * arm, 3 * arm, 2 * arm], axis=1)
    assert abs(found - exact).max() < 1e-8


def test_sections_of_rectangles():
    square = STOUT
    # B. A. Boley's and others' table: 0.1406 of the side's fourth power
    assert square.J == pytest.approx(0.140577 * 0.4**4, rel=1e-5)
    assert square.ky == pytest.approx(10 * 1.3 / (12 + 11 * 0.3))
    thin = beam.Parameters.rectangle(1, 0.3, 1, width=1e-4, height=1.0, orientation=(0, 1, 0))
    assert thin.J == pytest.approx(1e-12 / 3, rel=1e-4)
    assert (thin.Iy, thin.Iz) == pytest.approx((1e-4 / 12, 1e-12 / 12))
    turned = beam.Parameters.rectangle(1, 0.3, 1, width=1.0, height=1e-4, orientation=(0, 1, 0))
    assert (turned.J, turned.Iy, turned.Iz) == pytest.approx((thin.J, thin.Iz, thin.Iy))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"E": 0.0}, "E must be positive"),
        ({"nu": 0.5}, "nu must lie between"),
        ({"Iz": float("nan")}, "Iz must be positive"),
        ({"A": "wide"}, "A must be a number"),
        ({"orientation": (0.0, 0.0, 0.0)}, "orientation must be a vector"),
        ({"orientation": (0.0, 1.0)}, "orientation must be a vector"),
        ({"orientation": 1.0}, "orientation must be a vector"),
        ({"orientation": (0.0, "up", 0.0)}, "each part of orientation must be a number"),
    ],
)
def test_parameters_out_of_range(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(PLATE, **change)


@pytest.mark.parametrize(
    "change",
    [{"width": None}, {"width": 0.0}, {"height": 1e200}, {"width": np.datetime64("2020-01-01")}, {"nu": "0.3"}],
)
def test_rectangles_that_are_none(change):
    given = {"E": 2e11, "nu": 0.3, "rho": 7800.0, "width": 0.1, "height": 0.2, "orientation": (0.0, 1.0, 0.0)} | change
    with pytest.raises(ValueError, match=f"{next(iter(change))}.* must be"):
        beam.Parameters.rectangle(**given)


@pytest.mark.mpi
def test_orientation_along_the_beam_is_refused():
    p = dataclasses.replace(PLATE, orientation=(1.0, 0.0, 0.0))
    with pytest.raises(FormulationError, match="orientation along its beam"):
        model(line(1.0, 4, MPI.COMM_WORLD), p)


def placed_sections(curve, slope, p, count=400):
    """Places, measures and section axes at Gauss points of a curve, by parameters from 0 to 1."""
    points, weights = np.polynomial.legendre.leggauss(count)
    s = (points + 1) / 2
    speed = np.linalg.norm(slope(s), axis=1)
    t = slope(s) / speed[:, None]
    y = p.orientation - (t @ p.orientation)[:, None] * t
    y /= np.linalg.norm(y, axis=1)[:, None]
    return curve(s), weights / 2 * speed, y, np.cross(t, y)


STRAIGHT = np.array([0.6, -0.3, 0.5])
SHAPES = {
    "straight": (lambda s: np.outer(s + 0.2, STRAIGHT), lambda s: np.outer(1 + 0 * s, STRAIGHT), 5, 1, 1e-12),
    # as far as parabolas follow a helix
    "helix": (helix, helix_slope, 40, 2, 1e-5),
}


@pytest.mark.mpi
@pytest.mark.parametrize("shape", SHAPES)
def test_gram_matrix_is_that_of_the_volume(shape):
    """Of {1, x, two fields} by direct quadrature over the box of material points."""
    curve, slope, divisions, degree, tolerance = SHAPES[shape]
    p = PLATE
    body = model(along(curve, divisions=divisions, degree=degree), p)
    x = body.node_x[: body.n_owned_nodes]
    modes = np.stack([np.hstack(one) for one in fields(x)], axis=2).reshape(-1, 2)
    origin, axes = np.array([-0.4, 1.3, 0.2]), Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    gram = gram_matrix(body, modes, p=origin, R=axes)

    places, measure, y, z = placed_sections(curve, slope, p)
    gauss, weight = np.array([-1, 1]) / np.sqrt(3), np.ones(2)
    expected = np.zeros((10, 10))
    for a, wa in zip(gauss, weight, strict=True):
        for b, wb in zip(gauss, weight, strict=True):
            offset = a * 0.03 / 2 * y + b * 0.01 / 2 * z
            moved = [(move + np.cross(turn, offset)) @ axes for move, turn in fields(places)]
            values = np.hstack([np.ones((len(places), 1)), (places + offset - origin) @ axes, *moved])
            expected += p.rho * p.A / 4 * wa * wb * (values * measure[:, None]).T @ values
    assert abs(gram - expected).max() < tolerance * abs(expected).max()
    assert np.array_equal(gram, gram.T)
    assert len(set(body.comm.allgather(gram.tobytes()))) == 1


def fields(x):
    """Displacements and rotations (n, 3) of two fields, linear in the place."""
    a = np.array([[0.2, -1.0, 0.4], [0.3, 0.1, 0.7], [-0.5, 0.6, 0.2]])
    return [(x @ a + [0.1, 0, 0.3], 30 * x @ a.T), (x @ a.T, 50 * (x - [0.2, 0.4, 0]) @ a)]


@pytest.mark.mpi
def test_gram_matrix_has_the_kinetic_energy_and_the_rigid_inertia():
    body = model(along(helix, divisions=6, degree=2), PLATE)
    own = keys(body)[: body.n_owned]
    random = np.cos(np.outer(7 * own[:, 1] + 5 * own[:, 2] - 11 * own[:, 3] + 3 * own[:, 4], [1.0, 1.3, 1.7]))
    rotations = body.rigid_motions(np.zeros(3), np.eye(3))[:, 3:]
    modes = np.hstack([random, rotations])
    gram = gram_matrix(body, modes, p=np.zeros(3), R=np.eye(3))
    n = modes.shape[1]
    mass = np.einsum("iaja->ij", gram[4:, 4:].reshape(n, 3, n, 3))
    every = everywhere(body, modes)
    expected = every.T @ matrix(body, body.M) @ every
    assert abs(mass - expected).max() < 1e-12 * abs(expected).max()
    # e_i x (x + offset): the rotation's own rows follow from those of the position
    for i in range(3):
        turn = np.cross(np.eye(3)[i], np.eye(3)).T
        rows = gram[4 + 3 * (3 + i) : 7 + 3 * (3 + i)]
        assert abs(rows - turn @ gram[1:4]).max() < 1e-12 * abs(gram).max()
    second = gram[1:4, 1:4]
    inertia = np.trace(second) * np.eye(3) - second
    assert abs(mass[3:, 3:] - inertia).max() < 1e-12 * abs(inertia).max()


@pytest.mark.mpi
def test_sections_that_are_not_the_kinetic_energys_are_refused():
    import types

    form = types.ModuleType("light_beam")
    form.__dict__.update({**vars(beam), "__name__": "light_beam", "__file__": None})
    wrong = lambda p: p.rho * ufl.as_matrix(((p.A, 0, 0), (0, p.Iz, 0), (0, 0, 1.01 * p.Iy)))  # noqa: E731
    form.section_inertia = wrong  # type: ignore[attr-defined]
    body = ContinuumModel(along(helix, divisions=6, degree=2), form, PLATE, degree=2)
    with pytest.raises(FormulationError, match="light_beam: the kinetic energy is not that of its motion"):
        gram_matrix(body, np.zeros((body.n_owned, 0)), p=np.zeros(3), R=np.eye(3))


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
def test_matrices_and_interfaces_do_not_depend_on_the_number_of_ranks(degree):
    names = ("start", "end")
    world, alone = (
        model(along(helix, divisions=9, degree=degree, comm=comm), PLATE, degree, names)
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    for one, other in ((world.K, alone.K), (world.M, alone.M)):
        expected = matrix(alone, other)
        assert abs(matrix(world, one) - expected).max() < 1e-13 * abs(expected).max()
    for name in names:
        bound = np.zeros(world.layout.n_local, dtype=bool)
        bound[world.interface(name).dofs] = True
        rows = everywhere(world, bound)
        assert rows.sum() == 6
        assert np.array_equal(np.flatnonzero(rows), np.sort(at(alone, alone.interface(name).p)))
        assert world.interface(name).p == pytest.approx(alone.interface(name).p, abs=1e-12)


# A thousand times as long as the radius of gyration, and bending in one plane alone below the
# frequencies that count: the other plane is stiff.
EULER = beam.Parameters(
    E=1.0, nu=0.0, rho=1.0, A=1.0, Iy=1e-2, Iz=1e-6, J=1.0, ky=1.0, kz=1.0, orientation=(0.0, 1.0, 0.0)
)

# Relative errors of the frequencies of the reduced Euler-Bernoulli beam, of its full model's: of a
# cantilever, its tip the interface, by number of fixed-interface modes; of a free one, both ends interfaces.
CANTILEVER = {
    0: (4.754e-3, 5.797e-1),
    1: (3.470e-4, 4.175e-3, 8.971e-1),
    2: (5.838e-5, 1.091e-3, 3.698e-3, 1.077),
    4: (5.410e-6, 1.400e-4, 7.096e-4, 1.633e-3, 2.449e-3),
    6: (1.075e-6, 3.163e-5, 1.855e-4, 5.122e-4, 9.742e-4),
}
FREE = {
    0: (1.993e-1, 4.861e-1),
    1: (3.600e-3, 4.861e-1, 6.852e-1),
    2: (3.600e-3, 4.388e-3, 6.852e-1, 8.355e-1),
    4: (4.105e-4, 9.188e-4, 4.273e-3, 3.889e-3, 9.499e-1),
    6: (8.635e-5, 2.645e-4, 1.294e-3, 1.505e-3, 3.485e-3),
    10: (9.748e-6, 4.081e-5, 1.941e-4, 2.974e-4, 7.655e-4),
}


@pytest.fixture(scope="module")
def slender():
    return model(line(1.0, 30), EULER, interfaces=("start", "end"))


@pytest.fixture(scope="module")
def slender_frequencies(slender):
    """The five lowest of the full model, clamped at its start, and free."""
    clamped = angular_frequencies(slender, at(slender, (0, 0, 0)), 5)
    free = angular_frequencies(slender, [], 11, shift=1e-4)
    return clamped, free[6:]


def test_a_slender_beam_is_eulers_and_bernoullis(slender_frequencies):
    clamped, free = slender_frequencies
    beta = np.array([1.87510406871, 4.69409113297, 7.85475743824, 10.9955407349, 14.1371683910])
    assert clamped == pytest.approx(beta**2 * 1e-3, rel=3e-4)
    beta = np.array([4.73004074486, 7.85320462410, 10.9956078380, 14.1371654913, 17.2787596574])
    assert free == pytest.approx(beta**2 * 1e-3, rel=3e-4)


@pytest.mark.parametrize("modes", FREE)
def test_craig_bampton_of_a_slender_beam(slender, slender_frequencies, modes):
    body = craig_bampton(slender, modes=modes, frame="start", geometric_stiffness=False)
    for clamped, exact, table in zip((["start"], []), slender_frequencies, (CANTILEVER, FREE), strict=True):
        errors = np.array(table.get(modes, ()))
        found = body.frequencies(clamped)[: len(errors)] * 2 * np.pi
        assert found / exact[: len(errors)] - 1 == pytest.approx(errors, rel=0.01)


def test_a_beam_too_stiff_in_shear_for_double_precision():
    """Rounding of the stiffness alone, amplified by its condition, moves what should move rigidly."""
    p = dataclasses.replace(EULER, ky=1e5, kz=1e5)
    with pytest.raises(ReductionError, match="double precision cannot resolve the softest"):
        craig_bampton(model(line(1.0, 60), p, interfaces=("start", "end")), modes=0, frame="start")


def test_what_a_picture_of_stress_cannot_show(slender):
    body = craig_bampton(slender, modes=1, frame="start", keep=Keep(modes=True))
    with pytest.raises(FormulationError, match=r"stress has the shape \(6,\)"):
        slender.stress_field(body, np.zeros(body.n_modes))
    older = dataclasses.replace(body, unknowns=None)
    again = model(line(1.0, 30), EULER, interfaces=("start", "end"))
    with pytest.raises(RecordError, match="displacements alone"):
        nodal_modes(older, again)
