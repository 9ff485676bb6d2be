"""The record of a reduced body: numpy arrays, their file, and results computed from them.

One of the two gates between the continuum and the machine (the other is the protocol of interiors).  Entered by all;
knows numpy and h5py alone.
"""
