"""A part whose interfaces are rigid or averaged."""

from mpi4py import MPI

from bracket import INTERFACES, bracket

import flexmbd as fm
from flexmbd.continuum import Interface

RIGID, AVERAGED = fm.Coupling.RIGID, fm.Coupling.AVERAGED


def coupled(couplings, *, comm=MPI.COMM_SELF, degree=1):
    """The bracket with some of its interfaces, each coupled as said."""
    return bracket(
        interfaces=[
            Interface(name, INTERFACES[name].origin, INTERFACES[name].axes, coupling)
            for name, coupling in couplings.items()
        ],
        comm=comm,
        degree=degree,
    )
