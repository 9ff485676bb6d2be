"""Bodies with history loaded slowly: equilibria by steps of the load, or along the arc of their path.

Users, commands and the contract's suite enter here.
"""
