"""Damaged copies of a file, for readers that must answer each with an error or a body, never with anything else."""

from collections.abc import Iterator

import numpy as np

from flexmbd.errors import FlexmbdError
from flexmbd.record.reduced_body import ReducedBody

# What a number may be replaced by.
_WORDS = (b"nan", b"inf", b"-1", b"0", b"1e999", b"999999999", b"2147483648", b"-2147483649", b"x", b"", b"1.D+3")


def mutations(data: bytes, *, count: int, seed: int = 0) -> Iterator[bytes]:
    """Copies of a file, each damaged in another way: cut, bytes changed, taken out, repeated, numbers replaced."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        at, length = int(random.integers(len(data))), int(random.integers(1, 64))
        match int(random.integers(6)):
            case 0:
                yield data[:at]
            case 1:
                yield data[:at] + random.bytes(length) + data[at + length :]
            case 2:
                yield data[:at] + data[at + length :]
            case 3:
                yield data[:at] + data[at : at + length] * int(random.integers(2, 50)) + data[at + length :]
            case 4:
                yield data[:at] + bytes([data[at] ^ (1 << int(random.integers(8)))]) + data[at + 1 :]
            case 5:
                words = data.split(b" ")
                words[int(random.integers(len(words)))] = _WORDS[int(random.integers(len(_WORDS)))]
                yield b" ".join(words)


def survive(read, path, data, *, count, seed=0):
    """Every damaged copy ends in an error of flexmbd or in a body; how many were bodies."""
    bodies = 0
    for number, damaged in enumerate(mutations(data, count=count, seed=seed)):
        path.write_bytes(damaged)
        try:
            body = read(path)
        except FlexmbdError:
            pass
        else:
            assert isinstance(body, ReducedBody), number
            bodies += 1
    return bodies
