"""Painting session: the closed loop (start reading in loop.py) and its parts."""
