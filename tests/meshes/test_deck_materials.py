"""Materials of decks, in SI units by the units that are said."""

from mpi4py import MPI

import pytest

from flexmbd import meshes
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
STEEL = (2.1e11, 0.3, 7850.0)


@pytest.fixture
def write(shared_path):
    """Writes a text to a file on rank 0 and says where it is."""

    def write_text(text, name):
        path = shared_path / name
        if COMM.rank == 0:
            path.write_text(text)
        COMM.barrier()
        return path

    return write_text


DECKS = {
    ("m-kg-s", "bdf"): "MAT1,3,2.1+11,,.3,7850.\nPSOLID,7,3\n",
    ("mm-t-s", "bdf"): f"MAT1*   {3:<16}{'210000.':<16}{'':16}{'.3':<16}*\n*       7.85-9\nPSOLID,7,3\n",
    # the shear modulus instead, and weights instead of masses, in pounds and inches
    ("in-slinch-s", "nas"): f"PARAM,WTMASS,{1 / 386.0886!r}\nPSOLID,7,3\nMAT1,3,{2.1e11 / 6894.757293168!r},"
    f"{2.1e11 / 2.6 / 6894.757293168!r},,{7850.0 / 10686.895475 * 1e-3 * 386.0886:.9f}\n",
    ("mm-t-s", "inp"): "*MATERIAL,NAME=Steel\n*DENSITY\n7.85e-9,\n*ELASTIC\n210000., .3\n"
    "*SOLID SECTION, ELSET=property 7, MATERIAL=STEEL\n,\n",
    ("m-t-ms", "inp"): "*MATERIAL,NAME=Steel\n*ELASTIC, TYPE=ISOTROPIC\n210., .3\n*DENSITY\n7.85D0\n"
    "*SOLID SECTION, MATERIAL=Steel, ELSET=property 7\n",
}


@pytest.mark.parametrize(("units", "ending"), DECKS)
def test_steel_in_any_units(write, units, ending):
    text = DECKS[units, ending]
    found = meshes.materials(write(text, f"part.{ending}"), units=units)["property 7"]
    assert (found.E, found.nu, found.rho) == pytest.approx(STEEL, rel=2e-6)


@pytest.mark.parametrize(
    ("text", "ending", "units", "pattern"),
    [
        ("MAT1,3,1.,,.3\n", "bdf", "mm-t-s", r"its solids have no isotropic elastic material"),
        ("MAT1,3,one,,.3\n", "bdf", "mm-t-s", r"part\.bdf: line 1: MAT1 3: 'one' is not a number"),
        ("MAT1,3,1.,,.3\n", "msh", "mm-t-s", r"materials are read from \.bdf"),
        ("MAT1,3,1.,,.3\n", "bdf", "mm-kg", r"units='mm-kg' is not length-mass-time, as 'mm-t-s'"),
        ("*ELASTIC\n1.,.3,20.\n2.,.3,40.\n*SOLID SECTION,ELSET=a\n", "inp", "mm-t-s", "no isotropic elastic material"),
    ],
)
def test_what_is_not_offered(write, text, ending, units, pattern):
    with pytest.raises(MeshError, match=pattern):
        meshes.materials(write(text, f"part.{ending}"), units=units)
    assert COMM.allreduce(1) == COMM.size
