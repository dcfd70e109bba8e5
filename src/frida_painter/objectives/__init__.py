"""Objectives: losses of the rendered picture that a plan is optimised for."""
