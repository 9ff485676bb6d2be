"""The record of a reduced body: numpy arrays, the file that keeps them, and what is read off them.

One of the two gates between the continuum and the machine (the other is the protocol of interiors).  Entered by all;
knows numpy and h5py alone.
"""
