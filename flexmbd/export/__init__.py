"""Reduced bodies for other programs, and from them: one format a file (docs/export.md).

``fm.export.NAME(body, path)`` writes the format NAME and returns what the file leaves out of the body;
``fm.export.read_NAME(path)`` reads it back. Numpy only; nothing here knows DOLFINx.
"""

from flexmbd.export.formats import FORMATS as FORMATS
from flexmbd.export.formats import Format as Format
from flexmbd.export.formats import format_named as format_named
from flexmbd.export.record_arrays import npz as npz
from flexmbd.export.record_arrays import read_npz as read_npz
