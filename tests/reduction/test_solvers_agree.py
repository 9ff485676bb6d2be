"""Every solver finds the eigenvalues of every other within 10 eps lambda_max / lambda.

That is what rounding the entries of K does to an eigenvalue lambda of K x = lambda M x (Parlett, The Symmetric
Eigenvalue Problem, section 15.9), with room for the sums of a factor.
"""

import functools

import numpy as np
import pytest
import scipy.linalg
from full_model import gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import solid_linear
from flexmbd.reduction import KrylovSchur, Solver, SpectrumSlicing, craig_bampton

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7800.0)
EPS = np.finfo(float).eps
SOLVERS = {
    "blocks": {},
    "Krylov-Schur": {"eigensolver": KrylovSchur()},
    "slicing": {"eigensolver": SpectrumSlicing()},
    "compressed": {"solver": Solver.COMPRESSED},
    "compressed, Krylov-Schur": {"solver": Solver.COMPRESSED, "eigensolver": KrylovSchur()},
    "iterative": {"solver": Solver.ITERATIVE},
}


def cube(*names):
    """Threefold and double frequencies."""
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(2, 2, 2), degree=1)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=list(map(Interface, names)))


def clustered():
    """Square but for a millionth: the pairs of the bending are 2e-6 apart."""
    mesh = meshes.block(1.0, 0.2, 0.2 * (1.0 + 1e-6), divisions=(6, 2, 2), degree=1)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min")])


def graded():
    """Cells of 1 m to 1e-4 m along a bar, each a third or so of the one before."""
    mesh = meshes.block(1.0, 0.3, 0.2, divisions=(9, 1, 1), degree=1)
    x = mesh.mesh.geometry.x
    ends = np.concatenate([[0.0], np.cumsum(np.geomspace(1e-4, 1.0, 9))])
    x[:, 0] = ends[np.rint(9.0 * x[:, 0]).astype(int)]
    return ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min")])


PARTS = {
    "free": cube,
    "repeated": functools.partial(cube, "x_min"),
    "clustered": clustered,
    "graded": graded,
}


@functools.cache
def exact(name):
    """The model, its elastic eigenvalues by LAPACK, all of them, and the interior's size."""
    model = PARTS[name]()
    K, M = gather(model.K).toarray(), gather(model.M).toarray()
    held = np.concatenate([np.empty(0, int), *(one.dofs for one in model.interfaces)])
    inside = np.setdiff1d(np.arange(len(K)), held)
    K, M = K[np.ix_(inside, inside)], M[np.ix_(inside, inside)]
    _, x = scipy.linalg.eigh(K, M)
    # Rayleigh quotients, whose error is the square of the vectors': LAPACK's values are a few of its sums off
    values = np.sort(np.einsum("ij,ij->j", x, K @ x) / np.einsum("ij,ij->j", x, M @ x))
    return model, values[0 if model.interfaces else 6 :]


# on cells ten thousand times as wide as thick a cycle of multigrid is too far from the inverse for Davidson's method,
# which says so; by conjugate gradients in Krylov-Schur it is not
SLOW = "iterative, Krylov-Schur"
CASES = [(part, how) for part in PARTS for how in SOLVERS if (part, how) != ("graded", "iterative")]
CASES.append(("graded", SLOW))
SOLVERS[SLOW] = {"solver": Solver.ITERATIVE, "eigensolver": KrylovSchur()}


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")  # clusters are kept whole
@pytest.mark.parametrize(("part", "how"), CASES)
def test_within_the_rounding_of_the_stiffness(part, how):
    model, values = exact(part)
    frame = model.interfaces[0].name if model.interfaces else None
    found = craig_bampton(model, modes=19, frame=frame, geometric_stiffness=False, **SOLVERS[how]).stiffness
    assert len(found) >= 19
    of = values[: len(found)]
    # each within half of the bound of LAPACK's, and so within all of it of each other's
    assert (abs(found - of) <= 5.0 * EPS * values[-1]).all()
