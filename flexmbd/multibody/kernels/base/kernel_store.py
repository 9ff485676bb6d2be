"""Machine code of kernels on disk: each under a digest of what it follows from, whatever checkout compiled it."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from flexmbd.multibody.kernels.base.cache_pruning import note_use, prune
from flexmbd.multibody.kernels.base.kernel_stamp import stamp

_PACKAGE = Path(__file__).resolve().parents[3]
_SIZE = hashlib.sha256().digest_size


def cache_folder() -> Path:
    """Return the folder of compiled kernels.

    ``NUMBA_CACHE_DIR`` where set, else ``$XDG_CACHE_HOME/flexmbd/kernels`` (by default
    ``~/.cache/flexmbd/kernels``): never inside the install, which may be read-only.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "flexmbd" / "kernels"


@cache
def is_cache_writable() -> bool:
    """Whether kernels can be kept in ``cache_folder()``, which is made where it is not there."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def kernels_written() -> int:
    """Return the number of kernels, parts of others included, that this process has put into the cache."""
    return len(_written)


_written: list[str] = []


def place_of(function: Any, stamped: str) -> tuple[Path, str]:
    """The folder of a function's entries in the cache, and what their names begin with."""
    name = f"{function.__module__.rpartition('.')[2]}.{function.__qualname__.replace('<', '').replace('>', '')}"
    source = Path(function.__code__.co_filename).resolve()
    inside = source.relative_to(_PACKAGE).parent if source.is_relative_to(_PACKAGE) else Path("users")
    return cache_folder() / "flexmbd" / inside, f"{name}-{stamped[:16]}"


def read_checked(path: Path, known: str) -> bytes | None:
    """What a file holds behind its digest; None where it is absent.

    Each file begins with a digest of what follows, of its name and of all that it follows from, ``known``.  A file that
    is cut short, damaged or another one's has the wrong digest and counts as absent, so that it is compiled anew and
    written over.
    """
    try:
        content = path.read_bytes()
    except OSError:
        return None
    if content[:_SIZE] != _digest(path.name, known, content[_SIZE:]):
        return None
    note_use(str(path))
    return content[_SIZE:]


def write_checked(path: Path, known: str, content: bytes) -> None:
    """Write a file for ``read_checked``, at once whole.

    Raises:
        OSError: it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"tmp.{os.getpid()}.{hashlib.sha256(os.urandom(8)).hexdigest()[:8]}")
    try:
        temporary.write_bytes(_digest(path.name, known, content) + content)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def note_written(path: Path) -> None:
    """Count a kernel that was put into the cache; the first one of a process has old ones removed."""
    if not _written:
        prune(cache_folder() / "flexmbd")
    _written.append(path.name)


def _digest(name: str, known: str, content: bytes) -> bytes:
    return hashlib.sha256(f"{known}\0{name}\0".encode() + content).digest()


@dataclass(frozen=True)
class Image:
    """Machine code of a kernel for one set of types of arguments, as it stands on disk.

    Attributes:
        entry: symbol of the C function ``int32 entry(int64 *words)``: arguments, behind them what is returned.
        symbol: that of the kernel itself, which other kernels call.
        returns: what it returns, as `entry.EntryCall` reads it.
        kind: the same with numba's names of numbers.
        needs: symbols of others that it calls.
        triple: the platform.
        code: object code for this processor.
        program: the optimised program, LLVM's bitcode.
    """

    entry: str
    symbol: str
    returns: Any
    kind: str
    needs: tuple[str, ...]
    triple: str
    code: bytes
    program: bytes


def image_of(kernel: Any, key: str, compile_it: Callable[[], tuple[Image, bool]]) -> Image:
    """The image of an entry for arguments that ``key`` tells from others: from the cache, else compiled and kept.

    ``compile_it`` gives the image, and whether it is good for other processes.
    """
    function = kernel.py_func
    if not os.path.isfile(function.__code__.co_filename):  # typed in: there is no source to know it by
        return compile_it()[0]
    stamped = stamp(function, kernel.entry_options)
    folder, name = place_of(function, stamped)
    known = f"{stamped} {_processor()} {key}"
    path = folder / f"{name}.{hashlib.sha256(known.encode()).hexdigest()[:16]}.kernel"
    content = read_checked(path, known)
    if content is not None:
        return _unpacked(content)
    image, lasting = compile_it()
    if lasting:
        try:
            write_checked(path, known, _packed(image))
        except OSError:
            return image  # a read-only or a full disk: the next process compiles it again
        note_written(path)
    return image


def kept_code(name: str, what: str, written: Callable[[], bytes]) -> bytes:
    """Object code of a name that follows from ``what``: from the cache, else written and kept."""
    known = f"{what} {_processor()}"
    path = cache_folder() / "flexmbd" / "calls" / f"{name}-{hashlib.sha256(known.encode()).hexdigest()[:16]}.kernel"
    code = read_checked(path, known)
    if code is None:
        code = written()
        with suppress(OSError):  # a read-only or a full disk
            write_checked(path, known, code)
    return code


def _packed(image: Image) -> bytes:
    head = asdict(image)
    code, program = head.pop("code"), head.pop("program")
    text = json.dumps({**head, "size": len(code)}).encode()
    return len(text).to_bytes(8, "little") + text + code + program


def _unpacked(content: bytes) -> Image:
    begin = 8 + int.from_bytes(content[:8], "little")
    head = json.loads(content[8:begin])
    end = begin + head.pop("size")
    return Image(**{**head, "needs": tuple(head["needs"])}, code=content[begin:end], program=content[end:])


@cache
def _processor() -> str:
    """What machine code depends on besides its program: the processor, numba's wishes for it, the code's writer."""
    wishes = [os.environ.get(f"NUMBA_{name}", "") for name in ("CPU_NAME", "CPU_FEATURES", "OPT")]
    features = llvm.get_host_cpu_features().flatten()
    return " ".join((llvm.get_process_triple(), llvm.get_host_cpu_name(), features, *wishes, llvmlite.__version__))
