"""Files that stand for a machine's devices, below a folder of their own."""

from pathlib import Path

from vsx_ros.cli.check_machine import Finding

CAMERA_INFO = """image_width: 640
image_height: 480
camera_name: rgb
camera_matrix: {rows: 3, cols: 3, data: [525.0, 0, 319.5, 0, 525.0, 239.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""


def of(area: str, findings: list[Finding]) -> list[Finding]:
    return [finding for finding in findings if finding.area == area]


def usb(root: Path, place: str, product: str, node: int) -> None:
    entry = root / "sys/bus/usb/devices" / place
    entry.mkdir(parents=True)
    for name, content in (("idVendor", "045e"), ("idProduct", product), ("busnum", "1"), ("devnum", str(node))):
        (entry / name).write_text(f"{content}\n", encoding="utf-8")
    (root / "dev/bus/usb/001").mkdir(parents=True, exist_ok=True)
    (root / f"dev/bus/usb/001/{node:03d}").touch()


def video_node(root: Path, number: int) -> None:
    """Another camera, not on the USB."""
    entry = root / f"sys/class/video4linux/video{number}"
    entry.mkdir(parents=True)
    (entry / "name").write_text("bcm2835-isp\n", encoding="utf-8")
    (root / "dev").mkdir(exist_ok=True)
    (root / f"dev/video{number}").touch()


def webcam(root: Path) -> Path:
    """Plug one in; its device file."""
    entry, device = root / "sys/class/video4linux/video0", root / "sys/bus/usb/devices/1-1"
    entry.mkdir(parents=True)
    (entry / "name").write_text("UVC Camera\n", encoding="utf-8")
    usb(root, "1-1", "0825", 2)
    (device / "serial").write_text("A1B2\n", encoding="utf-8")
    (device / "1-1:1.0").mkdir()
    (entry / "device").symlink_to(device / "1-1:1.0")
    (root / "dev/video0").touch()
    return root / "dev/video0"
