"""Loops of `frames.pixel_to_map` for the CPU, compiled by numba.

`frames.pixel_to_map_plainly` computes the same with PyTorch.
"""

import math

from numba import njit


@njit(cache=True)
def place(strokes, metres, affine):  # type: ignore[no-untyped-def]
    """Computes affine maps [n, 2, 3] from canvas pixels to map cells, into `affine`.

    strokes: position [n, 2] and angle [n]
    metres: four pairs (x, y) in the precision of the strokes: centre of pixel (0, 0) on the canvas, pixel
    pitch, left and top of the map, cell pitch
    """
    (position, angle), (corner, pitch, edge, cell) = strokes, metres
    half = angle.dtype.type(0.5)
    for i in range(len(angle)):
        cos, sin = math.cos(angle[i]), math.sin(angle[i])
        x, y = corner[0] - position[i, 0], corner[1] - position[i, 1]
        # Rotates back by the stroke's angle, then converts to cells. The map's rows point down, so y flips once more.
        affine[i, 0, 0], affine[i, 0, 1] = cos * (pitch[0] / cell[0]), -sin * (pitch[1] / cell[0])
        affine[i, 0, 2] = (cos * x + sin * y - edge[0]) / cell[0] - half
        affine[i, 1, 0], affine[i, 1, 1] = sin * (pitch[0] / cell[1]), cos * (pitch[1] / cell[1])
        affine[i, 1, 2] = (sin * x - cos * y + edge[1]) / cell[1] - half


@njit(cache=True)
def pull_back(strokes, metres, to_affine, to_strokes):  # type: ignore[no-untyped-def]
    """Computes gradients of positions [n, 2] and angles [n], into `to_strokes`, from gradients of the affine maps."""
    (position, angle), (corner, pitch, _, cell) = strokes, metres
    to_position, to_angle = to_strokes
    for i in range(len(angle)):
        cos, sin = math.cos(angle[i]), math.sin(angle[i])
        x, y = corner[0] - position[i, 0], corner[1] - position[i, 1]
        a, b, c = to_affine[i, 0, 0] / cell[0], to_affine[i, 0, 1] / cell[0], to_affine[i, 0, 2] / cell[0]
        d, e, f = to_affine[i, 1, 0] / cell[1], to_affine[i, 1, 1] / cell[1], to_affine[i, 1, 2] / cell[1]
        to_position[i, 0], to_position[i, 1] = -(cos * c + sin * f), cos * f - sin * c
        turned = cos * (pitch[0] * d - pitch[1] * b) - sin * (pitch[0] * a + pitch[1] * e)
        to_angle[i] = turned - c * (sin * x - cos * y) + f * (cos * x + sin * y)
