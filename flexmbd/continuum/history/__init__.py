"""Forms with history on a mesh that may move: the state of each point, Newton's iteration, slow loading.

Entered by the room of interiors; users meet it as `flexmbd.continuum.NonlinearModel`.
"""
