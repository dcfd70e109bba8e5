"""The map from where the robot was sent to where its paint is, fitted to a few places at which both are known."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import CalibrationError

FEWEST = 8
"""Places that a fit takes at least."""
_SINGULAR = 0.2  # by which areas may shrink, or their inverse grow
_OUTLYING = 3.5  # times the usual distance
_ROUNDS = 5


@dataclass(frozen=True)
class Fit:
    """A homography [3, 3] of canvas metres, scaled so that its last number is 1.

    kind: "similarity", "affine" or "homography", what it is a special case of; off [n]: how far, in
    metres, it leaves each place it was fitted to; used [n]: which it was fitted to.
    """

    matrix: NDArray[np.float64]
    kind: str
    off: NDArray[np.float64]
    used: NDArray[np.bool_]

    @property
    def residual(self) -> float:
        """Root mean square of the distances that are left, metres."""
        return float(np.sqrt(np.mean(self.off[self.used] ** 2)))

    def inverse(self) -> NDArray[np.float64]:
        """The way back, [3, 3], its last number 1."""
        back = np.linalg.inv(self.matrix)
        return back / back[2, 2]


def apply(matrix: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where a homography [3, 3] takes places [n, 2]."""
    homogeneous = np.c_[places, np.ones(len(places))] @ matrix.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


def fit_homography(meant: NDArray[np.float64], seen: NDArray[np.float64]) -> Fit:
    """The homography that takes places `meant` [n, 2] nearest to where they are `seen` [n, 2].

    A robot that merely stands askew needs four numbers, and a homography fitted to noisy dots makes
    up the other four; so of similarity, affine map and homography the one with the least corrected
    information criterion is taken (N. Sugiura, 1978). Places far off the rest are left out.
    Raises CalibrationError where there are too few, or the fit is singular or mirrored.
    """
    there = np.asarray(np.isfinite(meant).all(1) & np.isfinite(seen).all(1), bool)
    fit = _simplest(meant, seen, there)
    for _ in range(_ROUNDS):
        usual = max(float(np.median(fit.off[fit.used])), 1e-9)
        used = np.asarray(there & (fit.off <= _OUTLYING * usual), bool)
        if used.sum() < FEWEST or (used == fit.used).all():
            break
        fit = _simplest(meant, seen, used)
    _refuse_impossible(fit.matrix, meant[fit.used])
    return fit


def _simplest(meant: NDArray[np.float64], seen: NDArray[np.float64], used: NDArray[np.bool_]) -> Fit:
    if not used.sum() >= FEWEST:
        raise CalibrationError(
            f"A placement was to be fitted to {used.sum()} places; {FEWEST} are needed. Repeat the robot calibration."
        )
    fits = []
    numbers = 2 * int(used.sum())
    for kind, freedom, fitted in (("similarity", 4, _similarity), ("affine", 6, _affine), ("homography", 8, _full)):
        matrix = fitted(meant[used], seen[used])
        off = np.linalg.norm(apply(matrix, meant) - seen, axis=1)
        variance = max(float(np.mean(off[used] ** 2)) / 2, 1e-18)
        unknowns = freedom + 1
        correction = 2 * unknowns * (unknowns + 1) / max(numbers - unknowns - 1, 1)
        fits.append((numbers * np.log(variance) + 2 * unknowns + correction, Fit(matrix, kind, off, used)))
    return min(fits, key=lambda scored: scored[0])[1]


def _similarity(meant: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """The best similarity; it may be mirrored, which is refused afterwards (S. Umeyama, 1991)."""
    middle, there = meant.mean(0), seen.mean(0)
    u, stretch, vt = np.linalg.svd((seen - there).T @ (meant - middle))
    scale = stretch.sum() / max(float(((meant - middle) ** 2).sum()), 1e-18)
    matrix = np.eye(3)
    matrix[:2, :2] = scale * u @ vt
    matrix[:2, 2] = there - matrix[:2, :2] @ middle
    return matrix


def _affine(meant: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    columns = np.c_[meant, np.ones(len(meant))]
    matrix = np.eye(3)
    matrix[:2] = np.linalg.lstsq(columns, seen, rcond=None)[0].T
    return matrix


def _full(meant: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    matrix, _ = cv2.findHomography(meant, seen, 0)
    if matrix is None or not abs(matrix[2, 2]) > 1e-9:
        return _affine(meant, seen)
    return np.asarray(matrix / matrix[2, 2], np.float64)


def _refuse_impossible(matrix: NDArray[np.float64], places: NDArray[np.float64]) -> None:
    """Raises CalibrationError where the map folds, flattens or mirrors the canvas around the places."""
    low, high = places.min(0), places.max(0)
    around = np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])])
    depth = np.c_[around, np.ones(4)] @ matrix[2]
    # The determinant of a homography's derivative at a place is its own over the depth cubed.
    area = np.linalg.det(matrix) / np.where(depth > 0, depth, np.nan) ** 3
    spread = np.linalg.svd(places - places.mean(0), compute_uv=False)
    if not spread[-1] > 0.05 * spread[0]:
        raise CalibrationError(
            "The dots that were found lie on one line, which tells nothing about the rest of the canvas; "
            "repeat the robot calibration."
        )
    if (area <= -_SINGULAR).any():  # the sign of one that is flat is chance
        raise CalibrationError(
            "The robot paints mirrored: one of its axes runs the other way than the workspace says. Mend the "
            "workspace, then repeat the robot calibration."
        )
    if not ((area >= _SINGULAR) & (area <= 1 / _SINGULAR)).all():
        raise CalibrationError(
            "The fitted placement is singular: it folds or flattens the canvas. Look whether the dots on the canvas "
            "are where they should be, then repeat the robot calibration."
        )
