"""The name and version of a reduced body's file."""

from flexmbd.files.tree_file import FileKind

#: The version stays 1 until the first release.
RECORD = FileKind("flexmbd record", 1, "ReducedBody.save")
