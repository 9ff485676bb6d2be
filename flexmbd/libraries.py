"""Libraries that only some rooms need: whether they are there, asked before anything of them is imported.

Numpy-free leaf, as the errors: every room may import it.
"""

from __future__ import annotations

import importlib
import importlib.util
import logging
import sys
import warnings

from flexmbd.errors import MissingLibraryError

#: What the continuum is made of; they come together, from Debian, conda-forge or `./run`.
OF_THE_CONTINUUM = ("basix", "dolfinx", "ffcx", "mpi4py", "petsc4py", "slepc4py", "ufl")


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
            f"{room} needs {', '.join(missing)}, which pip does not bring: use ./run, or conda with environment.yml "
            "(docs/install.md); machines, records and exports run without"
        )


def load_continuum() -> None:
    """Load ffcx, which sends all of Python's warnings to a log that nobody reads, and have them shown as before.

    Who asked logging for them, or reads that log, keeps what was asked for.
    """
    shown, loaded = warnings.showwarning, "ffcx" in sys.modules
    importlib.import_module("ffcx")
    if loaded:
        readers = [*logging.getLogger("py.warnings").handlers, *logging.getLogger().handlers]
        diverted = all(isinstance(one, logging.NullHandler) for one in readers)
    else:
        diverted = warnings.showwarning is not shown
    if diverted:
        logging.captureWarnings(False)
