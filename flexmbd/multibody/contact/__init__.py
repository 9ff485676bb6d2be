"""Bodies that touch: shapes on frames, laws of contact, and the pairs of a scene.  Users enter by `flexmbd.contact`."""
