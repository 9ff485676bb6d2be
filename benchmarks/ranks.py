"""What more ranks gain in a reduction: a model fitted to the stages that reduction.py has measured on one rank and two.

The time of a stage on p ranks is t(p) = t(1) (1 - d (1 - s(p))) + messages: s is the share of the stage's work that the
busiest rank has, as counted (docs/scaling.md), and d how much of the stage's time is divided with it. What is not
is each rank's own work, and what two cores of one machine share, as the way to memory: on machines of their own
ranks gain no less. d is fitted, one number for each stage, to all pairs of measurements on one rank and two.

The second table tries the model on these pairs; the third says what it expects of 4 and 8 ranks of such a
machine, which nobody has measured.
"""

from __future__ import annotations

from math import ceil, log2
from typing import NamedTuple

import reduction_rows as rows
from benchmark import Report

MINUTES = 0.1
PEERS: tuple[str, ...] = ()

RANKS = (2, 4, 8)
#: Shares of the busiest rank, counted on 62 757 dofs (docs/scaling.md): flops and entries of a factor; cells.
FLOPS, ENTRIES, CELLS = {2: 0.54, 4: 0.28, 8: 0.20}, {2: 0.55, 4: 0.28, 8: 0.26}, {p: 1.0 / p for p in RANKS}
WORK = {"assembly": CELLS, "factor": FLOPS, "static shapes": ENTRIES, "modes": ENTRIES, "projection": CELLS}
REST = "rest"
#: The busiest rank's on 39 543 dofs: messages, bytes, collectives; seconds of a message or a step of a collective's
#: tree, bytes in a second, on one machine.
MESSAGES, BYTES, COLLECTIVES = {2: 504, 4: 2393, 8: 2485}, {2: 76e6, 4: 79e6, 8: 63e6}, {2: 3157, 4: 3214, 8: 3307}
LATENCY, BANDWIDTH = 2e-6, 5e9


class Pair(NamedTuple):
    """One part, measured on one rank and on two.

    Attributes:
        mesher, dofs: of the part.
        one, two: seconds of each stage.
    """

    mesher: str
    dofs: int
    one: dict[str, float]
    two: dict[str, float]


def pairs() -> list[Pair]:
    """All that is kept of parts that are large enough to divide."""
    kept = [row for row in rows.kept(rows.KEPT) if row["code"] == rows.OURS and row["dofs"] > rows.LARGE]
    both = {(row["mesher"], row["dofs"], row["ranks"]): row["seconds"] for row in kept}
    return [
        Pair(mesher, dofs, stages(seconds), stages(both[mesher, dofs, 2]))
        for (mesher, dofs, ranks), seconds in both.items()
        if ranks == 1 and (mesher, dofs, 2) in both
    ]


def stages(seconds: dict[str, float]) -> dict[str, float]:
    """Of the reduction without geometric stiffness; what belongs to none, as checks of the model, is the rest."""
    found = {name: seconds[name] for name in WORK}
    return {**found, REST: seconds["total"] - sum(found.values())}


def divided(measured: list[Pair]) -> dict[str, float]:
    """d of each stage: least squares of relative times."""
    found = {}
    for name, share in WORK.items():
        gains = [1.0 - pair.two[name] / pair.one[name] for pair in measured]
        found[name] = sum(gains) / (len(gains) * (1.0 - share[2]))
    rest = [1.0 - pair.two[REST] / pair.one[REST] for pair in measured]
    return {**found, REST: sum(rest) / (len(rest) * 0.5)}


def expected(one: dict[str, float], d: dict[str, float], ranks: int) -> float:
    """s of the whole on so many ranks, from its stages on one."""
    shares = {**WORK, REST: CELLS}
    time = sum(t * (1.0 - d[name] * (1.0 - shares[name][ranks])) for name, t in one.items())
    hops = MESSAGES[ranks] + COLLECTIVES[ranks] * ceil(log2(ranks))
    return time + LATENCY * hops + BYTES[ranks] / BANDWIDTH


def quick(report: Report) -> None:
    """It is a sum over what is kept, and takes no time."""
    full(report)


def full(report: Report) -> None:
    """The fit, the pairs, more ranks."""
    measured = pairs()
    d = divided(measured)
    report.table("stage", "work divided", "its share of the time on one rank")
    whole = sum(sum(pair.one.values()) for pair in measured)
    for name, part in d.items():
        share = sum(pair.one[name] for pair in measured) / whole
        report.say(f"| {name} | {part:.2f} | {share:.0%} |")
    report.say()
    report.table("mesh", "dofs", "one rank, s", "two, s", "times as fast", "by the model", "off")
    for pair in measured:
        one, two = sum(pair.one.values()), sum(pair.two.values())
        model = expected(pair.one, d, 2)
        report.say(
            f"| {pair.mesher} | {pair.dofs} | {one:.2f} | {two:.2f} | {one / two:.2f} | {one / model:.2f} "
            f"| {model / two - 1.0:+.0%} |"
        )
    report.say()
    report.table("mesh", "dofs", *(f"{ranks} ranks, times as fast" for ranks in RANKS))
    for pair in measured:
        gains = [sum(pair.one.values()) / expected(pair.one, d, ranks) for ranks in RANKS]
        report.say(f"| {pair.mesher} | {pair.dofs} | {' | '.join(f'{gain:.1f}' for gain in gains)} |")


if __name__ == "__main__":
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        full(Report(Path(folder)))
