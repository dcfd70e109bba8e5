"""Drivers of robots, one file per device. A driver knows nothing of painting."""
