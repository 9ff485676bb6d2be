"""Joints, one a file; lower pairs, universal and free joints exist as coordinates and as constraints.

The others are constraints alone; couplings act on the coordinates of joints.  Users enter by `flexmbd.joint`.
"""
