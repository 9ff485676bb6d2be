"""Forms whose compilation was killed, and libraries that are cut short, are compiled again, in any folder."""

import fcntl
import os
import subprocess
import sys
import time

from flexmbd.files import form_cache
from flexmbd.files.form_cache import is_cut_short, mend_form_cache

_COMPILE = """
import flexmbd.continuum.compat
from mpi4py import MPI
import ufl
from dolfinx import fem, mesh
domain = mesh.create_unit_interval(MPI.COMM_SELF, 1)
print(fem.assemble_scalar(fem.form(ufl.SpatialCoordinate(domain)[0] * ufl.dx)))
"""


def compiled(home):
    """In a process of its own, for a library that is loaded stays so."""
    done = subprocess.run([sys.executable, "-c", _COMPILE], env={**os.environ, "XDG_CACHE_HOME": str(home)},
                          capture_output=True, text=True, timeout=120)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == 0.5
    return home / "fenics"


def test_what_a_killed_compilation_left_is_compiled_again(tmp_path):
    folder = compiled(tmp_path)
    (library, *_), (source, *_) = (list(folder.glob(f"*.{end}")) for end in ("so", "c"))
    whole = library.read_bytes()
    assert not is_cut_short(library)
    # killed before it was done
    library.unlink()
    source.with_suffix(".c.cached").unlink()
    compiled(tmp_path)
    assert library.exists()
    # a disk that was full
    for size in (0, 63, 64, len(whole) // 2, len(whole) - 1):
        library.write_bytes(whole[:size])
        assert is_cut_short(library)
    compiled(tmp_path)
    assert not is_cut_short(library)
    assert mend_form_cache(folder) == ()


def test_a_compilation_beside_which_others_run_is_left_alone(tmp_path, monkeypatch):
    source = tmp_path / "libffcx_forms_1.c"
    source.touch()
    monkeypatch.setattr(form_cache, "_held", held := [])
    with open(tmp_path / form_cache._LOCK, "w") as other:
        fcntl.flock(other, fcntl.LOCK_SH)
        assert mend_form_cache(tmp_path) == ()
        assert source.exists()
        old = time.time() - 2.0 * form_cache._COMPILATION
        os.utime(source, (old, old))
        assert mend_form_cache(tmp_path) == ("libffcx_forms_1",)
        assert not source.exists()
    for file in held:
        os.close(file)
    source.touch()
    assert mend_form_cache(tmp_path) == ("libffcx_forms_1",)
    os.close(held[-1])
