"""Two import roots: vsx_ros from src/ and vsx_hw from hw/. No `scripts=`: rosrun finds scripts/ by itself."""

from pathlib import Path

from setuptools import find_packages, setup

HERE = Path(__file__).parent
VERSION = (HERE / "src/vsx_ros/version.txt").read_text(encoding="utf-8").strip()

setup(
    name="vsx_ros",
    version=VERSION,
    description="A TurtleBot with one ordinary camera explores and maps a building by itself (ROS 1, rospy)",
    long_description=(HERE / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="BSD-3-Clause",
    python_requires=">=3.10",
    package_dir={"vsx_ros": "src/vsx_ros", "vsx_hw": "hw/vsx_hw"},
    packages=find_packages("src") + find_packages("hw", include=["vsx_hw*"]),
    package_data={
        "vsx_ros": [
            "version.txt",
            "py.typed",
            "evaluation/scrubber.html",
            "ros/dashboard/page/*",
            "ros/python_logging.conf",
        ],
        "vsx_hw": ["py.typed"],
    },
    entry_points={"console_scripts": ["vsx=vsx_ros.cli.main:main"]},
    install_requires=[
        "numpy>=2",
        "numba>=0.60",
        "opencv-python-headless>=4.5,<5",
        "scipy>=1.8",
        "daqp>=0.7",
        "ruckig>=0.14",
        "rosbags>=0.11",
        "apsw>=3.46",
        "lz4>=4",
        'backports.zstd>=1; python_version < "3.14"',
        "pyserial>=3.5",
        "libusb1>=2",
        "msgspec>=0.18",
        "PyYAML>=5.4",
        "shtab>=1.7",
        "pycollada>=0.8",
        "trimesh>=4",
        "charset-normalizer>=3",
        "Pillow>=10",
    ],
    extras_require={"sweep": ["distributed>=2024.1"], "mitsuba": ["mitsuba>=3.6"]},
)
