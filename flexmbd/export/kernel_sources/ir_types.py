"""Types of LLVM IR: scalars, sequences and structures, their lanes and where these lie in memory."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import ExportError


def no_c(what: str) -> ExportError:
    """The error for what is not translated."""
    return ExportError(f"the kernels cannot be written as C: {what}; write the unit with binaries alone")


@dataclass(frozen=True)
class Scalar:
    """A number or an address.

    Attributes:
        kind: "i" for whole numbers, "f" for floating-point numbers, "p" for addresses.
        bits: its width.
    """

    kind: str
    bits: int

    def __post_init__(self) -> None:
        if self.bits > 64 or (self.kind == "f" and self.bits < 32):
            raise no_c(f"numbers of {self.bits} bits are not known")

    @property
    def size(self) -> int:
        """Bytes in memory, to which it is aligned."""
        return next(size for size in (1, 2, 4, 8) if 8 * size >= self.bits)

    @property
    def c(self) -> str:
        """Its type in C: whole numbers without a sign, upper bits zero; addresses as such numbers."""
        if self.kind == "f":
            return "double" if self.bits == 64 else "float"
        return f"uint{8 * self.size}_t"


@dataclass(frozen=True)
class Sequence:
    """An array or a vector."""

    count: int
    of: Type
    is_vector: bool


@dataclass(frozen=True)
class LayoutType:
    """Parts one after the other."""

    parts: tuple[Type, ...]
    packed: bool


Type = Scalar | Sequence | LayoutType

ADDRESS, INT32, INT64 = Scalar("p", 64), Scalar("i", 32), Scalar("i", 64)


def lanes_of(kind: Type | None) -> tuple[Scalar, ...]:
    """The scalars that a value consists of; none of void."""
    if kind is None:
        return ()
    if isinstance(kind, Scalar):
        return (kind,)
    if isinstance(kind, Sequence):
        return lanes_of(kind.of) * kind.count
    return tuple(lane for part in kind.parts for lane in lanes_of(part))


def alignment(kind: Type) -> int:
    """In bytes."""
    if isinstance(kind, Scalar):
        return kind.size
    if isinstance(kind, Sequence):
        return size_of(kind) if kind.is_vector else alignment(kind.of)
    return 1 if kind.packed else max([1, *map(alignment, kind.parts)])


def size_of(kind: Type) -> int:
    """Bytes from one of this type to the next in an array."""
    if isinstance(kind, Scalar):
        return kind.size
    if isinstance(kind, Sequence):
        if kind.is_vector and isinstance(kind.of, Scalar) and kind.of.bits % 8:
            raise no_c("vectors of bits in memory are not known")
        return kind.count * size_of(kind.of)
    end = places_of(kind)[-1] + size_of(kind.parts[-1]) if kind.parts else 0
    return _up(end, alignment(kind))


def places_of(kind: LayoutType) -> list[int]:
    """Offsets of a structure's parts (bytes)."""
    found, end = [], 0
    for part in kind.parts:
        found.append(_up(end, 1 if kind.packed else alignment(part)))
        end = found[-1] + size_of(part)
    return found


def lane_places(kind: Type) -> list[int]:
    """Offsets of the lanes in memory (bytes)."""
    if isinstance(kind, Scalar):
        return [0]
    if isinstance(kind, Sequence):
        size, inner = size_of(kind) // max(kind.count, 1), lane_places(kind.of)
        return [k * size + place for k in range(kind.count) for place in inner]
    pairs = zip(places_of(kind), kind.parts, strict=True)
    return [start + place for start, part in pairs for place in lane_places(part)]


def part_of(kind: Type, index: int) -> tuple[int, Type, int]:
    """Of a part: its first lane among the whole's, its type, its offset (bytes)."""
    if isinstance(kind, Sequence):
        return index * len(lanes_of(kind.of)), kind.of, index * size_of(kind.of)
    if isinstance(kind, LayoutType):
        before = sum(len(lanes_of(part)) for part in kind.parts[:index])
        return before, kind.parts[index], places_of(kind)[index]
    raise no_c("a part of a scalar is asked for")


def _up(place: int, step: int) -> int:
    return -(-place // step) * step
