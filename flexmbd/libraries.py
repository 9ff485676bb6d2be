"""Libraries that only some rooms need: whether they are there, asked before anything of them is imported.

Numpy-free leaf, as the errors: every room may import it.
"""

from __future__ import annotations

import importlib
import importlib.util
import logging
import sys
import warnings

from flexmbd.errors import FlexmbdError, MissingLibraryError

#: What the continuum is made of; they come together, from PyPI, Debian, conda-forge or `./run`.
OF_THE_CONTINUUM = ("basix", "dolfinx", "ffcx", "mpi4py", "petsc4py", "slepc4py", "ufl")

#: What makes a program of one rank, and workers of all others.
_MPI_POOL = "mpi4py.futures"

#: PyPI's wheel of DOLFINx: this module of it loads MPI, by which the wheel's other modules find libmpi.
_WHEEL = "dolfinx_solver"


def require(room: str, *libraries: str) -> None:
    """Refuse to go on without libraries that a room imports; looks for them without loading any, not collective.

    Args:
        room: what needs them, as the message calls it.
        libraries: the names that `import` takes.

    Raises:
        MissingLibraryError: some are not installed; says which, and how to get them.
    """
    missing = [name for name in libraries if importlib.util.find_spec(name) is None]
    if missing:
        raise MissingLibraryError(
            f"{room} needs {', '.join(missing)}: pip install 'flexmbd[fem]' (Linux on x86-64, Python from 3.12 on), "
            "./run, or conda with environment.yml (docs/install.md); machines, records and exports run without"
        )


def load_before_wheel() -> None:
    """Where DOLFINx is PyPI's wheel, load what its modules must find loaded: h5py, then MPI. Not collective.

    `dolfinx.fem.petsc` shows the wheel's HDF5 to all libraries that come after it, and h5py needs its own, newer one.

    Raises:
        MissingLibraryError: the wheel finds no MPI, or another PETSc in the place of its own.
    """
    if importlib.util.find_spec(_WHEEL) is None:
        return
    importlib.import_module("h5py")
    try:
        importlib.import_module(_WHEEL)
    except ImportError as error:
        raise MissingLibraryError(f"PyPI's wheel of DOLFINx does not load: {error}") from error


def has_mpi_workers() -> bool:
    """Whether this is a rank of `python -m mpi4py.futures`: one runs the program, all others wait for its tasks.

    By the words that Python was started with; not collective.
    """
    words = iter(sys.orig_argv[1:])
    for word in words:
        if not word.startswith("-") or word == "-":
            return False
        if word.startswith("--"):
            next(words, "")  # the only such option that lets a program run has a value
            continue
        for k, letter in enumerate(word[1:], start=2):
            if letter == "c":
                return False
            if letter in "mWX":
                value = word[k:] or next(words, "")
                if letter == "m":
                    return value in (_MPI_POOL, f"{_MPI_POOL}.server")
                break
    return False


def refuse_mpi_workers() -> None:
    """Refuse to start PETSc where it would wait for ranks that wait for tasks of mpi4py.futures. Not collective.

    Raises:
        FlexmbdError: it would.
    """
    if "petsc4py.PETSc" in sys.modules or not has_mpi_workers():
        return
    world = importlib.import_module("mpi4py.MPI").COMM_WORLD
    if world.size > 1:
        raise FlexmbdError(
            f"PETSc would wait without end for all {world.size} ranks, for rank 0 alone runs the program and the "
            "others are workers of mpi4py.futures: begin with `petsc4py.init(comm=MPI.COMM_SELF)`, before flexmbd, and "
            "give meshes comm=MPI.COMM_SELF, or load a record from a file (docs/ensembles.md)"
        )


def load_continuum() -> None:
    """Load what must come before DOLFINx and PETSc: see `load_before_wheel`, and ffcx. Not collective.

    ffcx sends all of Python's warnings to a log that nobody reads: they are shown as before. Who asked logging for
    them, or reads that log, keeps what was asked for.

    Raises:
        MissingLibraryError: PyPI's wheel of DOLFINx finds no MPI, or another PETSc in its place.
        FlexmbdError: the other ranks are workers of mpi4py.futures.
    """
    load_before_wheel()
    refuse_mpi_workers()
    shown, loaded = warnings.showwarning, "ffcx" in sys.modules
    importlib.import_module("ffcx")
    if loaded:
        readers = [*logging.getLogger("py.warnings").handlers, *logging.getLogger().handlers]
        diverted = all(isinstance(one, logging.NullHandler) for one in readers)
    else:
        diverted = warnings.showwarning is not shown
    if diverted:
        logging.captureWarnings(False)
