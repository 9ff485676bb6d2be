"""Bodies of several formulations and materials, by cell group."""

import dataclasses
import types

from mpi4py import MPI

import dolfinx
import dolfinx.fem.petsc
import micropolar
import numpy as np
import pytest
import ufl
from dolfinx import fem
from full_model import FullModel, gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.continuum.finite_elements.gram_matrix import gram_matrix
from flexmbd.errors import FormulationError, MeshError
from flexmbd.forms import solid_linear

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
RUBBER = solid_linear.Parameters(E=1e7, nu=0.45, rho=1100.0)


def tagged(parts, comm=MPI.COMM_WORLD, names=("web", "pad"), degree=1):
    """A block of six boxes of tetrahedra whose cells with x below 0.1 are of the first group."""
    mesh = meshes.block(0.3, 0.1, 0.2, divisions=(3, 1, 2), cell="tetrahedron", degree=degree, comm=comm)
    topology = mesh.mesh.topology
    every = np.arange(topology.index_map(3).size_local + topology.index_map(3).num_ghosts, dtype=np.int32)
    x = dolfinx.mesh.compute_midpoints(mesh.mesh, 3, every)
    tags = parts(x).astype(np.int32)
    own = tags > 0
    return dataclasses.replace(
        mesh,
        cell_tags=dolfinx.mesh.meshtags(mesh.mesh, 3, every[own], tags[own]),
        cell_groups={name: tag for tag, name in enumerate(names, start=1)},
    )


def halves(x):
    return np.where(x[:, 0] < 0.1, 1, 2)


def second_law():
    """The same physics by another module, written in other words."""
    form = types.ModuleType("second_law")
    form.__dict__.update({**vars(solid_linear), "__name__": "second_law", "__file__": None})

    def strain_energy(u, p):
        h = ufl.grad(u)
        f = ufl.Identity(3) + h
        strain = (f.T * f - ufl.Identity(3)) / 2
        lam, mu = p.E * p.nu / ((1 + p.nu) * (1 - 2 * p.nu)), p.E / (2 * (1 + p.nu))
        energy = lam / 2 * ufl.tr(strain) ** 2 + mu * ufl.inner(strain, strain)
        return [(energy, solid_linear.Quadrature(2))]

    form.strain_energy = strain_energy  # type: ignore[attr-defined]
    return form


def model(mesh, pairs):
    return ContinuumModel(mesh, pairs, degree=2)


def by_hand(space, web, pad):
    """Stiffness and mass from material values that vary from cell to cell, in one form each."""
    domain = space.mesh
    x = fem.Function(fem.functionspace(domain, ("DG", 0)))
    x.interpolate(lambda x: x[0])
    first = ufl.lt(x, 0.1)

    def value(name):
        return ufl.conditional(first, getattr(web, name), getattr(pad, name))

    young, nu, rho = map(value, ("E", "nu", "rho"))
    lam, mu = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    strain = ufl.sym(ufl.grad(u))
    stress = lam * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * strain
    found = []
    for form in (ufl.inner(stress, ufl.grad(v)), rho * ufl.inner(u, v)):
        matrix = dolfinx.fem.petsc.assemble_matrix(fem.form(form * ufl.dx(metadata={"quadrature_degree": 4})))
        matrix.assemble()
        found.append(gather(matrix))
    return found


def close(found, expected, tolerance=1e-13):
    return abs(found - expected).max() < tolerance * abs(expected).max()


@pytest.mark.mpi
def test_two_materials_are_those_of_a_form_whose_values_vary():
    body = model(tagged(halves), {"web": (solid_linear, STEEL), "pad": (solid_linear, RUBBER)})
    stiffness, mass = by_hand(body.space, STEEL, RUBBER)
    assert close(gather(body.K), stiffness)
    assert close(gather(body.M), mass)
    assert body.form_name == "flexmbd.forms.solid_linear"
    assert body.parameters == {"web": STEEL, "pad": RUBBER}


@pytest.mark.mpi
def test_two_formulations_and_the_order_of_the_groups():
    form = second_law()
    one = model(tagged(halves), {"pad": (form, RUBBER), "web": (solid_linear, STEEL)})
    stiffness, mass = by_hand(one.space, STEEL, RUBBER)
    assert close(gather(one.K), stiffness)
    assert close(gather(one.M), mass)
    assert one.form_name == "second_law, flexmbd.forms.solid_linear"


@pytest.mark.mpi
def test_matrices_do_not_depend_on_the_number_of_ranks():
    pairs = {"web": (solid_linear, STEEL), "pad": (solid_linear, RUBBER)}
    world, alone = (FullModel(model(tagged(halves, comm), pairs)) for comm in (MPI.COMM_WORLD, MPI.COMM_SELF))
    assert close(world.K, alone.K)
    assert close(world.M, alone.M)


@pytest.mark.mpi
def test_one_pair_is_the_body_of_one_material():
    whole = tagged(lambda x: np.ones(len(x)), names=("all",))
    one = model(whole, {"all": (solid_linear, STEEL)})
    other = ContinuumModel(whole, solid_linear, STEEL, degree=2)
    assert abs(gather(one.K) - gather(other.K)).max() == 0.0
    assert abs(gather(one.M) - gather(other.M)).max() == 0.0


@pytest.mark.mpi
def test_inertia_follows_the_densities():
    body = model(tagged(halves), {"web": (solid_linear, STEEL), "pad": (solid_linear, RUBBER)})
    gram = gram_matrix(body, np.zeros((body.n_owned, 0)), p=np.zeros(3), R=np.eye(3))
    first, second = 0.1 * 0.1 * 0.2 * STEEL.rho, 0.2 * 0.1 * 0.2 * RUBBER.rho
    assert gram[0, 0] == pytest.approx(first + second, rel=1e-13)
    assert gram[0, 1] == pytest.approx(first * 0.05 + second * 0.2, rel=1e-13)
    assert gram[1, 1] == pytest.approx(
        first * (0.05**2 + 0.1**2 / 12) + second * (0.2**2 + 0.2**2 / 12), rel=1e-13
    )


def turned():
    """A formulation whose rotations are counted the other way round."""
    form = types.ModuleType("turned")
    form.__dict__.update({**vars(micropolar), "__name__": "turned", "__file__": None})
    form.rigid_motion = lambda x, translation, rotation: ufl.as_vector(  # type: ignore[attr-defined]
        [*(translation + ufl.cross(rotation, x)), *(-rotation)]
    )
    return form


def thirds(x):
    return np.where(x[:, 0] < 0.1, 1, np.where(x[:, 0] < 0.2, 2, 0))


PAIR = (solid_linear, STEEL)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("pairs", "error", "message"),
    [
        ({"web": PAIR}, FormulationError, "cell group 'pad' has no formulation and parameters.*'pad', 'web'"),
        (
            {"web": PAIR, "pad": PAIR, "lid": PAIR},
            FormulationError,
            "no cell group 'lid' is in the mesh",
        ),
        ({"web": PAIR, "pad": STEEL}, FormulationError, "'pad' must have a pair"),
        ({}, FormulationError, "no pair is given"),
        ({"web": PAIR, "pad": (solid_linear, None)}, FormulationError, r"solid_linear\.Parameters\(\.\.\.\)"),
        (
            {"web": PAIR, "pad": (micropolar, micropolar.Parameters())},
            FormulationError,
            "'web' and 'pad' have different elements",
        ),
        (
            {"web": (micropolar, micropolar.Parameters()), "pad": (turned(), micropolar.Parameters())},
            FormulationError,
            "different rigid motions",
        ),
    ],
)
def test_pairs_that_do_not_fit_are_refused_on_all_ranks(pairs, error, message):
    with pytest.raises(error, match=message):
        model(tagged(halves), pairs)


@pytest.mark.mpi
def test_parameters_beside_pairs_are_refused():
    with pytest.raises(FormulationError, match="leave out the third argument"):
        ContinuumModel(tagged(halves), {"web": PAIR, "pad": PAIR}, STEEL, degree=2)


@pytest.mark.mpi
def test_cells_in_no_group_in_two_and_groups_without_cells():
    both = {"web": PAIR, "pad": PAIR}
    with pytest.raises(MeshError, match="12 cells are in no cell group"):
        model(tagged(thirds), both)
    mesh = tagged(halves)
    overlapping = dataclasses.replace(mesh, cell_groups={"web": 1, "pad": 2, "lid": 1})
    with pytest.raises(MeshError, match="12 cells are in two cell groups"):
        model(overlapping, {**both, "lid": PAIR})
    empty = dataclasses.replace(mesh, cell_groups={"web": 1, "pad": 2, "lid": 7})
    with pytest.raises(MeshError, match="'lid' has no cells"):
        model(empty, {**both, "lid": PAIR})


@pytest.mark.mpi
def test_what_is_wrong_on_one_rank_alone_is_an_error_on_all():
    mesh = tagged(halves)
    last = mesh.comm.rank == mesh.comm.size - 1
    pairs = {"web": PAIR, "pad": (solid_linear, "steel" if last else STEEL)}
    with pytest.raises(FormulationError, match=r"solid_linear\.Parameters"):
        model(mesh, pairs)
    if mesh.comm.size > 1:
        pairs["pad"] = (solid_linear, RUBBER if last else STEEL)
        with pytest.raises(FormulationError, match="the ranks were given different"):
            model(mesh, pairs)


@pytest.mark.mpi
def test_entries_that_are_not_finite_are_refused():
    """A material that is not regular in the cells it is given, which only a mesh can show."""
    form = types.ModuleType("singular")
    form.__dict__.update({**vars(solid_linear), "__name__": "singular", "__file__": None})

    def strain_energy(u, p):
        x = ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(u))
        (energy, rule), = solid_linear.strain_energy(u, p)
        return [(energy * ufl.sqrt(0.25 - x[0]), rule)]

    form.strain_energy = strain_energy  # type: ignore[attr-defined]
    with pytest.raises(FormulationError, match="the stiffness of singular has entries that are not finite"):
        ContinuumModel(tagged(halves), form, STEEL, degree=2)
