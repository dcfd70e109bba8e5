"""Sweeps: runs of all combinations of settings."""
