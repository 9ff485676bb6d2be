"""One measurement of a peer: `python reduction_peers.py CODE mesh.npz report.json`.

CODE is a name in CODES. Everything runs on one thread. Started by reduction.py.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import netgen.meshing as netgen
import ngsolve
import numpy as np
import reduction_case as case
import scipy.sparse

FACES = np.array([(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)])


def main(code: str, mesh_file: str, report_file: str) -> None:
    ngsolve.SetNumThreads(1)
    mesh = netgen_mesh(*case.read_mesh(Path(mesh_file)))
    watch = case.Stopwatch()
    before = case.peak_memory()
    with watch.stage("total"):
        basis, matrices = CODES[code](mesh, watch)
    peak = case.peak_memory()
    stiffness, mass = (basis.T @ (matrix @ basis) for matrix in matrices)
    report = {
        "dofs": matrices[0].shape[0],
        "ranks": 1,
        "seconds": watch.seconds,
        "memory": {"before": before, "peak": peak},
        "frequencies": case.reduced_frequencies(stiffness, mass),
    }
    case.write_report(report_file, report)


def netgen_mesh(points: np.ndarray, cells: np.ndarray) -> ngsolve.Mesh:
    """The same tetrahedra in NGSolve; boundaries "start" (x = 0), "end" (x = length) and "side"."""
    corners = points[cells]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1])
    # netgen counts the vertices of a tetrahedron the other way round
    cells = np.where(volumes[:, None] > 0.0, cells[:, [0, 2, 1, 3]], cells)
    mesh = netgen.Mesh(3)
    for number in (1, 2, 3):
        mesh.Add(netgen.FaceDescriptor(bc=number, domin=1, surfnr=number))
    numbers = [mesh.Add(netgen.MeshPoint(netgen.Pnt(*map(float, x)))) for x in points]
    for cell in cells.tolist():
        mesh.Add(netgen.Element3D(1, [numbers[i] for i in cell]))  # type: ignore[index]
    faces = cells[:, FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    for face in faces[first[count == 1]].tolist():
        x = points[face, 0]
        region = 1 if (x < 1e-9).all() else 2 if (x > case.LENGTH - 1e-9).all() else 3
        mesh.Add(netgen.Element2D(region, [numbers[i] for i in face]))
    for number, name in enumerate(("start", "end", "side")):
        mesh.SetBCName(number, name)
    return ngsolve.Mesh(mesh)


def exudyn_scipy(mesh: ngsolve.Mesh, watch: case.Stopwatch) -> tuple[np.ndarray, Sequence[Any]]:
    """Exudyn's Hurty-Craig-Bampton modes by scipy: SuperLU once for the modes and once for the statics."""
    import scipy.sparse.linalg

    # it imports these by name when it is called
    scipy.sparse.linalg.eigsh = watch.watch(scipy.sparse.linalg.eigsh, "modes")
    scipy.sparse.linalg.factorized = watch.watch(scipy.sparse.linalg.factorized, "factor")
    from exudyn.FEM import HCBstaticModeSelection

    fem, _, ends = _exudyn_model(mesh, watch)
    fem.ComputeHurtyCraigBamptonModes(
        ends,
        case.FIXED_INTERFACE_MODES,
        useSparseSolver=True,
        computationMode=HCBstaticModeSelection.RBE2,
        timerTreshold=10**9,
    )
    return _exudyn_result(fem)


def exudyn_ngsolve(mesh: ngsolve.Mesh, watch: case.Stopwatch) -> tuple[np.ndarray, Sequence[Any]]:
    """Exudyn's Hurty-Craig-Bampton modes by NGSolve's sparse Cholesky factor and PINVIT."""
    import ngsolve.eigenvalues

    ngsolve.eigenvalues.PINVIT = watch.watch(ngsolve.eigenvalues.PINVIT, "modes")
    fem, forms, ends = _exudyn_model(mesh, watch)
    fem.ComputeHurtyCraigBamptonModesNGsolve(*forms, ends, case.FIXED_INTERFACE_MODES)
    return _exudyn_result(fem)


def _exudyn_model(mesh: ngsolve.Mesh, watch: case.Stopwatch) -> tuple[Any, Sequence[Any], list[Any]]:
    """Its finite element interface, mass and stiffness forms, and the nodes of the two ends."""
    from exudyn.FEM import FEMinterface

    fem = FEMinterface()
    with watch.stage("assembly"):
        mass, stiffness, _ = fem.ImportMeshFromNGsolve(
            mesh, density=case.RHO, youngsModulus=case.E, poissonsRatio=case.NU, meshOrder=2
        )
    ends = [fem.GetNodesInPlane([x, 0.0, 0.0], [1.0, 0.0, 0.0]) for x in (0.0, case.LENGTH)]
    return fem, (mass, stiffness), ends


def _exudyn_result(fem: Any) -> tuple[np.ndarray, Sequence[Any]]:
    return fem.modeBasis["matrix"], (fem.GetStiffnessMatrix(sparse=True), fem.GetMassMatrix(sparse=True))


def ngsolve_arnoldi(mesh: ngsolve.Mesh, watch: case.Stopwatch) -> tuple[np.ndarray, Sequence[Any]]:
    """The same reduction written in NGSolve: sparse Cholesky and its own shift-and-invert Arnoldi method.

    The solver factorises once more, and takes 40 vectors to be sure of 13 modes to 1e-12.
    """
    with watch.stage("assembly"):
        space = ngsolve.VectorH1(mesh, order=2, dirichlet="start|end")
        u, v = space.TnT()
        mu, lam = case.E / (2 * (1 + case.NU)), case.E * case.NU / ((1 + case.NU) * (1 - 2 * case.NU))
        strain, test = ngsolve.Sym(ngsolve.Grad(u)), ngsolve.Sym(ngsolve.Grad(v))
        energy = 2 * mu * ngsolve.InnerProduct(strain, test) + lam * ngsolve.div(u) * ngsolve.div(v)
        stiffness = ngsolve.BilinearForm(energy * ngsolve.dx, symmetric=True).Assemble()
        mass = ngsolve.BilinearForm(case.RHO * u * v * ngsolve.dx, symmetric=True).Assemble()
    free = space.FreeDofs()
    with watch.stage("factor"):
        inverse = stiffness.mat.Inverse(free, inverse="sparsecholesky")
    with watch.stage("static"):
        arm = ngsolve.CF((ngsolve.x - case.LENGTH, ngsolve.y, ngsolve.z))
        axes = [ngsolve.CF(tuple(map(float, row))) for row in np.eye(3)]
        motions = [*axes, *(ngsolve.Cross(axis, arm) for axis in axes)]
        field = ngsolve.GridFunction(space)
        columns = []
        for motion in motions:
            field.Set(motion, definedon=mesh.Boundaries("end"))
            # exact in one step where the factor is
            field.vec.data -= inverse @ stiffness.mat * field.vec
            columns.append(field.vec.FV().NumPy().copy())
    with watch.stage("modes"):
        vectors = [ngsolve.CreateVVector(space.ndof, complex=True, entrysize=1) for _ in range(40)]
        values = ngsolve.ArnoldiSolver(
            stiffness.mat, mass.mat, free, vectors, 0.0, inverse="sparsecholesky"
        )
        order = np.argsort(np.array(list(values)).real)[: case.FIXED_INTERFACE_MODES]
        columns += [vectors[i].FV().NumPy().real.copy() for i in order]
    basis = np.column_stack(columns)
    return basis, (_whole(stiffness.mat), _whole(mass.mat))


def _whole(matrix: Any) -> Any:
    """A symmetric matrix of NGSolve, of which it keeps the lower half, as scipy's."""
    rows, columns, values = matrix.COO()
    half = scipy.sparse.coo_array((values, (rows, columns)), shape=(matrix.height, matrix.width)).tocsr()
    return half + half.T - scipy.sparse.diags_array(half.diagonal()) if _is_half(half) else half


def _is_half(matrix: Any) -> bool:
    return scipy.sparse.triu(matrix, 1).nnz == 0


CODES = {
    "exudyn, scipy": exudyn_scipy,
    "exudyn, NGSolve": exudyn_ngsolve,
    "NGSolve": ngsolve_arnoldi,
}


if __name__ == "__main__":
    main(*sys.argv[1:4])
