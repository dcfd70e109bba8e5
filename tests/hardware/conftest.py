"""Fixtures of the tests of machines."""

from machines.simulated_time import simulated_time

__all__ = ["simulated_time"]
