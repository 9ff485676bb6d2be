"""Lanes of values as words of C, and how they lie in memory."""

from __future__ import annotations

from flexmbd.export.kernel_sources.ir_text import Lane, c_lane
from flexmbd.export.kernel_sources.ir_types import Scalar, Type, lanes_of, no_c


def texts(kind: Type, values: list[Lane]) -> list[str]:
    """Lanes as C."""
    return [c_lane(lane, value) for lane, value in zip(lanes_of(kind), values, strict=True)]


def _memory_word(kind: Scalar) -> str:
    if kind.bits % 8 and kind.bits != 1:
        raise no_c(f"whole numbers of {kind.bits} bits in memory are not known")
    return f"{'f' if kind.kind == 'f' else 'i'}{8 * kind.size}"


def load(lane: Scalar, address: str, place: int = 0) -> str:
    """What lies at an address."""
    found = f"load_{_memory_word(lane)}({address}{f' + {place}u' if place else ''})"
    return f"{found} & 1u" if lane.bits == 1 else found


def store(lane: Scalar, address: str, value: str, place: int = 0) -> str:
    """A statement that puts a value there."""
    return f"store_{_memory_word(lane)}({address}{f' + {place}u' if place else ''}, {value});"
