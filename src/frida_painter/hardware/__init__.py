"""Robots, cameras and the easel: protocols in this package, one file per device in its subpackages."""
