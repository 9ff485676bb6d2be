"""Reduced beams for the scenes: a box of solids, meshed, reduced once, and kept in files.

The box is 1 x 0.05 x 0.05 m, E = 2.1e9 Pa, both ends rigid, body frame on the face x = 0. `modes` counts the six
static ones of the face x = 1. Beside our record lies what exudyn's reduced body is made of, in the same basis.
This file is also the script that makes them, in a process of its own.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import reduction_case as case

# what a reduction without geometric stiffness is called, and one with it
PLAIN, STIFFENED = "plain", "stiffened"


@dataclass(frozen=True)
class Beam:
    """The files of a reduced beam.

    Attributes:
        plain: our record, of exactly `modes` modes.
        stiffened: our record with geometric stiffness and the modes that it brings.
        peer: .npz of nodes, plain modes at the nodes, and the mass matrix, for exudyn.
    """

    plain: Path
    stiffened: Path
    peer: Path


def beam(mesh: str, modes: int, *, folder: Path, meshes: Path | None = None) -> Beam:
    """The files of the beam, made where they are not there yet.

    Args:
        mesh: "5k", "19k" or "63k", by the number of dofs.
        modes: six static ones and fixed-interface ones.
        folder: of the files.
        meshes: a folder with a .npz file of `points` and `tet10` for each mesh, or None: gmsh makes them.
    """
    stem = folder / f"beam_{mesh}_{modes}{'' if meshes is None else '_given'}"
    found = Beam(*(Path(f"{stem}_{name}") for name in ("plain.h5", "stiffened.h5", "peer.npz")))
    if not all(path.exists() for path in (found.plain, found.stiffened, found.peer)):
        folder.mkdir(parents=True, exist_ok=True)
        source = str(case.CELL_SIZE[mesh]) if meshes is None else str(_given(meshes, mesh))
        subprocess.run([sys.executable, __file__, source, str(modes), str(stem)], check=True, stdout=subprocess.DEVNULL)
    return found


def arm(cells: int, *, folder: Path) -> Path:
    """The record of the robot arm of Simo & Vu-Quoc (1986) of so many hexahedra, made where it is not there."""
    path = folder / f"arm_{cells}.h5"
    if not path.exists():
        subprocess.run([sys.executable, __file__, "arm", str(cells), str(path)], check=True, stdout=subprocess.DEVNULL)
    return path


def _given(meshes: Path, mesh: str) -> Path:
    files = sorted(meshes.glob(f"*_{mesh}_*.npz"))
    if not files:
        raise SystemExit(f"{meshes}: no file *_{mesh}_*.npz is there")
    return files[0]


def write(source: str, modes: int, stem: str) -> None:
    """Mesh, reduce and write; loads DOLFINx."""
    from mpi4py import MPI

    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.continuum.grid.tagged_mesh import from_arrays
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import Keep, craig_bampton

    if source.endswith(".npz"):
        small = 1e-9
        ends = {"start": lambda x: x[0] < small, "end": lambda x: x[0] > case.LENGTH - small}
        points, cells = case.read_mesh(Path(source))
        mesh = from_arrays(MPI.COMM_SELF, points, cells, degree=1, facet_groups=ends)
    else:
        mesh = meshes.beam(
            case.LENGTH, case.WIDTH, case.WIDTH, h=float(source), degree=1, comm=MPI.COMM_SELF
        )
    material = solid_linear.Parameters(E=case.E, nu=case.NU, rho=case.RHO)
    interfaces = [Interface("start", origin=(0.0, 0.0, 0.0)), Interface("end", origin=(case.LENGTH, 0.0, 0.0))]
    model = ContinuumModel(mesh, solid_linear, material, degree=2, interfaces=interfaces)
    craig_bampton(model, modes=modes - 6, frame="start").save(f"{stem}_{STIFFENED}.h5")
    plain = craig_bampton(model, modes=modes - 6, frame="start", geometric_stiffness=False, keep=Keep(modes=True))
    plain.save(f"{stem}_{PLAIN}.h5")
    x, rows = np.array(model.node_x), model.displacement_dofs.reshape(-1, 3)
    nodal = plain.modes
    assert nodal is not None
    # our record's nodes in the order of the matrices
    order = np.lexsort(np.round(nodal.x, 9).T)[np.argsort(np.lexsort(np.round(x, 9).T))]
    if np.abs(nodal.x[order] - x).max() > 1e-9:
        raise SystemExit("the record's nodes are not the model's")
    indptr, indices, values = model.M.getValuesCSR()
    np.savez(
        f"{stem}_peer.npz", x=x, rows=rows, phi=nodal.phi[order], stiffness=plain.stiffness,
        indptr=indptr, indices=indices, values=values,
    )


def write_arm(cells: int, path: str) -> None:
    """10 m long, E = 4.6667e9 Pa, rho = 200 kg/m^3, body frame at x = 0; loads DOLFINx."""
    from mpi4py import MPI

    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import craig_bampton

    side = 0.0774597
    mesh = meshes.block(
        10.0, side, side, divisions=(cells, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF
    )
    material = solid_linear.Parameters(E=4.6667e9, nu=1.0 / 6.0, rho=200.0)
    ends = [Interface("x_min"), Interface("x_max")]
    model = ContinuumModel(mesh, solid_linear, material, degree=2, interfaces=ends)
    craig_bampton(model, modes=10, frame="x_min").save(path)


if __name__ == "__main__":
    if sys.argv[1] == "arm":
        write_arm(int(sys.argv[2]), sys.argv[3])
    else:
        write(sys.argv[1], int(sys.argv[2]), sys.argv[3])
