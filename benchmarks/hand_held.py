"""Hand-held six-axis motion through generated labs: where the SLAM starts without odometry, and how well it continues.

    PYTHONPATH=src:hw python benchmarks/hand_held.py [starts] [never] [--seeds 100-139] [--each]

The camera is the emulator's Kinect, at 30 Hz, held at 0.7 to 1.5 m; its motion is smooth and random, 0.3 degrees
and 0.7 cm from frame to frame (root mean square). ``starts``: clips of 3 s. It prints the starts, the direction error
of their first baseline, and the maps that collapse. In those, over a second or more, the error of the live poses of
GOOD frames (aligned with scale) exceeds half of the path's extent. ``never``: the camera turns by more than 10 px but
stays within 0.5 % of the depth: every start is wrong. Seeds 0 to 49 are for tuning.
"""

import argparse
import math
from typing import NamedTuple

import numpy as np
from seeds import seed_range
from slam_recordings import direction_deg

from vsx_ros.arrays import FloatArray
from vsx_ros.config import Config, MountConfig
from vsx_ros.evaluation.trajectory import trajectory_error
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Frame
from vsx_ros.sim.camera import CameraSettings, EmulatedCamera
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.optics import scene_of
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState

RATE_HZ = 30.0
TURN_RAD, STEP_M = math.radians(0.3), 0.007  # from frame to frame
WAVES_HZ = (0.25, 1.2)  # how fast a hand sways
STARTS_S, NEVER_S = 3.0, 1.5
NEAR_RATIO, LEAST_TURN_RAD = 0.005, math.radians(1.2)  # of the depth; 1.2 degrees are 11 px
COLLAPSED_RATIO, COLLAPSED_FRAMES = 0.5, 30


class Sway(NamedTuple):
    """A smooth random motion: waves (W, 6) amplitudes, phases, and (W,) frequencies [rad/s]; metres and radians."""

    amplitude: FloatArray
    phase: FloatArray
    omega: FloatArray

    @staticmethod
    def drawn(rng: np.random.Generator) -> "Sway":
        omega = 2.0 * math.pi * rng.uniform(*WAVES_HZ, 5)
        speed = rng.standard_normal((5, 6)) * np.repeat([STEP_M, TURN_RAD], 3) * RATE_HZ * math.sqrt(2.0 / 15.0)
        return Sway(speed / omega[:, None], rng.uniform(0.0, 2.0 * math.pi, (5, 6)), omega)

    def at(self, seconds: FloatArray) -> FloatArray:
        """(N, 6) translation and rotation vector since 0."""
        angle = self.omega[None, :, None] * seconds[:, None, None] + self.phase
        return np.asarray((self.amplitude * (np.sin(angle) - np.sin(self.phase))).sum(axis=1))

    def held_still(self, reach_m: float, seconds: FloatArray) -> "Sway":
        """The same motion, with the translation within ``reach_m`` of its start."""
        far = np.linalg.norm(self.at(seconds)[:, :3], axis=1).max()
        return self._replace(amplitude=self.amplitude * np.repeat([reach_m / far, 1.0], 3))


class HeldCamera(EmulatedCamera):
    """The emulated camera in a hand. T_world_cam: at 0 s; sway: motion since then, in the camera's frame."""

    def __init__(self, seed: int, settings: CameraSettings) -> None:
        world, rng = generate_world("lab", seed), np.random.default_rng([seed, 77])
        mount = MountConfig(height_m=float(rng.uniform(0.7, 1.5)), pitch_down_rad=float(rng.uniform(-0.1, 0.4)))
        super().__init__(scene_of(world), mount, settings, rng)
        self.T_world_cam = SE3.from_se2(world.start_pose) @ self.T_base_cam_true
        self.sway = Sway.drawn(rng)

    def poses_at(self, stamps_ns: FloatArray) -> FloatArray:
        """(N, 6) ``sway`` at these stamps."""
        return self.sway.at(np.asarray(stamps_ns) * 1e-9)

    def poses_cam(self, base: FloatArray) -> tuple[FloatArray, FloatArray]:
        poses = [self.T_world_cam @ SE3(SE3.exp(np.r_[0.0, 0.0, 0.0, v[3:]]).rotation, v[:3]) for v in base]
        return np.array([T.rotation for T in poses]), np.array([T.translation for T in poses])

    def stamps_ns(self, seconds: float) -> list[int]:
        return [round(k * 1e9 / RATE_HZ) for k in range(1, round(seconds * RATE_HZ) + 1)]

    def true_pose(self, stamp_ns: int) -> SE3:
        R, t = self.poses_cam(self.poses_at(np.array([stamp_ns])))
        return SE3(R[0], t[0])


class Clip(NamedTuple):
    camera: PinholeCamera
    frames: list[Frame]
    truth: dict[int, SE3]


def clip(seed: int, seconds: float, never: bool, settings: CameraSettings) -> Clip:
    held = HeldCamera(seed, settings)
    stamps = held.stamps_ns(seconds)
    if never:
        depth = held.picture(0, held.poses_at, want_depth=True).depth
        held.sway = held.sway.held_still(NEAR_RATIO * float(np.median(depth)), np.array(stamps) * 1e-9)
        turn = np.linalg.norm(held.poses_at(np.array(stamps))[:, 3:], axis=1).max()
        held.sway = held.sway._replace(amplitude=held.sway.amplitude * max(1.0, LEAST_TURN_RAD / turn))
        held.sway = held.sway.held_still(NEAR_RATIO * float(np.median(depth)), np.array(stamps) * 1e-9)
    frames = [Frame(ns, held.render_gray(ns, held.poses_at)) for ns in stamps]
    return Clip(held.camera_given, frames, {ns: held.true_pose(ns) for ns in stamps})


class Outcome(NamedTuple):
    """began: frame of the first start, None without one; direction_deg: its error; restarted: number of restarts.
    collapsed: whether the GOOD frames of any map collapse (see above)."""

    began: int | None
    direction_deg: float
    restarted: int
    good: int
    ate_ratio: float
    collapsed: bool


def outcome(made: Clip) -> Outcome:
    slam = SequentialSlam(made.camera, None, Config().slam, 1)
    began, off_deg, maps, events = None, math.nan, [[]], []
    for k, frame in enumerate(made.frames):
        result = slam.track(frame)
        events += slam.drain_events()
        if result.T_world_cam is None:
            maps += [[]] if maps[-1] else []
            continue
        if result.state is TrackingState.GOOD:
            maps[-1].append((result.T_world_cam, made.truth[frame.stamp_ns]))
        if began is None:
            began, seen = k, slam.snapshot()
            off_deg = direction_deg(seen.T_world_cams[:2], [made.truth[int(ns)] for ns in seen.keyframe_stamps_ns[:2]])
    ratios = [(_error_ratio(pairs), len(pairs)) for pairs in maps if len(pairs) >= 3]
    collapsed = any(ratio > COLLAPSED_RATIO and n >= COLLAPSED_FRAMES for ratio, n in ratios)
    restarted = sum(event.kind == "restarted" for event in events)
    worst = max((ratio for ratio, _ in ratios), default=math.nan)
    return Outcome(began, off_deg, restarted, sum(n for _, n in ratios), worst, collapsed)


def _error_ratio(pairs: list[tuple[SE3, SE3]]) -> float:
    """ATE divided by the extent of the true path."""
    way = np.array([truth.translation for _, truth in pairs])
    extent = math.sqrt(float(np.square(way - way.mean(axis=0)).sum(axis=1).mean()))
    return trajectory_error(pairs, "sim3").ate_rmse_m / max(extent, 1e-6)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", default=["starts", "never"])
    parser.add_argument("--seeds", type=seed_range, default=seed_range("100-139"))
    parser.add_argument("--global-shutter", action="store_true", help="all rows are exposed at once")
    parser.add_argument("--each", action="store_true", help="also a line for every clip")
    args = parser.parse_args()
    settings = CameraSettings(readout_ns=0) if args.global_shutter else CameraSettings()
    for section in args.sections:
        never, found = section == "never", dict[int, Outcome]()
        for seed in args.seeds:
            found[seed] = outcome(clip(seed, NEVER_S if never else STARTS_S, never, settings))
            if args.each:
                print(seed, found[seed], flush=True)
        begun = [o for o in found.values() if o.began is not None]
        line = f"{section}: {len(begun)} of {len(found)} clips start"
        if begun and not never:
            frames, off = np.array([o.began for o in begun]), np.array([o.direction_deg for o in begun])
            line += (
                f", after {np.median(frames) / RATE_HZ:.1f} s in the median and {frames.max() / RATE_HZ:.1f} s at most"
            )
            line += f"; direction off by {np.median(off):.1f} deg, at most {off.max():.1f}"
            line += f"; begun again {sum(o.restarted for o in begun)}; collapsed {sum(o.collapsed for o in begun)}"
        print(line, flush=True)


if __name__ == "__main__":
    main()
