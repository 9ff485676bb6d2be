"""Twenty mutants: signs, factors and indices in eleven rooms, each of which the tests named beside it must fail on.

    ./run python tools/mutants.py               # all of them, some twenty minutes of a core
    ./run python tools/mutants.py rotors Radau  # those whose name has one of these words

Each is made in a copy of the checkout, which the tests then import. Run it after tests were thinned or made faster. A
mutant that survives is named, and the exit code says whether there was one. That each text still stands in its file
is asked by tests/packaging/test_mutants.py.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Mutant:
    """A text of a file, which stands there once, what takes its place, and tests of which one at least is to fail."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]


MUTANTS = (
    Mutant("solid: factor of the stress", "forms/solid_linear.py", "ufl.Identity(3) + 2 * mu", "ufl.Identity(3) + mu",
           ("tests/forms/test_solid_linear.py", "tests/forms/test_contract.py -k solid_linear-tetrahedron-1")),
    Mutant("plate: sign of Poisson's ratio", "forms/plate_mitc.py", "p.E / (1 - p.nu**2)", "p.E / (1 + p.nu**2)",
           ("tests/forms/test_plate_mitc.py",)),
    Mutant("tube: index of its axis", "meshes/tube.py", "np.roll(upright.points, 1, axis=1)",
           "np.roll(upright.points, 2, axis=1)", ("tests/meshes/test_plate_and_tube.py",)),
    Mutant("sections: factor of their offset", "flexmbd/continuum/finite_elements/section_inertia.py",
           "offset = -0.5 *", "offset = -1.0 *",
           ("tests/reduction/test_micro_inertia.py", "tests/forms/test_beam_timoshenko.py")),
    Mutant("interface: sign of a lever", "flexmbd/continuum/finite_elements/interface.py",
           "np.cross(np.eye(3), end - start)", "np.cross(np.eye(3), start - end)",
           ("tests/continuum/test_interface.py",)),
    Mutant("modal damping: factor", "flexmbd/record/held_modes.py", "(2.0 * ratios", "(1.0 * ratios",
           ("tests/reduction/test_damping.py",)),
    Mutant("rotors: index of their momentum", "flexmbd/reduction/gyroscopic.py",
           "skew[1, 2], skew[2, 0], skew[0, 1]", "skew[1, 2], skew[0, 2], skew[0, 1]",
           ("tests/reduction/test_gyroscopic.py",)),
    Mutant("turned face: sign of the stretch", "flexmbd/record/turned_face.py", "np.eye(3) - U", "np.eye(3) + U",
           ("tests/reduction/test_large_displacements.py", "tests/scenes/test_solid_and_beam.py")),
    Mutant("strain energy: factor of its square", "flexmbd/record/strain_polynomial.py", "0.5 * p @ square",
           "p @ square", ("tests/reduction/test_large_displacements.py",)),
    Mutant("inertia: sign of a product", "flexmbd/multibody/kernels/physics/inertial_forces.py",
           "-xy * w[0] + (xx + zz)", "xy * w[0] + (xx + zz)", ("tests/multibody/kernels/test_recursion.py",)),
    Mutant("articulated bodies: Coriolis' factor", "flexmbd/multibody/kernels/forward_dynamics/outward.py",
           "bias = turn(c, -s, cross3(w, add3(cross3(w, r), scale3(2.0, p_dot))))",
           "bias = turn(c, -s, cross3(w, add3(cross3(w, r), scale3(1.0, p_dot))))",
           ("tests/multibody/kernels/test_aligned_hinges.py",)),
    Mutant("tangent: sign of damping", "flexmbd/multibody/kernels/tangent/laws.py",
           "matrix[k, k] -= per_x * slope_x + per_v * slope_v", "matrix[k, k] -= per_x * slope_x - per_v * slope_v",
           ("tests/multibody/kernels/test_tangent.py", "tests/multibody/force/test_elements.py")),
    Mutant("friction: sign of its slope", "flexmbd/multibody/kernels/elements/friction.py",
           "/ data[o + 2] - 2.0 * excess", "/ data[o + 2] + 2.0 * excess", ("tests/multibody/force/test_elements.py",)),
    Mutant("Dormand and Prince: sign in the error", "flexmbd/integrate/explicit/tableau.py", "2: -71 / 16695",
           "2: 71 / 16695", ("tests/integrate/test_explicit_runge_kutta.py",)),
    Mutant("generalized-alpha: factor of beta", "flexmbd/integrate/alpha/generalized_alpha.py",
           "0.25 * (gamma + 0.5) ** 2", "0.5 * (gamma + 0.5) ** 2", ("tests/integrate/test_generalized_alpha.py",)),
    Mutant("Radau: index of the last stage", "flexmbd/integrate/radau/coefficients.py", "WEIGHTS[2].copy()",
           "WEIGHTS[1].copy()", ("tests/run/test_pulses_in_tables.py",)),
    Mutant("events: index of what changed", "flexmbd/run/event_search.py", "last = min(one[0] - 2 + most",
           "last = min(one[0] - 1 + most", ("tests/run/test_events.py", "tests/run/test_breaks.py")),
    Mutant("SID: sign of the geometric stiffness", "flexmbd/export/sid_files/sid_file.py", "[-0.5 * (one + one.T)",
           "[0.5 * (one + one.T)", ("tests/export/test_sid.py",)),
    Mutant("beams: sign in the logarithm of a pose", "flexmbd/beams/pose_logarithm.py", "d - 0.5 * once",
           "d + 0.5 * once", ("tests/beams/test_exact_beam.py",)),
    Mutant("hot spots: factor of the shear", "flexmbd/monitors/hot_spots.py", "+ 3.0 * (xy**2", "+ 2.0 * (xy**2",
           ("tests/monitors/test_hot_spots.py",)),
)  # fmt: skip


def survivors(mutants: Sequence[Mutant]) -> list[Mutant]:
    """Those on which all of their tests pass."""
    alive = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "flexmbd"
        left_out = shutil.ignore_patterns(".git", "__pycache__", ".*_cache", "*.egg-info", "out_*")
        shutil.copytree(REPOSITORY, copy, symlinks=True, ignore=left_out)
        for mutant in mutants:
            file = copy / mutant.file
            whole = file.read_text()
            file.write_text(whole.replace(mutant.old, mutant.new))
            killer = next((tests for tests in mutant.tests if _fail(copy, tests)), None)
            file.write_text(whole)
            print(f"{'SURVIVES' if killer is None else f'killed by {killer}'}: {mutant.name}", flush=True)
            alive += [mutant] if killer is None else []
    return alive


def _fail(copy: Path, tests: str) -> bool:
    """Whether one of these tests fails at least; that none ran is an error."""
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", *tests.split()]
    done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{tests} did not run:\n{done.stdout}\n{done.stderr}")
    return done.returncode == 1


if __name__ == "__main__":
    chosen = [one for one in MUTANTS if not sys.argv[1:] or any(word in one.name for word in sys.argv[1:])]
    left = survivors(chosen)
    print(f"{len(chosen) - len(left)} of {len(chosen)} killed")
    sys.exit(len(left) > 0)
