"""What is read off a solution: reactions, what was computed and skipped, how far stretch went.

Entered by trajectories and the system.
"""
