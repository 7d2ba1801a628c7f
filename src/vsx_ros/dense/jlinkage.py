"""Clusters of points that prefer the same models, by J-linkage (Toldo and Fusiello, ECCV 2008), exactly."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.errors import InputError
from vsx_ros.kernels.dense.jlinkage import WORD, agglomerate

_MAX_WORDS = 65535 // WORD


def cluster(preferences: NDArray[np.uint64]) -> NDArray[np.int64]:
    """(N,) labels from 0, -1 for points that prefer no model.

    preferences: (N, W), bit h of a row set where the point prefers model h. Of equally near clusters those of smaller
    rows merge first, so that the order of the points does not matter. Labels are in the order of their first points.
    Raises InputError for rows of more than 65472 models or of another type.
    """
    preferences = np.asarray(preferences)
    if preferences.ndim != 2 or preferences.dtype != np.uint64 or preferences.shape[1] > _MAX_WORDS:
        raise InputError(
            f"preferences are {preferences.dtype} of shape {preferences.shape}; J-linkage takes (N, W) uint64 with "
            f"W <= {_MAX_WORDS}"
        )
    labels = np.full(len(preferences), -1, np.int64)
    willing = np.flatnonzero(preferences.any(axis=1))
    if not len(willing):
        return labels
    # Equal rows are at distance 0 and merge first; what is left has an order of its own.
    rows, inverse = np.unique(preferences[willing], axis=0, return_inverse=True)
    into = agglomerate(rows)
    while not np.array_equal(into, into[into]):
        into = into[into]
    _, first, found = np.unique(into[inverse.ravel()], return_index=True, return_inverse=True)
    labels[willing] = np.argsort(np.argsort(first))[found.ravel()]
    return labels
