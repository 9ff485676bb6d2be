"""Force elements, one a file.  Users enter by `flexmbd.force`."""
