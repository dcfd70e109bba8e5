"""Sweeps: many runs over all combinations of settings."""
