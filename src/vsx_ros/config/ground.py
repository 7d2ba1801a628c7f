"""Parameters of the dense map and the ground map (paper 5)."""

from typing import Annotated

from msgspec import Meta

from vsx_ros.config.branch import Branch, Count, NonNegative, Positive, Ratio


class GroundMapConfig(Branch, frozen=True):
    """The 2-D map (paper 5.2)."""

    resolution_m: Positive = 0.05
    obstacle_min_height_m: NonNegative = 0.06
    obstacle_max_height_m: Positive = 0.60
    clear_max_height_m: Positive = 0.40
    max_range_m: Positive = 4.5
    start_clear_m: NonNegative = 0.7


class PlanesConfig(Branch, frozen=True):
    """Planes of the sparse map by J-linkage (paper 5.1), tile by tile."""

    tile_m: Positive = 3.0
    max_points_per_tile: Count = 1000
    hypotheses: Count = 2000
    noise_px: Positive = 0.4
    floor_sigma_m: Positive = 0.01
    inlier_sigmas: Positive = 2.5
    max_distance_m: Positive = 0.08
    max_sigma_m: Positive = 0.3
    partner_sigma_m: Positive = 0.8
    min_separation_m: Positive = 0.10
    min_points: Count = 15


class DenseConfig(Branch, frozen=True):
    """Dense planar mapping (paper 5.1). Textures are standard deviations, in grey levels, of what a cell shows."""

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
    max_range_m: Positive = 4.5
    max_incidence_deg: Annotated[float, Meta(gt=0, lt=90)] = 80.0
    contact_contrast: NonNegative = 5.0
    contact_step: Positive = 1.2
    contact_min_views: Count = 3
    contact_max_support_m: Positive = 0.3
    max_fill_height_m: Positive = 0.6
    cells_per_update: Count = 3000
