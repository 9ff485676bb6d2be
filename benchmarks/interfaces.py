"""What interface reduction costs in accuracy and saves in size: a plate bolted at thirty places.

    ./run python benchmarks/interfaces.py

Over the tolerance: coordinates of the interfaces, the true error of the six lowest eigenvalues (2 pi f)^2 of the free
and of the held plate against the unreduced one, and its estimate, (1 + estimate for the fixed-interface modes)(1 + what
the interface modes add) - 1.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import scipy.sparse.linalg
from benchmark import Report

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))
from flanged_plate import PITCH, flanged_plate
from full_model import FullModel

from flexmbd.continuum import ContinuumModel
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction import InterfaceModes, Truncation, craig_bampton, truncation_errors

FRAME, MODES = "flange_1", 80
STATIC = 174  # shapes of thirty interfaces, but of the frame's
MINUTES = 3.0
PEERS: tuple[str, ...] = ()
TOLERANCES = (0.3, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5)


def eigenvalues(body: ReducedBody) -> list[np.ndarray]:
    """The six lowest of the free and of the held body."""
    return [(2 * np.pi * body.frequencies(clamped)[:6]) ** 2 for clamped in ((), (FRAME,))]


def unreduced(model: ContinuumModel) -> list[np.ndarray]:
    """The same of the unreduced model, by scipy's shift and invert."""
    full = FullModel(model)
    frames = []
    for one in model.interfaces:
        near = (abs(full.x[:, :2] - one.p[:2]) < 0.51 * PITCH).all(axis=1)
        frames.append((near & (abs(full.x[:, 2]) < 1e-9), one.p))
    x = full.bound(frames)
    k, m = ((x.T @ matrix @ x).tocsc() for matrix in (full.K, full.M))
    # below the rigid modes, well above round-off
    free = np.sort(scipy.sparse.linalg.eigsh(k, k=12, M=m, sigma=-1e4, return_eigenvectors=False))[6:]
    held = np.sort(scipy.sparse.linalg.eigsh(k[6:, 6:], k=6, M=m[6:, 6:], sigma=0.0, return_eigenvectors=False))
    return [free, held]


def largest(found: list[np.ndarray], expected: list[np.ndarray]) -> float:
    """The largest relative excess."""
    return max(float((one / other - 1.0).max()) for one, other in zip(found, expected, strict=True))


def quick(report: Report) -> None:
    """One tolerance."""
    tell(report, TOLERANCES[2:3])


def full(report: Report) -> None:
    """All tolerances."""
    tell(report, TOLERANCES)


def tell(report: Report, tolerances: tuple[float, ...]) -> None:
    """Reduce over the tolerance; a table and its picture."""
    model = flanged_plate(5, 6)
    exact = unreduced(model)
    interior = max(truncation_errors(model, [MODES], frame=FRAME, held=held).errors.max() for held in (False, True))
    report.say(
        f"30 interfaces, {STATIC} static shapes, {MODES} modes; these alone leave errors of {interior:.1e} at most."
    )
    report.table("tolerance", "modes of", f"coordinates of {STATIC}", "true error", "estimate", "s")
    rows = []
    for tol in tolerances:
        for local in (False, True):
            choice = InterfaceModes(Truncation(tol=tol), local=local)
            begin = time.perf_counter()
            body = craig_bampton(
                model, modes=MODES, frame=FRAME, geometric_stiffness=False, interface_modes=choice
            )
            seconds = time.perf_counter() - begin
            added = float(body.provenance["error of eigenvalues added by them"].split()[0])
            estimate, true = (1 + interior) * (1 + added) - 1, largest(eigenvalues(body), exact)
            count = body.n_modes - MODES
            rows.append((tol, local, count, true, estimate))
            kind = "each interface" if local else "whole"
            report.say(f"| {tol:.0e} | {kind} | {count} | {true:.2e} | {estimate:.2e} | {seconds:.2f} |")
    report.picture("interface_modes.png", lambda path: draw(rows, path, interior))


def draw(rows: list[tuple[float, bool, int, float, float]], path: Path, interior: float) -> None:
    """Error and size over the tolerance."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
    tol, _, _, true, estimate = zip(*(row for row in rows if not row[1]), strict=True)
    left.loglog(tol, estimate, "s--", label="estimate", color="C1")
    left.loglog(tol, true, "o-", label="true error", color="C0")
    left.axhline(interior, color="0.6", lw=0.8, label="fixed-interface modes alone")
    left.set(xlabel="tolerance of the interface modes", ylabel="error of the eigenvalues")
    left.legend(frameon=False, fontsize=8)
    ways = (False, "modes of all interfaces together", "o-"), (True, "modes of each interface", "s--")
    for local, text, style in ways:
        tol, _, count, _, _ = zip(*(row for row in rows if row[1] == local), strict=True)
        least = min(count)
        told = f"{text}: {'nothing is reduced' if least >= STATIC else f'down to {least}'}"
        right.semilogx(tol, count, style, label=told)
    right.axhline(STATIC, color="0.6", lw=0.8, label=f"all {STATIC} static shapes")
    right.set(xlabel="tolerance of the interface modes", ylabel="coordinates of the interfaces")
    right.set_ylim(0, 1.1 * STATIC)
    right.legend(frameon=False, fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.62))
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    OUT = Path("out_interfaces")
    OUT.mkdir(exist_ok=True)
    full(Report(OUT))
