"""Robots, cameras and the place they stand in; protocols here, one thin file per device."""
