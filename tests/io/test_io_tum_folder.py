from dataclasses import replace

import cv2
import numpy as np
import pytest

from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.io.bag import open_recording


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "rgb").mkdir()
    lines = ["# timestamp filename"]
    for i in range(4):
        cv2.imwrite(str(tmp_path / f"rgb/{i:06d}.png"), np.full((20, 30), 10 * i, np.uint8))
        lines.append(f"{0.1 * i:.6f} rgb/{i:06d}.png")
    (tmp_path / "rgb.txt").write_text("\n".join(lines) + "\n\n")
    return tmp_path


def test_images_in_order_with_exact_stamps(folder):
    recording = open_recording(folder)
    frames = list(recording.frames())
    assert [(f.stamp_ns, int(f.image[0, 0])) for f in frames] == [(i * 10**8, 10 * i) for i in range(4)]
    assert (recording.camera, recording.odometry, recording.ground_truth) == (None, [], [])


def test_calibration_truth_and_odometry_beside_the_images(folder):
    (folder / "camera.json").write_text('{"width":30,"height":20,"fx":25,"fy":26,"cx":14,"cy":9,"dist":[0.1,0,0,0,0]}')
    (folder / "groundtruth.txt").write_text("0.2 1 2 3 0 0 0 1\n0.1 0 0 0 0 0 0 1\n")
    (folder / "odometry.txt").write_text("0.0 0 0 0 0 0 0 1\n0.1 0.02 0 0 0 0 0 1\n")
    recording = open_recording(folder)
    assert (recording.camera.fy, recording.camera.distortion[0]) == (26.0, 0.1)
    assert [p.stamp_ns for p in recording.ground_truth] == [10**8, 2 * 10**8]
    assert recording.odometry[1].v == pytest.approx(0.2)


def test_images_that_are_missing_or_damaged_are_named_and_cost_no_other(folder):
    said: list[str] = []
    (folder / "rgb/000002.png").unlink()
    (folder / "rgb/000001.png").write_bytes(b"")
    recording = replace(open_recording(folder), tell=said.append)
    assert [f.stamp_ns for f in recording.frames()] == [0, 3 * 10**8]
    [told] = said
    assert f"{folder}: 2 of 4 images left out, as they cannot be used; the first: image {folder}/rgb/000001.png" in told
    for left in ("000000", "000003"):
        (folder / f"rgb/{left}.png").unlink()
    with pytest.raises(InputError, match=r"of the first 4 images none can be used: .*000000\.png.*No such file"):
        list(recording.frames())


def test_odometry_of_another_clock_or_unwanted_is_not_used(folder):
    (folder / "odometry.txt").write_text("90.0 0 0 0 0 0 0 1\n90.3 0.02 0 0 0 0 0 1\n")
    recording = open_recording(folder)
    assert recording.odometry == []
    assert "odometry of odometry.txt is not used, as 0 of 4 images have any: its stamps are from 90" in recording.damage
    (folder / "odometry.txt").write_text("what is this\n")
    with pytest.raises(InputError, match=r"odometry\.txt, line 1"):
        open_recording(folder)
    assert open_recording(folder, odometry_topic="none").damage == ""


def test_odometry_of_what_flies_is_not_that_of_wheels(folder):
    (folder / "odometry.txt").write_text("".join(f"{0.1 * k} 0 0 {0.2 * k} 0 0 0 1\n" for k in range(4)))
    recording = open_recording(folder)
    assert recording.odometry == []
    assert "odometry.txt is not used: 2 of 4 poses are none of wheels" in recording.damage


@pytest.mark.parametrize(("text", "message"), [("", "lists no image"), ("now rgb/0.png\n", "line 1: expected")])
def test_a_wrong_index_is_refused(folder, text, message):
    (folder / "rgb.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        open_recording(folder)


@pytest.mark.parametrize("separator", ["\t", "   ", ",", ", "])
def test_the_index_may_have_other_separators(folder, separator):
    text = (folder / "rgb.txt").read_text()
    (folder / "rgb.txt").write_text(text.replace(" rgb/", f"{separator}rgb/"))
    assert [f.stamp_ns for f in open_recording(folder).frames()] == [i * 10**8 for i in range(4)]


@pytest.mark.parametrize("first_ns", [1_403_636_579_763_555_584, 0])
def test_stamps_in_nanoseconds_are_one_sentence(folder, first_ns):
    lines = [f"{first_ns + i * 10**8} rgb/{i:06d}.png" for i in range(4)]
    (folder / "rgb.txt").write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"rgb\.txt.*stamps? in seconds"):
        open_recording(folder)


def test_a_folder_of_something_else_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"no rgb\.txt"):
        open_recording(tmp_path)
    with pytest.raises(InputError, match="there is no"):
        open_recording(tmp_path / "absent")


def test_wrong_calibration_beside_the_images_is_named(folder):
    (folder / "camera.json").write_text('{"width":30}')
    with pytest.raises(CalibrationError, match=r"camera\.json.*'fx' is missing.*or give another with --calibration"):
        open_recording(folder)
    assert open_recording(folder, own_camera=False).camera is None


def test_lines_that_are_swapped_are_sorted_and_doubled_ones_told(folder):
    lines = (folder / "rgb.txt").read_text().splitlines()
    said: list[str] = []
    (folder / "rgb.txt").write_text("\n".join([lines[1], lines[3], lines[2], lines[2], lines[4]]))
    recording = replace(open_recording(folder), tell=said.append)
    assert [f.stamp_ns for f in recording.frames()] == [i * 10**8 for i in range(4)]
    assert said == [f"{folder}: 1 of 5 images left out: their stamps are those of others or out of order"]


def test_files_of_a_windows_editor_are_read(folder):
    texts = {
        "rgb.txt": (folder / "rgb.txt").read_text().partition("\n")[2],
        "groundtruth.txt": "0.1 0 0 0 0 0 0 1\n",
        "odometry.txt": "0.0 0 0 0 0 0 0 1\n0.1 0.02 0 0 0 0 0 1\n",
        "camera.json": '{"width":30,"height":20,"fx":25,"fy":26,"cx":14,"cy":9,"dist":[0.1,0,0,0,0]}',
    }
    for name, text in texts.items():
        (folder / name).write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    recording = open_recording(folder)
    assert [frame.stamp_ns for frame in recording.frames()] == [i * 10**8 for i in range(4)]
    assert (recording.camera.fy, len(recording.ground_truth), len(recording.odometry)) == (26.0, 1, 2)
