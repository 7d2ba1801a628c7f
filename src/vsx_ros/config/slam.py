"""Parameters of the SLAM (paper 3)."""

from vsx_ros.config.branch import Branch, Count, NonNegative, Positive, Ratio


class InitializationConfig(Branch, frozen=True):
    """Two-frame start of the map (paper 3.1). Without odometry the baseline gets unit_baseline_m, and only parallax
    tells whether it is long enough."""

    baseline_m: Positive = 0.20
    baseline_max_m: Positive = 0.6
    unit_baseline_m: Positive = 0.1
    min_matches: Count = 60
    min_parallax_deg: Positive = 0.7
    min_parallax_without_odometry_deg: Positive = 0.25
    max_turn_deg: Positive = 30.0  # more than the planner bends over the baseline (phi 2 rad/m)


class TrackerConfig(Branch, frozen=True):
    """Per-frame tracking."""

    max_points: Count = 800
    coarse_radius_px: Positive = 30.0
    fine_radius_px: Positive = 10.0
    good_ratio: Ratio = 0.3
    lost_ratio: Ratio = 0.13
    min_found: Count = 30
    lost_after_frames: Count = 3


class KeyframeConfig(Branch, frozen=True):
    """When a frame becomes a keyframe (paper 3.1: conservative where the map is already known)."""

    min_gap_frames: Count = 4
    distance_ratio: Positive = 0.06
    angle_deg: Positive = 8.0
    overlap_ratio: Ratio = 0.55


class MapperConfig(Branch, frozen=True):
    """Making, refining and removing points."""

    window_keyframes: Count = 8
    target_keyframes: Count = 3
    max_points_per_keyframe: Count = 400
    min_parallax_deg: Positive = 0.8
    local_iterations: Count = 10
    global_iterations: Count = 10


class CullingConfig(Branch, frozen=True):
    """A keyframe is redundant when that share of its points is seen by so many others from as near; the newest are
    kept. With 3 viewers, as ORB-SLAM has it, keyframes as near to each other as here are made again at once."""

    seen_ratio: Ratio = 0.9
    viewers: Count = 6
    keep_newest: Count = 10


class ShutterConfig(Branch, frozen=True):
    """How the camera exposes: its rows one after the other (0: all at once), each for so long. With odometry, images
    are freed from how the camera moves meanwhile. Defaults: the Kinect's colour camera indoors."""

    readout_s: NonNegative = 0.026
    exposure_s: NonNegative = 0.015


class OdometryNoiseConfig(Branch, frozen=True):
    """How far wheel odometry between keyframes is believed, per axis: a constant plus a share of the motion; and how
    far the base stands level on the floor. What is wrong with the wheels' diameter is wrong everywhere alike and
    becomes the world's size; what counts here is how unlike one stretch is to the next."""

    distance_sigma_m: Positive = 0.0003
    distance_sigma_ratio: Positive = 0.002
    sideways_sigma_ratio: Positive = 0.006
    turn_sigma_rad: Positive = 0.002
    turn_sigma_ratio: Positive = 0.01
    tilt_sigma_rad: Positive = 0.01
    floor_height_sigma_m: Positive = 0.01
    floor_tilt_sigma_rad: Positive = 0.02


class SlamConfig(Branch, frozen=True):
    """Keyframe SLAM (paper 3)."""

    initialization: InitializationConfig = InitializationConfig()
    tracker: TrackerConfig = TrackerConfig()
    keyframes: KeyframeConfig = KeyframeConfig()
    mapper: MapperConfig = MapperConfig()
    culling: CullingConfig = CullingConfig()
    wheels: OdometryNoiseConfig = OdometryNoiseConfig()
    shutter: ShutterConfig = ShutterConfig()
