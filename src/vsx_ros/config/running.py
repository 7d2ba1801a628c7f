"""Parameters of runs: calibration while driving, docking, what they store, and what computing costs in lock-step."""

from typing import Annotated

from msgspec import Meta

from vsx_ros.config.maps import Branch, Count, NonNegative, Positive, Ratio


class SelfCalibrationConfig(Branch, frozen=True):
    """Calibration of wheels and gyro while driving. Their values are used unchanged until the images contradict them by
    apply_sigmas and by a share of the distance or turn (apply_ratio) or a rate (apply_zero_rad_s). Below that, a
    correction would cost a calibrated robot more than it gains. From then on the values found are applied. A value with
    a standard deviation above its max_*_sigma* is not reported. Turns are measured relative to the camera's focal
    length, distances relative to its height."""

    enabled: bool = False  # a calibrated robot maps better without
    focal_sigma_ratio: Positive = 0.002
    mount_height_sigma_m: Positive = 0.003
    apply_sigmas: Annotated[float, Meta(ge=1)] = 3.0
    apply_ratio: NonNegative = 0.03
    apply_zero_rad_s: NonNegative = 0.004
    max_way_sigma: Positive = 0.02
    max_turn_sigma: Positive = 0.01
    max_zero_sigma_rad_s: Positive = 0.004


class DockingConfig(Branch, frozen=True):
    """Docking by the light of the dock. The remembered dock is off by remembered_sigma_*; after a try without contact,
    the estimate is doubted by doubt_*. sweep_rad: so far it looks to each side first. battery_h: how long a battery
    lasts, until that is measured. With return_to_charge the robot is back at its dock when reserve_ratio of the battery
    and reserve_s are left; it goes on at charged_ratio."""

    v_m_s: Annotated[float, Meta(gt=0, le=0.2)] = 0.12
    creep_m_s: Annotated[float, Meta(gt=0, le=0.1)] = 0.05
    omega_rad_s: Annotated[float, Meta(ge=0.2, le=1)] = 0.5
    sweep_rad: Annotated[float, Meta(gt=0, le=3)] = 0.9
    remembered_sigma_m: Positive = 0.15
    remembered_sigma_rad: Positive = 0.25
    doubt_m: NonNegative = 0.005
    doubt_rad: NonNegative = 0.02
    tries: Count = 9
    back_off_m: Positive = 0.35
    undock_m: Positive = 0.45
    return_to_charge: bool = True
    battery_h: Positive = 2.5
    reserve_ratio: Ratio = 0.12
    reserve_s: NonNegative = 180.0
    charged_ratio: Annotated[float, Meta(gt=0, le=1)] = 0.95


class RunsConfig(Branch, frozen=True):
    """The run folder: how often the map is written, so that an interrupted run can continue, and how often a small
    camera picture and the ground map are kept for the report; 0 keeps none. In a long run they become rarer."""

    checkpoint_s: Positive = 5.0
    moments_s: NonNegative = 1.0


class ComputingConfig(Branch, frozen=True):
    """Computing time in lock-step, in emulated time: of a frame, from its stamp until its pose is known; of a ranking
    of views, at least and per area of known ground; of a plan, at least and per metre of the path. The values are twice
    the processor time that benchmarks/computing.py measures: on a laptop with two cores SLAM runs on them, too."""

    frame_ms: NonNegative = 60.0
    ranking_ms: NonNegative = 60.0
    ranking_ms_m2: NonNegative = 1.3
    plan_ms: NonNegative = 40.0
    plan_ms_m: NonNegative = 11.0
