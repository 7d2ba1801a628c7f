"""Parameters of runs: what they store, and what computing costs in lock-step."""

from vsx_ros.config.maps import Branch, NonNegative, Positive


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
