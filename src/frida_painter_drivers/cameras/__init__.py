"""Cameras, one file per kind. The times of their frames are those of this computer's clock, as for real robots."""
