"""Monitors of runs: where and when reduced bodies yield, and which part of them may.

Entered by users and by `flexmbd.machine.system`; reads trajectories and records.
"""
