"""Newton's method; paths of equilibria as a load factor grows and falls, along the arc, with what is critical there.

Of whatever has equilibria: `PathSpace` says what it takes.  Machines (`multibody.linear.path`) and bodies with history
(`continuum.slow_loading`) are followed from here.
"""
