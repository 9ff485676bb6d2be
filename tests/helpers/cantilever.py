"""A geometrically exact cantilever by finite elements, and as a rod by its differential equations."""

from mpi4py import MPI

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum.history.displacement_newton import Convergence
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.slow_loading.static_path import clamped_dofs, follow
from flexmbd.forms import beam_exact

# what rounds is the axial force, of a stiffness far above the loads
LOOSE = Convergence(tolerance=1e-8)


class Cantilever:
    """Along x, clamped at its start."""

    def __init__(self, p, *, length, n, form=beam_exact, degree=2):
        self.mesh = meshes.line(length, divisions=n, comm=MPI.COMM_SELF)
        self.body = NonlinearModel(self.mesh, form, p, degree=degree)
        self.held = clamped_dofs(self.body, ["start"])
        node = self.body.layout.nodes_on(0, self.mesh.facets("end"))[0]
        self.tip = self.body.displacement_dofs[node][0] + np.arange(6)

    def load(self, load, *, steps, at=None):
        """Bring up a load (6,) on the tip in equal steps; the tip's motion (6,)."""
        return self.follow(load, np.arange(1, steps + 1) / steps, at=at)

    def follow(self, load, shares, *, at=None):
        """The same by these shares of it."""
        whole = np.zeros(self.body.n_owned)
        whole[self.tip] = load
        follow(
            self.body, shares, prescribed=self.held, load=lambda t: t * whole, convergence=LOOSE,
            accepted=None if at is None else lambda t: at(t, self.body.displacement[self.tip]),
        )  # fmt: skip
        return self.body.displacement[self.tip].copy()


def rod_tips(p, forces, *, length, moment=None):
    """(k, 3) m: the tip's displacement under each of these dead forces (k, 3) N, a small one first.

    With a moment (3,) N m, nearly that at the clamp, the first force may be any, and the rod buckled.

    Independent of any form: r' = R (1 + n / EA, ..), R' = R kappa, m' + r' x f = 0 along the length, by quaternions,
    shooting for the moment at the clamp. Section axes are those of the mesh.
    """
    G = p.E / (2 * (1 + p.nu))
    stretch, bend = np.array([p.E * p.A, p.ky * G * p.A, p.kz * G * p.A]), np.array([G * p.J, p.E * p.Iy, p.E * p.Iz])

    def rates(_, y, force):
        R = Rotation.from_quat(y[3:7]).as_matrix()
        along = R @ (force @ R / stretch + [1.0, 0.0, 0.0])
        spin = R @ (y[7:] @ R / bend)
        turn = [*(y[6] * spin + np.cross(spin, y[3:6])), -spin @ y[3:6]]
        return np.concatenate([along, np.array(turn) / 2, -np.cross(along, force)])

    def ends(moment, force):
        start = np.concatenate([[0.0, 0, 0, 0, 0, 0, 1], moment])
        return solve_ivp(rates, (0.0, length), start, "DOP853", rtol=1e-10, atol=1e-12, args=(force,)).y[:, -1]

    tips, last = [], None
    for force in np.asarray(forces, dtype=float):
        if last is not None:
            moment = moment * np.linalg.norm(force) / last
        elif moment is None:
            moment = np.cross([length, 0, 0], force)
        moment = root(lambda m: ends(m, force)[7:], moment, tol=1e-11).x  # noqa: B023
        end, last = ends(moment, force), np.linalg.norm(force)
        assert abs(end[7:]).max() < 1e-8 * abs(moment).max()
        tips.append(end[:3] - [length, 0.0, 0.0])
    return np.array(tips)
