"""Virtual studio: a simulated robot, brush, paint, canvas and camera, for everybody who has none.

It stands for reality. It shares neither code nor constants with the renderer, which is tested against it. For the
painter it is an `Easel` like any other.
"""
