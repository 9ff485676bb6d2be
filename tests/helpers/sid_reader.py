"""A second reader of SID_FEM files, and the motion of a body by nothing but their blocks.

Written from the description of the layout and of the equations of motion, as simulation programs read them: lines are
told by the keywords found in them, entries by their integers and a mantissa and an exponent on both sides of a D.
"""

import re

import numpy as np

BODY_BLOCKS = ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe", "ksigma", "Ke", "De")


def skew(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def real(text):
    """A number as a reader has it that knows no exponent but D."""
    mantissa, exponent = text.split("D")
    assert len(mantissa.strip()) <= 19  # what such readers have room for
    return float(mantissa) * 10.0 ** int(exponent)


class Series:
    """m0 + sum over modes of m1[:, q] q."""

    def __init__(self, lines):
        heads = {}
        for word in ("order", "nrow", "ncol", "nq", "nqn", "structure"):
            line = next(lines)
            assert f"{word} " in line
            heads[word] = int(line.split("=")[1])
        self.order, self.structure = heads["order"], heads["structure"]
        shape = heads["nrow"], heads["ncol"]
        self.m0 = np.eye(*shape) if heads["structure"] == 4 else np.zeros(shape)
        self.m1 = np.zeros((shape[0], heads["nq"], shape[1]))
        for line in lines:
            if "end " in line:
                break
            left, right = line.split("=")
            name, *indices = map(int, re.findall(r"\d+", left))
            (self.m1 if name else self.m0)[tuple(i - 1 for i in indices)] = real(right)
        self.slopes = self.m1.swapaxes(0, 1).reshape(len(self.m1[0]), -1).copy()

    def at(self, q):
        return self.m0 + (q @ self.slopes).reshape(self.m0.shape)


class SidBody:
    """What stands in the file."""

    def __init__(self, path):
        lines = iter(path.read_text(encoding="ascii").splitlines())
        head = next(lines)
        assert len(head) < 511
        self.n_nodes, self.n = map(int, head.split()[:2])
        self.title = head.partition(":")[2]
        assert not any(word in self.title for word in (*BODY_BLOCKS, "refmod", "frame"))
        assert "part" in next(lines)
        self.nodes, self.blocks = [], {}
        for line in lines:
            if "refmod" in line:
                for inner in lines:
                    if " mass " in inner:
                        self.mass = real(inner.split("=")[1])
                    if "end refmod" in inner:
                        break
            elif "frame" in line:
                self._read_nodes(lines)
            else:
                for name in BODY_BLOCKS:
                    if name in line:
                        assert name not in self.blocks
                        self.blocks[name] = Series(lines)
                        break

    def _read_nodes(self, lines):
        for line in lines:
            if "end frame" in line:
                return
            if "new node" in line:
                node = {"id": int(re.findall(r"\d+", line)[0])}
                for inner in lines:
                    if "end node" in inner:
                        break
                    for name in ("origin", "phi", "psi", "AP"):
                        if name in inner:
                            node[name] = Series(lines)
                            break
                self.nodes.append(node)

    def inertia(self, q, *, second_order):
        """J (3, 3); its second order in q, which the format has no place for, is half of the linear part of Gr."""
        xx, yy, zz, xy, xz, yz = self.blocks["J"].at(q)[:, 0]
        J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if second_order:
            slope = (q @ self.blocks["Gr"].slopes).reshape(3, self.n, 3)
            more = np.einsum("rjc,j->rc", slope, q)
            J += 0.25 * (more + more.T)
        return J

    def accelerations(self, q, rate, w, gravity, *, second_order, held):
        """Of the frame's origin (3,), of its rotation (3,) and of q (n,), in the frame's axes.

        gravity: (3,) in the frame's axes. held: whether the origin stays where it is.
        """
        n, block = self.n, {name: series.at(q) for name, series in self.blocks.items()}
        J = self.inertia(q, second_order=second_order)
        centre, Ct, Cr = block["mdCM"][:, 0], block["Ct"], block["Cr"]
        M = np.zeros((6 + n, 6 + n))
        M[:3, :3], M[:3, 3:6], M[:3, 6:] = self.mass * np.eye(3), skew(centre).T, Ct.T
        M[3:6, :3], M[3:6, 3:6], M[3:6, 6:] = skew(centre), J, Cr.T
        M[6:, :3], M[6:, 3:6], M[6:, 6:] = Ct, Cr, block["Me"]
        products = np.array([w[0] ** 2, w[1] ** 2, w[2] ** 2, w[0] * w[1], w[1] * w[2], w[0] * w[2]])
        gyration = np.einsum("rjc,j->rc", block["Gr"].reshape(3, n, 3), rate)
        rates = np.einsum("ljc,j->lc", block["Ge"].reshape(n, n, 3), rate)
        force = np.zeros(6 + n)
        force[:3] = -skew(w) @ skew(w) @ centre - 2.0 * skew(w) @ Ct.T @ rate
        force[3:6] = -gyration @ w - skew(w) @ J @ w
        force[6:] = -rates @ w - block["Oe"] @ products - block["ksigma"][:, 0] - block["Ke"] @ q - block["De"] @ rate
        if held:
            moved = np.linalg.solve(M[3:, 3:], force[3:] + M[3:, :3] @ gravity)
            return np.concatenate([np.zeros(3), moved])
        found = np.linalg.solve(M, force)
        found[:3] += gravity
        return found


def fly(body, t, *, w, gravity, v=(0.0, 0.0, 0.0), second_order, held, rtol=1e-11):
    """Positions of the nodes, (nt, nodes, 3), of a body that starts undeformed at the inertial origin."""
    from scipy.integrate import solve_ivp

    n = body.n

    def rate(_, y):
        Q, q, u, spin, qd = y[3:7], y[7 : 7 + n], y[7 + n : 10 + n], y[10 + n : 13 + n], y[13 + n :]
        R = rotation(Q)
        a = body.accelerations(q, qd, spin, R.T @ gravity, second_order=second_order, held=held)
        s, v = Q[0], Q[1:]
        turning = 0.5 * np.concatenate([[-v @ spin], s * spin + np.cross(v, spin)])
        return np.concatenate([u, turning, qd, R @ a[:3], a[3:]])

    start = np.concatenate([np.zeros(3), [1.0, 0.0, 0.0, 0.0], np.zeros(n), v, w, np.zeros(n)])
    found = solve_ivp(rate, (0.0, t[-1]), start, method="DOP853", t_eval=t, rtol=rtol, atol=1e-3 * rtol)
    assert found.success
    places = np.zeros((len(t), len(body.nodes), 3))
    for k, y in enumerate(found.y.T):
        for i, node in enumerate(body.nodes):
            places[k, i] = y[:3] + rotation(y[3:7]) @ node["origin"].at(y[7 : 7 + n])[:, 0]
    return places


def rotation(Q):
    s, v = Q[0] / np.linalg.norm(Q), Q[1:] / np.linalg.norm(Q)
    return np.eye(3) + 2.0 * s * skew(v) + 2.0 * skew(v) @ skew(v)
