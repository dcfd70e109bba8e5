"""The exact transport between two clouds, by a linear programme."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog


def exact_transport(cost: NDArray[np.float64]) -> float:
    """The least cost at which equal weights of all rows become equal weights of all columns, cost [n, m]."""
    rows, columns = cost.shape
    leaving = np.kron(np.eye(rows), np.ones(columns))
    arriving = np.kron(np.ones(rows), np.eye(columns))
    weights = np.r_[np.full(rows, 1 / rows), np.full(columns, 1 / columns)]
    return float(linprog(cost.ravel(), A_eq=np.r_[leaving, arriving], b_eq=weights).fun)
