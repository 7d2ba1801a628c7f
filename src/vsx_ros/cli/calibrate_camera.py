"""``vsx calibrate camera`` from pictures: files, folders, recordings."""

import argparse
from collections.abc import Iterator
from pathlib import Path

from vsx_ros.arrays import GrayImage
from vsx_ros.calibration.board import Board
from vsx_ros.calibration.camera import BoardView, calibrate_camera
from vsx_ros.calibration.variety import ViewChooser
from vsx_ros.calibration.verdict import Grade
from vsx_ros.errors import CalibrationError, InputError, explained
from vsx_ros.io.calibration_file import write_calibration
from vsx_ros.io.image_encoding import decoded
from vsx_ros.io.open_recording import open_recording
from vsx_ros.limits import LOG_BYTES, file_bytes
from vsx_ros.runs.exit_codes import DONE, FAILED
from vsx_ros.runs.robot_file import ros_home

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff")
MAX_SEARCHED = 150


def calibrate_from_pictures(args: argparse.Namespace) -> int:
    """Find the board, calibrate, say how good it is, write it unless it is bad."""
    board = Board.parse(args.board, args.pattern)
    out: Path = args.out or ros_home() / "camera_info" / f"{args.name}.yaml"
    views: list[BoardView] = []
    searched, size = 0, None
    for source in args.input:
        film, chooser = _is_recording(source), None
        for name, image in _pictures(source, args.image_topic):
            searched += 1
            if size is not None and image.shape != size:
                raise InputError(
                    f"{name} is {_text(image.shape)} but others are {_text(size)}; give one camera's alone"
                )
            size = image.shape
            chooser = chooser or ViewChooser(board, size[1], size[0])
            pixels = board.find(image, quick=film)
            if pixels is not None and (not film or chooser.offer(BoardView(name, pixels))):
                views.append(BoardView(name, pixels))
    if size is None:
        raise InputError(
            f"there is no picture in {', '.join(map(str, args.input))}; give {' '.join(PICTURES)} or a bag"
        )
    result = calibrate_camera(board, views, size[1], size[0])
    print(f"the board is in {len(views)} of {searched} pictures that were searched", *result.report(), sep="\n  ")
    print(result.verdict)
    if result.verdict.grade is Grade.BAD:
        print(f"  {out} is not written")
        return FAILED
    with explained(CalibrationError, f"{out} cannot be written", "give another file with --out", OSError):
        out.parent.mkdir(parents=True, exist_ok=True)
        write_calibration(out, result.camera, args.name, result.remark())
    print(f"written: {out}", f"for a node: camera_info_url:=file://{out.resolve()}", sep="\n  ")
    return DONE


def _is_recording(source: Path) -> bool:
    return (source / "rgb.txt").exists() or (source.is_file() and source.suffix.lower() not in PICTURES)


def _pictures(source: Path, image_topic: str | None) -> Iterator[tuple[str, GrayImage]]:
    """Name and picture; of a recording at most ``MAX_SEARCHED``, evenly spread."""
    if _is_recording(source) or not source.exists():
        recording = open_recording(source, image_topic)
        step = -(-recording.frame_count // MAX_SEARCHED)
        for number, frame in enumerate(recording.frames()):
            if number % step == 0:
                yield f"image {number} of {source}", frame.image
        return
    files = [source] if source.is_file() else sorted(p for p in source.iterdir() if p.suffix.lower() in PICTURES)
    for file in files:
        with explained(InputError, f"picture {file} cannot be read", "give another one"):
            content = file_bytes(file, LOG_BYTES)
        yield str(file), decoded(content, f"picture {file}")


def _text(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
