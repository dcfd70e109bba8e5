"""The virtual studio: a simulated robot, brush, paint, canvas and camera, for whoever has none of them.

It stands for reality. It shares neither code nor figures with the renderer that is judged by it;
from outside it is an `Easel` like any other.
"""
