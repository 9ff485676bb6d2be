"""Homogeneous motions without the machine: F'' J = -V dW/dF + load, as a matrix equation in inertial axes."""

import numpy as np
from scipy.integrate import solve_ivp


def svk_stress(F, material):
    """dW/dF (3, 3) of St Venant-Kirchhoff."""
    lam, mu = material.lame
    E = 0.5 * (F.T @ F - np.eye(3))
    return F @ (lam * np.trace(E) * np.eye(3) + 2.0 * mu * E)


def motion(solid, stress, F, rate, times, *, second=None, load=None):
    """F at times (k, 3, 3) from F and its rate at the first; ``second`` moments about the point that rests.

    ``load`` (3, 3) is the sum of dead forces times their arms from that point, undeformed.
    """
    load = np.zeros((3, 3)) if load is None else load
    inverse = np.linalg.inv(solid.second if second is None else second)

    def change(_, y):
        now = y[:9].reshape(3, 3)
        return np.concatenate([y[9:], ((load - solid.volume * stress(now)) @ inverse).ravel()])

    start = np.concatenate([np.ravel(F), np.ravel(rate)])
    found = solve_ivp(change, times[[0, -1]], start, method="DOP853", t_eval=times, rtol=1e-12, atol=1e-13)
    return found.y[:9].T.reshape(-1, 3, 3)


def cross(w):
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
