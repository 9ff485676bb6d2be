"""The one way into an HDF5 file that somebody else may have made: all that it gives stands in the file itself.

HDF5 lets a file refer to others: links to them, datasets whose numbers are in them (external storage) or are gathered
from them (virtual datasets), references as values. With these a crafted file makes its reader read any file of the
user's, so that all are refused, before a number is read. So is what no file of ours has: filters, which may load code
and grow without bound, links that lead back, values that are neither numbers nor texts, and more data than there are
bytes.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from flexmbd.errors import RecordError

if TYPE_CHECKING:
    import h5py


def open_hdf5(source: Path | BinaryIO, mode: str = "r", *, size: int, locking: bool | None = None) -> h5py.File:
    """Open a file whose beginning was found to be one of ours; the caller closes it.

    Args:
        source: its path, or a stream of its bytes.
        mode: "r" or "r+".
        size: its length in bytes.
        locking: as h5py takes it; None: its default.

    Raises:
        RecordError: it refers to what is outside, or holds what no file of ours does.
        OSError, RuntimeError, ValueError, KeyError, TypeError: HDF5 cannot read it.
    """
    import h5py

    file = h5py.File(source, mode, locking=locking)
    try:
        claimed = _claimed(file, set())
        if claimed > size:  # a dataset may claim any size at no cost in the file
            raise RecordError(f"it claims {claimed} bytes of data, and has {size}")
    except BaseException:
        file.close()
        raise
    return file


def _claimed(group: h5py.Group, seen: set[int]) -> int:
    """Bytes that the datasets of a group claim together; raises RecordError for what does not stand in the file."""
    import h5py

    seen.add(h5py.h5o.get_info(group.id).addr)
    total = 0
    for name in group.id:
        where = f"item {group.name.rstrip('/')}/{name.decode(errors='replace')}"
        if group.id.links.get_info(name).type != h5py.h5l.TYPE_HARD:
            raise RecordError(f"{where} is a link to elsewhere; this file is not one that flexmbd wrote")
        item = group[name]
        if isinstance(item, h5py.Datatype) or (at := h5py.h5o.get_info(item.id).addr) in seen:
            raise RecordError(f"{where} has a named type or a second name; this file is not one that flexmbd wrote")
        if isinstance(item, h5py.Group):
            total += _claimed(item, seen)
            continue
        seen.add(at)
        _refuse_storage(item.id, where)
        total += int(item.size or 0) * int(item.dtype.itemsize)
    return total


def _refuse_storage(dataset: h5py.h5d.DatasetID, where: str) -> None:
    import h5py

    plan = dataset.get_create_plist()
    if plan.get_layout() == h5py.h5d.VIRTUAL or plan.get_external_count() > 0:
        raise RecordError(f"{where} has its numbers in another file; this file is not one that flexmbd wrote")
    if plan.get_layout() not in (h5py.h5d.CONTIGUOUS, h5py.h5d.COMPACT) or plan.get_nfilters() > 0:
        raise RecordError(f"{where} is in pieces or compressed; this file is not one that flexmbd wrote")
    if dataset.get_type().get_class() not in (h5py.h5t.INTEGER, h5py.h5t.FLOAT, h5py.h5t.STRING):
        raise RecordError(f"{where} holds neither numbers nor texts; this file is not one that flexmbd wrote")
