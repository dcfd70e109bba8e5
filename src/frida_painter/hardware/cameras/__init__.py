"""Cameras by kind: one thin file per kind. Their clock is this computer's, as it is that of real robots."""
