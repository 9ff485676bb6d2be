"""Paths of equilibria: continuation in a load factor and arc length, through limit points and bifurcations."""
