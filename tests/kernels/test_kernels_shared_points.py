"""Points that keyframes share are counted as the product of who sees what says."""

import numpy as np

from vsx_ros.kernels.slam.pose_graph import count_shared


def test_each_two_keyframes_share_what_both_see():
    rng = np.random.default_rng(5)
    sees = rng.random((30, 400)) < 0.1
    sees[7] = False
    rows = np.concatenate([np.flatnonzero(mine) for mine in sees])
    shared = count_shared(rows, np.cumsum(sees.sum(axis=1)), sees.shape[1])
    assert (shared == sees.astype(int) @ sees.T.astype(int)).all()


def test_nobody_shares_nothing():
    assert count_shared(np.zeros(0, np.int64), np.zeros(3, np.int64), 0).tolist() == [[0] * 3] * 3
