"""What all branches of the configuration share, and those of SLAM (paper 3), dense and ground map (paper 5)."""

from typing import Annotated

from msgspec import Meta, Struct

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Ratio = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=1)]
FieldOfView = Annotated[float, Meta(ge=-1, lt=3.14)]


class Branch(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Common policy: immutable, unknown names are refused, keyword only."""


class InitializationConfig(Branch, frozen=True):
    """Two-frame start of the map (paper 3.1). Without odometry the baseline gets unit_baseline_m, and the images must
    determine the motion. The median flow beyond a pure rotation is at least min_flow_sigmas times the noise, which is
    0.2 px or as the residuals show. With that noise, direction and median depth keep their max_*_sigma_*. Such a map is
    watched for its first keyframes: it starts again when too few of its first points survive, or when their depths over
    the baseline grow or shrink by more than max_depth_change."""

    baseline_m: Positive = 0.20
    baseline_max_m: Positive = 0.6
    unit_baseline_m: Positive = 0.1
    min_matches: Count = 60
    min_parallax_deg: Positive = 0.7
    min_parallax_without_odometry_deg: Positive = 0.25
    min_flow_sigmas: Positive = 8.0  # at 5 some starts point 15 deg elsewhere
    max_direction_sigma_deg: Positive = 1.5  # above it the adjustment has other minima
    max_depth_sigma_ratio: Positive = 0.12  # below it the map improves by itself
    watched_keyframes: Count = 10
    min_surviving_ratio: Ratio = 0.3
    max_depth_change: Annotated[float, Meta(gt=1)] = 1.7  # over four sigmas; good starts change by up to 1.5
    max_turn_deg: Positive = 30.0  # more than the planner bends over the baseline (phi 2 rad/m)


class TrackerConfig(Branch, frozen=True):
    """Per-frame tracking. corners: number wanted on the finest level of a VGA image; about half on each coarser level.

    Even with enough points found, a pose is in doubt when their residuals exceed max_residual_px (robust standard
    deviation, px of their pyramid level), or when the position's standard deviation exceeds max_sigma_ratio of their
    distance."""

    corners: Count = 1300
    max_points: Count = 800
    coarse_radius_px: Positive = 30.0
    fine_radius_px: Positive = 10.0
    good_ratio: Ratio = 0.3
    lost_ratio: Ratio = 0.13
    min_found: Count = 30
    max_residual_px: Positive = 4.0
    max_sigma_ratio: Positive = 0.01
    lost_after_frames: Count = 3


class KeyframeConfig(Branch, frozen=True):
    """When a frame becomes a keyframe (paper 3.1: conservative where the map is already known). It is at least
    min_gap_frames or min_gap_s after the last one: all frames matter at a low image rate, many are alike at a high
    one. Where the camera has been before, it is mapped_spacing times as far from the keyframes of then, if at least
    mapped_points are found, and at most the share unmapped_ratio of the image's textured parts shows none."""

    min_gap_frames: Count = 4
    min_gap_s: Positive = 0.25
    distance_ratio: Positive = 0.06
    angle_deg: Positive = 8.0
    overlap_ratio: Ratio = 0.55
    mapped_points: Count = 200
    unmapped_ratio: Ratio = 0.05
    mapped_spacing: Positive = 3.5


class MapperConfig(Branch, frozen=True):
    """Creating, refining and removing points. corners: as the tracker's, for the search of new points."""

    corners: Count = 2600
    window_keyframes: Count = 8
    target_keyframes: Count = 3
    max_points_per_keyframe: Count = 400
    min_parallax_deg: Positive = 0.8
    local_iterations: Count = 10
    global_iterations: Count = 10


class CullingConfig(Branch, frozen=True):
    """A keyframe is redundant when enough others (viewers) see the share seen_ratio of its points from as near; the
    newest are kept. With 3 viewers, as in ORB-SLAM, keyframes as dense as here would be created again at once. When so
    many newer ones (behind) have followed, the camera has gone on, and viewers_behind are enough."""

    seen_ratio: Ratio = 0.9
    viewers: Count = 6
    keep_newest: Count = 10
    behind: Count = 60
    viewers_behind: Count = 2


class RecognitionConfig(Branch, frozen=True):
    """A place is recognised when patch search finds enough points (found), a large enough share of those searched
    (ratio), in enough of 4 x 4 parts of the image (cells). sure_*: with other evidence; certain_*: without."""

    sure_found: Count = 40
    sure_ratio: Ratio = 0.42
    sure_cells: Annotated[int, Meta(ge=1, le=16)] = 5
    certain_found: Count = 120
    certain_ratio: Ratio = 0.5
    certain_cells: Annotated[int, Meta(ge=1, le=16)] = 8


class DriftConfig(Branch, frozen=True):
    """Largest drift of a map along a path at which a place seen again may close a loop: a constant, plus a share of the
    path and a turn per metre of it, with odometry and with the camera alone."""

    distance_m: NonNegative = 0.15
    turn_rad: NonNegative = 0.06
    odometry_ratio: NonNegative = 0.03
    camera_ratio: NonNegative = 0.3
    odometry_rad_m: NonNegative = 0.015
    camera_rad_m: NonNegative = 0.06


class ShutterConfig(Branch, frozen=True):
    """How the camera exposes: its rows one after the other within readout_s (0: all at once), each for exposure_s. With
    odometry, images are corrected for the camera's motion in that time. -1: as in the calibration, or 0 without one.
    latency_s: how much later than the start of the first row's exposure the driver stamps images."""

    readout_s: Annotated[float, Meta(ge=-1, le=0.2)] = -1.0
    exposure_s: Annotated[float, Meta(ge=-1, le=0.2)] = -1.0
    latency_s: Annotated[float, Meta(ge=-0.5, le=0.5)] = 0.0


class OdometryNoiseConfig(Branch, frozen=True):
    """Noise of wheel odometry between keyframes, per axis: a constant plus a share of the motion; and how level the
    base stands on the floor. An error of the wheels' diameter is the same everywhere and only scales the map. The noise
    here is the difference between one stretch and the next."""

    distance_sigma_m: Positive = 0.0003
    distance_sigma_ratio: Positive = 0.002
    sideways_sigma_ratio: Positive = 0.006
    turn_sigma_rad: Positive = 0.002
    turn_sigma_ratio: Positive = 0.01
    tilt_sigma_rad: Positive = 0.01
    floor_height_sigma_m: Positive = 0.01
    floor_tilt_sigma_rad: Positive = 0.02


class UncertaintyConfig(Branch, frozen=True):
    """How well SLAM knows its poses (standard deviations). shared_*: between two keyframes by one shared point, as a
    share of its depth and a turn; n points divide it by the root of n. *_sqrt_m: grows with the root of the distance
    between them. image_factor: factor on the variance from the image, because errors of its points are correlated.
    size_sigma_ratio: of the scale of the whole map, which odometry measured."""

    shared_depth_ratio: Positive = 0.002
    shared_turn_rad: Positive = 0.01
    distance_sigma_sqrt_m: NonNegative = 0.0015
    turn_sigma_rad_sqrt_m: NonNegative = 0.0015
    image_factor: Positive = 2.0
    size_sigma_ratio: NonNegative = 0.002


class SlamConfig(Branch, frozen=True):
    """Keyframe SLAM (paper 3)."""

    initialization: InitializationConfig = InitializationConfig()
    tracker: TrackerConfig = TrackerConfig()
    keyframes: KeyframeConfig = KeyframeConfig()
    mapper: MapperConfig = MapperConfig()
    culling: CullingConfig = CullingConfig()
    recognition: RecognitionConfig = RecognitionConfig()
    drift: DriftConfig = DriftConfig()
    odometry_noise: OdometryNoiseConfig = OdometryNoiseConfig()
    shutter: ShutterConfig = ShutterConfig()
    uncertainty: UncertaintyConfig = UncertaintyConfig()


class GroundMapConfig(Branch, frozen=True):
    """The 2-D map (paper 5.2). A ray proves the ground free where it is at most clear_max_height_m high: as high as the
    robot (TurtleBot 2). An unseen gap in a straight wall up to wall_gap_m is wall, too. Points (or a few points) are
    noise when this many times more keyframes looked through their place."""

    resolution_m: Annotated[float, Meta(ge=0.01, le=0.5)] = 0.05
    obstacle_min_height_m: NonNegative = 0.06
    obstacle_max_height_m: Positive = 0.60
    clear_max_height_m: Positive = 0.42
    max_range_m: Positive = 6.0
    start_clear_m: NonNegative = 0.7
    wall_gap_m: Positive = 1.0
    overruled_ratio: Positive = 1.0
    few_overruled_ratio: Positive = 0.25


class RoomsConfig(Branch, frozen=True):
    """Where the ground map is cut into rooms: at passages that are less than door_ratio times as wide as both rooms.
    Obstacles up to furniture_m long that touch no wall do not count. A part below least_room_m2 belongs to the room
    beside it. Live, rooms are found every_s."""

    door_ratio: Ratio = 0.7
    furniture_m: NonNegative = 1.8
    least_room_m2: Positive = 2.0
    every_s: Positive = 5.0


class PlanesConfig(Branch, frozen=True):
    """Planes of the sparse map by J-linkage (paper 5.1), tile by tile."""

    tile_m: Positive = 3.0
    max_points_per_tile: Count = 1000
    hypotheses: Annotated[int, Meta(ge=1, le=65472)] = 2000  # J-linkage takes no more
    noise_px: Positive = 0.4
    floor_sigma_m: Positive = 0.01
    inlier_sigmas: Positive = 2.5
    max_distance_m: Positive = 0.15
    max_sigma_m: Positive = 0.3
    partner_sigma_m: Positive = 0.8
    min_separation_m: Positive = 0.10
    min_points: Count = 15


class DenseConfig(Branch, frozen=True):
    """Dense planar mapping (paper 5.1). Textures are standard deviations, in grey levels, of a cell's image."""

    enabled: bool = True
    planes: PlanesConfig = PlanesConfig()
    cell_m: Positive = 0.08
    patch_m: Positive = 0.12
    min_texture: NonNegative = 1.0
    accept_zncc: Ratio = 0.75
    grow_zncc: Ratio = 0.65
    rival_margin: Ratio = 0.05
    min_views: Count = 3
    min_parallax_deg: Positive = 2.0
    max_parallax_deg: Positive = 30.0
    min_range_m: Positive = 0.4
    max_range_m: Positive = 6.0
    max_incidence_deg: Annotated[float, Meta(gt=0, lt=90)] = 80.0
    contact_contrast: NonNegative = 5.0
    contact_step: Positive = 1.2
    contact_min_views: Count = 3
    contact_max_support_m: Positive = 0.3
    max_fill_height_m: Positive = 0.6
    cells_per_update: Count = 3000
