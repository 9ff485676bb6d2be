"""The compiled inner loops of the machine: flat arrays in, flat arrays out, no Python object.

Every function here is a numba kernel whose signature is arrays only, so one compiled image,
cached on disk, serves every scene.  Only ``multibody``, ``integrate`` and ``trajectory`` call
them.
"""
