from pathlib import Path

import numpy as np
import pytest

from vsx_ros.io.recording import Recording
from vsx_ros.robot import Frame
from vsx_ros.runs.start import told


def test_what_is_damaged_or_left_out_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    frames = [Frame(stamp_ns, np.zeros((2, 2), np.uint8)) for stamp_ns in (1, 2, 2)]
    recording = told(
        Recording(
            source=Path("a.bag"),
            image_topic=None,
            odometry_topic=None,
            frame_count=3,
            camera=None,
            odometry=[],
            ground_truth=[],
            open_frames=lambda: iter(frames),
            damage="a.bag is cut short",
        )
    )
    for _ in range(2):
        assert len(list(recording.frames())) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "vsx: a.bag is cut short"
    assert said[1:] == ["vsx: a.bag: 1 of 3 images left out: their stamps are those of others or out of order"]
