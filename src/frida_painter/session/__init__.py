"""A painting session: the closed loop (start reading in loop.py) and what it needs."""
