"""Parameters of driving: its limits, planning and following."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from vsx_ros.config.maps import Branch, Count, FieldOfView, NonNegative, Positive

LEAST_PHI_RAD_M = 0.01


class LimitsConfig(Branch, frozen=True):
    """Limits of the time scaling and the follower; their bounds are about what the bases can do. a_stop_m_s2 is for
    obstacles found too near for a_m_s2: a stop from 0.3 m/s takes 6 cm instead of 10. The bases can stop harder, as
    they do for a hazard, but then the images blur."""

    v_m_s: Annotated[float, Meta(ge=0.01, le=0.7)] = 0.3
    a_m_s2: Annotated[float, Meta(ge=0.01, le=3)] = 0.6
    jerk_m_s3: Annotated[float, Meta(ge=0.01, le=100)] = 4.0
    omega_rad_s: Annotated[float, Meta(ge=0.01, le=3.2)] = 0.6
    alpha_rad_s2: Annotated[float, Meta(ge=0.01, le=20)] = 2.0
    a_stop_m_s2: Annotated[float, Meta(ge=0.01, le=3)] = 1.0
    # Delay from a command to the wheels: 0.2 s of the base, the follower's period, a message.
    reaction_s: NonNegative = 0.3

    def braking(self, a_m_s2: float) -> LimitsConfig:
        """The limits while braking by a_m_s2. Harder braking also needs more jerk, and on bends more turn acceleration,
        as the turn rate falls with the speed."""
        share = max(1.0, a_m_s2 / self.a_m_s2)
        jerk, alpha = share * share * self.jerk_m_s3, share * self.alpha_rad_s2
        return msgspec.structs.replace(self, a_m_s2=share * self.a_m_s2, jerk_m_s3=jerk, alpha_rad_s2=alpha)


class PlannerConfig(Branch, frozen=True):
    """Motion planning (paper 4). sight_fov_rad: the view that counts; -1: the camera's by its calibration."""

    phi_rad_m: Annotated[float, Meta(ge=LEAST_PHI_RAD_M)] = 2.0
    # Clearance beside the body in the map, which may be 2 cm off: always kept, and kept where that is no detour.
    clearance_m: NonNegative = 0.07
    preferred_clearance_m: NonNegative = 0.15
    zone_margin_m: NonNegative = 0.05  # from closed zones, in addition: the map is a few centimetres off
    max_reverse_m: NonNegative = 1.5
    # What the tracker needs in view, how fast to drive where it is not, and how far at most in one go.
    sight_landmarks: Count = 20
    sight_fov_rad: FieldOfView = -1.0
    sight_range_m: Positive = 5.0
    blind_v_m_s: Annotated[float, Meta(ge=0.01)] = 0.2
    unmapped_v_m_s: Annotated[float, Meta(ge=0.01)] = 0.08  # before there is a map
    max_blind_m: NonNegative = 2.0
    # Costs as extra metres: of a cusp, of a stop where only the curvature jumps, of a metre driven blind. A drive with
    # the preferred clearance may take longer by a share, and by the time of a length.
    cusp_cost_m: NonNegative = 0.15
    stop_cost_m: NonNegative = 0.3
    blind_cost_ratio: NonNegative = 1.0
    detour_ratio: Annotated[float, Meta(ge=1)] = 1.2
    detour_m: NonNegative = 0.5

    @property
    def medium_clearance_m(self) -> float:
        """For gaps that are too narrow for the preferred clearance: rather through their middle [m]."""
        return 0.5 * (self.clearance_m + max(self.clearance_m, self.preferred_clearance_m))


class FollowerConfig(Branch, frozen=True):
    """Following a timed trajectory."""

    stiffness_rad_m: Positive = 5.0
    # Speed per metre behind the plan, and turn rate per radian while turning on the spot; 30 commands per second.
    along_gain_per_s: Annotated[float, Meta(gt=0, le=10)] = 1.5
    turn_gain_per_s: Annotated[float, Meta(gt=0, le=10)] = 2.0
    goal_slack_m: NonNegative = 0.004
    max_lateral_error_m: Positive = 0.12
    max_heading_error_rad: Positive = 0.25
    pose_timeout_s: Positive = 0.5
    # Speed while tracking is dubious (state POOR), as a share of the planned speed, and how long it stays so after.
    dubious_speed_factor: Annotated[float, Meta(gt=0, le=1)] = 0.5
    dubious_hold_s: NonNegative = 0.5
    # How long the base waits on its way for something that is not in the map and hides it ahead, such as a person.
    hidden_wait_s: Annotated[float, Meta(ge=0, le=60)] = 3.0
    replans_after_divergence: Annotated[int, Meta(ge=0)] = 2
