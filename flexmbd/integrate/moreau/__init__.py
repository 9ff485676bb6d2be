"""Moreau's and Jean's time stepping: hard contacts with friction, solved for impulses at fixed steps.

Users enter by ``flexmbd.MoreauJean``.
"""
