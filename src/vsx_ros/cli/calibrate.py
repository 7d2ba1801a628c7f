"""``vsx calibrate``, and the camera from pictures of a board."""

import argparse
import dataclasses
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from vsx_ros.arrays import GrayImage
from vsx_ros.calibration.board import Board
from vsx_ros.calibration.camera import BoardView, ViewChooser, calibrate_camera
from vsx_ros.cli.calibrate_drives import calibrate_mount_of, calibrate_odometry
from vsx_ros.cli.calibrate_shutter import calibrate_shutter
from vsx_ros.cli.option_values import refuse
from vsx_ros.cli.recorded_drive import good_enough
from vsx_ros.errors import CalibrationError, ConfigError, InputError, explained
from vsx_ros.io.bag import open_recording
from vsx_ros.io.bag_reader import is_bag_folder
from vsx_ros.io.calibration_file import read_calibration, write_calibration
from vsx_ros.io.image_encoding import GrayImages
from vsx_ros.io.recording import NO_ODOMETRY
from vsx_ros.limits import LOG_BYTES, file_bytes
from vsx_ros.runs.parameters import ros_home
from vsx_ros.runs.process import DONE, FAILED
from vsx_ros.runs.start import told

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff")
MAX_SEARCHED = 150  # pictures of a recording, to save time; the chooser keeps 40 at most


def calibrate(args: argparse.Namespace) -> int:
    """Run one of the verbs."""
    drives = {"odometry": calibrate_odometry, "mount": calibrate_mount_of, "shutter": calibrate_shutter}
    if args.verb in drives:
        return drives[args.verb](args)
    if args.live == bool(args.input):
        raise ConfigError("give pictures, a folder or a bag, or else --live for the running camera node")
    board = Board.parse(args.board, args.pattern)
    if not args.live:
        return _from_pictures(args, board)
    refuse(args, "with --live the camera's node stores the result by its own name", "name", "out", "image_topic")
    from vsx_ros.ros.calibrate_camera import calibrate

    return calibrate(board, args.model)


def _from_pictures(args: argparse.Namespace, board: Board) -> int:
    """Find the board and calibrate."""
    name = args.name or "camera"
    out: Path = args.out or ros_home() / "camera_info" / f"{name}.yaml"
    views, searched, size = list[BoardView](), 0, None
    for source in args.input:
        if not source.exists():
            raise InputError(f"there is no {source}; give pictures, a folder of pictures, or a bag")
        film, chooser = _is_recording(source), None
        for picture, image in _pictures(source, args.image_topic):
            searched += 1
            if size is not None and image.shape != size:
                sizes = f"{image.shape[1]}x{image.shape[0]} but others are {size[1]}x{size[0]}"
                raise InputError(f"{picture} is {sizes}; give one camera's alone")
            size = image.shape
            chooser = chooser or ViewChooser(board, size[1], size[0])
            pixels = board.find(image, quick=film)
            if pixels is not None and (not film or chooser.offer(BoardView(picture, pixels))):
                views.append(BoardView(picture, pixels))
    if size is None:
        given = ", ".join(map(str, args.input))
        raise InputError(f"there is no picture in {given}; give {' '.join(PICTURES)} or a bag")
    result = calibrate_camera(board, views, size[1], size[0], args.model)
    print(f"the board is in {len(views)} of {searched} pictures that were searched", *result.report(), sep="\n  ")
    if not good_enough(result.verdict, out):
        return FAILED
    with explained(CalibrationError, f"{out} cannot be written", "give another file with --out", OSError):
        out.parent.mkdir(parents=True, exist_ok=True)
        camera = result.camera
        with suppress(CalibrationError):  # a board does not show the shutter: keep values written there by hand
            camera = dataclasses.replace(camera, shutter=read_calibration(out).shutter)
        write_calibration(out, camera, name, result.remark())
    print(f"written: {out}", f"for a node: camera_info_url:=file://{out.resolve()}", sep="\n  ")
    return DONE


def _is_recording(source: Path) -> bool:
    return (
        (source / "rgb.txt").exists()
        or is_bag_folder(source)
        or (source.is_file() and source.suffix.lower() not in PICTURES)
    )


def _pictures(source: Path, image_topic: str | None) -> Iterator[tuple[str, GrayImage]]:
    """Name and picture; at most ``MAX_SEARCHED`` of a recording, evenly spread."""
    if _is_recording(source):
        recording = told(open_recording(source, image_topic, NO_ODOMETRY, own_camera=False))
        step = -(-recording.frame_count // MAX_SEARCHED)
        for number, frame in enumerate(recording.frames()):
            if number % step == 0:
                yield f"image {number} of {source}", frame.image
        return
    files = [source] if source.is_file() else sorted(p for p in source.iterdir() if p.suffix.lower() in PICTURES)
    gray = GrayImages()
    for file in files:
        with explained(InputError, f"picture {file} cannot be read", "give another one"):
            content = file_bytes(file, LOG_BYTES)
        yield str(file), gray.of_file(content, f"picture {file}")
