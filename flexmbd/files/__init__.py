"""Files: bytes, texts, archives and trees of arrays, written whole or not at all and read within bounds.

Entered by all that read or write; knows numpy and h5py alone.
"""
