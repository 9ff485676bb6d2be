"""Forms with history on a mesh that may move: what each point remembers, Newton's iteration, slow loading.

Entered by the room of interiors; users meet it as `flexmbd.continuum.NonlinearModel`.
"""
