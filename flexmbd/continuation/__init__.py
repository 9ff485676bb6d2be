"""Paths of equilibria as a load factor grows and falls: steps along the arc, and what is critical on the way.

Of whatever has equilibria: `PathSpace` says what it takes.  Machines (`multibody.linear.path`) and bodies with history
(`continuum.slow_loading`) are followed from here.
"""
