"""Types of the native extension; its contract is in sim/native/*.hpp."""

from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Vec3 = tuple[float, float, float]

def ideal_imu(
    q_WB: tuple[float, float, float, float],
    a_WB_W: Vec3,
    w_WB_B: Vec3,
    alpha_WB_B: Vec3,
    dt_s: float,
    gravity_mps2: float,
) -> tuple[float, float, float, float, float, float]: ...

class NativeNoise:
    def __init__(self, key: tuple[int, int], lanes: int) -> None: ...
    def normal(self, index: int) -> tuple[float, ...]: ...

class BoxScene:
    def __init__(self, boxes: Sequence[tuple[float, float, float, float, float, float]]) -> None: ...
    def ray_distance(self, origin_W: Vec3, direction_W: Vec3) -> float: ...

class Imu:
    def __init__(
        self,
        *,
        white_key: tuple[int, int],
        walk_key: tuple[int, int],
        flicker_key: tuple[int, int],
        accel_gain: Sequence[float],
        gyro_gain: Sequence[float],
        bias: Sequence[float],
        white: Sequence[float],
        walk_step: Sequence[float],
        temperature_gain: Sequence[float],
        temperature: Sequence[float],
        lsb: Sequence[float],
        word: Sequence[float],
        limit: Sequence[float],
        lever_arm_B_m: Sequence[float],
        step_s: float,
        gravity_mps2: float,
        flicker_phi: Sequence[float],
        flicker_start: Sequence[float],
        flicker_step: Sequence[float],
        order: Sequence[float],
        amplitude: Sequence[float],
        phase_cos: Sequence[float],
        phase_sin: Sequence[float],
        reference_speed_radps: float,
    ) -> None: ...
    def sample(
        self,
        q_WB: tuple[float, float, float, float],
        a_WB_W: Vec3,
        w_WB_B: Vec3,
        alpha_WB_B: Vec3,
        rotor_speed_radps: tuple[float, ...],
        t_ns: int,
        index: int,
    ) -> tuple[Vec3, Vec3, float]: ...
    def noise(self, first: int, out: Float64) -> None: ...

class SolidTree:
    def __init__(self, *, kind: NDArray[np.int32], pose: Float64, size: Float64) -> None: ...
    def __len__(self) -> int: ...
    def distance(self, p_W: Vec3) -> float: ...

class RigidBody:
    def __init__(
        self,
        *,
        truth: Float64,
        mass_kg: float,
        inertia_kgm2: Sequence[float],
        rotor_position_m: Sequence[Sequence[float]],
        rotor_spin: Sequence[float],
        thrust_coefficient_n_per_radps2: float,
        moment_ratio_m: float,
        max_speed_radps: float,
        time_constant_up_s: float,
        time_constant_down_s: float,
        rotor_inertia_kgm2: float,
        rotor_drag_kg_per_rad: float,
        body_drag_linear_n_per_mps: Sequence[float],
        body_drag_quadratic_n_per_m2ps2: Sequence[float],
        gravity_mps2: float,
        wind_W_mps: Sequence[float],
        tick_s: float,
        substeps: int,
        contact_substeps: int,
        hard_contact_substeps: int = 1,
        thrust_model_factor: float = 1.0,
        rotor_radius_m: float = 0.1,
        ground_thrust_ratio: float = 1.0,
        descent_loss: float = 0.0,
        rotor_axial_kg_per_rad: float = 0.0,
        air_density_kgpm3: float = 1.225,
        classical: bool = False,
    ) -> None: ...
    def fit_battery(
        self,
        *,
        battery: Float64,
        cells: float,
        capacity_c: float,
        resistance_ohm: float,
        efficiency: float,
        auxiliary_w: float,
        nominal_voltage_v: float,
    ) -> None: ...
    def set_wind(self, start_W_mps: Sequence[float], end_W_mps: Sequence[float]) -> None: ...
    def set_rotor(self, rotor: int, thrust_left: float, forced_speed_radps: float, imbalance_kgm: float) -> None: ...
    def command(self, controls: Sequence[float]) -> int: ...
    def fly(self) -> float: ...
    def steps(self) -> int: ...
    def rewind(self) -> None: ...
    def finish(self) -> int: ...
    def clearance_before(self, radius_m: float, solids: SolidTree) -> float: ...
    def position_before(self) -> Vec3: ...
    def attach(self, qpos: Float64, qvel: Float64, qfrc_applied: Float64, qacc: Float64) -> None: ...
    def pose_in_substep(self, substep: int, share: float) -> None: ...
    def serve_mujoco(self, qpos: Float64, qvel: Float64, act: Float64, qfrc_applied: Float64) -> None: ...
    @staticmethod
    def mujoco_callback() -> int: ...
    def contact_load(self, substep: int, hard: bool) -> None: ...
    def contact_update(self, hard: bool) -> None: ...

class Dryden:
    def __init__(self, *, normals: tuple[float, ...], wind_20ft_mps: float, dt_s: float) -> None: ...
    def sample(self, height_m: float) -> Vec3: ...
    def step(self, height_m: float, airspeed_mps: float, normals: tuple[float, ...]) -> Vec3: ...

def dryden_scale(height_m: float, wind_20ft_mps: float) -> tuple[float, float, float, float]: ...

UInt8 = NDArray[np.uint8]
Float32 = NDArray[np.float32]

def accumulate_linear(rgb: UInt8, weight: float, out: Float32) -> None: ...
def expose(
    linear: Float32,
    vignette: Float32 | None,
    *,
    gain: float,
    electrons_at_white: float,
    read_noise_electrons: float,
    noisy: bool,
    key: tuple[int, int],
    index: int,
    rgb: UInt8,
) -> None: ...
def blur_depth(
    depth_m: Float32,
    *,
    sigma_m: float,
    sigma_per_m: float,
    step_m: float,
    disparity_scale_m: float,
    min_m: float,
    max_m: float,
    key: tuple[int, int],
    index: int,
) -> None: ...
def image_normals(key: tuple[int, int], index: int, out: Float32) -> None: ...
def sin_cos(angle_rad: Float64, sine: Float64, cosine: Float64) -> None: ...
def frame_isa() -> str: ...
def mean_of_four(fine: NDArray[np.uint8], out: NDArray[np.uint8]) -> None: ...

class Geometry:
    def __init__(self) -> None: ...
    def add_mesh(
        self,
        vertex: NDArray[np.float32],
        triangle: NDArray[np.int32],
        uv: NDArray[np.float32] | None,
        corner_normal: NDArray[np.float32] | None,
    ) -> int: ...
    def add_geom(
        self,
        shape: int,
        size: Sequence[float],
        p_WG: Sequence[float],
        R_WG: Sequence[float],
        mesh: int,
        moving: bool,
        visible: bool,
        class_id: int,
        instance: int,
        surface: int,
    ) -> int: ...
    def finish(self) -> None: ...
    def move(
        self,
        geoms: NDArray[np.int32],
        p_WG: NDArray[np.float64],
        R_WG: NDArray[np.float64],
        v_WG_W: NDArray[np.float64],
        w_WG_W: NDArray[np.float64],
    ) -> None: ...
    @property
    def version(self) -> int: ...

class Reach: ...

class Vicinity(Reach):
    def __init__(self, low_W: Vec3, high_W: Vec3, range_m: float) -> None: ...

class FieldOfView(Reach):
    def __init__(
        self, p_WC: Vec3, R_WC: Sequence[float], left: float, right: float, top: float, bottom: float
    ) -> None: ...

class SceneActors:
    def __init__(self, geometry: Geometry) -> None: ...
    def add(
        self, actor: Any, geoms: NDArray[np.int32], bodies: NDArray[np.int32], p_BG: Float64, R_BG: Float64
    ) -> None: ...
    def bring(self, t_ns: int, reach: Reach | None) -> int: ...
    def absent(self, t_ns: int) -> int: ...

class Scenery:
    def __init__(self) -> None: ...
    def add_texture(self, levels: Sequence[NDArray[np.uint8]], cube: bool) -> int: ...
    def add_geom(
        self, rgb: Sequence[float], emission: float, texture: int, repeat_u: float, repeat_v: float, per_metre: bool
    ) -> None: ...
    def without_textures(self) -> Scenery: ...
    @property
    def geom_count(self) -> int: ...

class Daylight:
    def __init__(
        self,
        sun_W: Sequence[float],
        sun_rgb: Sequence[float],
        sky_rgb: Sequence[float],
        ground_rgb: Sequence[float],
        zenith_rgb: Sequence[float],
        horizon_rgb: Sequence[float],
        air_rgb: Sequence[float],
        extinction_per_m: float,
        haze_m: float,
    ) -> None: ...

class SunShadows:
    def __init__(self, geometry: Geometry, sun_W: Sequence[float], resolution: int, isa: str = "") -> None: ...
    def update(self, reuse_static: bool) -> None: ...

class RasterCounts:
    @property
    def nodes(self) -> int: ...
    @property
    def geoms(self) -> int: ...

class Picture:
    @overload
    def __init__(
        self,
        geometry: Geometry,
        scenery: Scenery,
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        isa: str = "",
    ) -> None: ...
    @overload
    def __init__(
        self, geometry: Geometry, scenery: Scenery, directions_C: NDArray[np.float64], isa: str = ""
    ) -> None: ...
    def take(
        self,
        p_WC: Sequence[float],
        R_WC: Sequence[float],
        v_WC_W: Sequence[float],
        light: Daylight,
        shadows: SunShadows | None,
        out: dict[str, NDArray[Any]],
        near_t: float,
        far_t: float,
        frustum: bool,
        occlusion: bool,
        backs: bool,
        row0: int,
        row1: int,
        threads: int,
    ) -> None: ...
    @property
    def counts(self) -> RasterCounts: ...

class EchoSynthesisReport:
    echoes: int
    dropped: int
    dropped_bound: float
    error_bound: float
    terms: int
    panels: int
    width: int
    direct: int
    rounds: int

class EchoSynthesis:
    def __init__(
        self,
        *,
        center_frequency_hz: float,
        bandwidth_hz: float,
        sample_rate_hz: float,
        repetition_s: float,
        samples: int,
        chirps: int,
        rx_positions_m: Sequence[Sequence[float]],
        hp_cutoff_hz: float,
        aaf_cutoff_hz: float,
        direct: bool,
        tolerance: float,
        drop_share: float,
        isa: str = "",
    ) -> None: ...
    def synthesize(
        self, range_m: Float64, speed_mps: Float64, direction_R: Float64, amplitude: Float64, out: Float64
    ) -> EchoSynthesisReport: ...

class RayCaster:
    def __init__(self, geometry: Geometry) -> None: ...
    def cast(
        self,
        origins_W: Float64,
        directions_W: Float64,
        t_min: float,
        t_max: float,
        range_m: Float64,
        geom: NDArray[np.int32],
        normal_W: Float64 | None = None,
        radial_velocity_mps: Float64 | None = None,
        *,
        order: NDArray[np.int32] | None = None,
        threads: int = 1,
        tree: bool = True,
        max_range: bool = True,
        isa: str = "",
    ) -> None: ...

def extinguish(range_m: Float64, extinction_per_m: float, strength: Float64) -> None: ...
def coherent_order(directions: Float64, out: NDArray[np.int32]) -> None: ...

class LidarReceiver:
    def __init__(
        self,
        *,
        noise_key: tuple[int, int],
        loss_key: tuple[int, int],
        noise_m: float,
        resolution_m: float,
        min_range_m: float,
        max_range_m: float,
        range_at_10_percent_m: float | None,
        dropout: float,
        intensity_falloff_m: float | None,
    ) -> None: ...
    def receive(
        self,
        first_index: int,
        place: NDArray[np.int32],
        range_m: Float64,
        strength: Float64,
        geom: NDArray[np.int32],
        directions_L: Float64,
        origin_z_m: Float64,
        ring: NDArray[np.uint16],
        time_offset_ns: NDArray[np.int32],
        geom_class: NDArray[np.uint8],
        points_L: NDArray[np.float32],
        range_out_m: NDArray[np.float32],
        intensity: NDArray[np.float32],
        ring_out: NDArray[np.uint16],
        time_offset_out_ns: NDArray[np.int32],
        segmentation: NDArray[np.uint8],
        *,
        isa: str = "",
    ) -> int: ...

def lambert_strength(
    geom: NDArray[np.int32], normal_W: Float64, directions_W: Float64, reflectivity: Float64, strength: Float64
) -> None: ...
def sweep_rays(
    motion: tuple[Vec3, Vec3, Vec3, Vec3, tuple[float, float, float, float], Vec3, Vec3, Vec3],
    time_offset_ns: NDArray[np.int32],
    origins_B: Float64,
    directions_B: Float64,
    origins_W: Float64,
    directions_W: Float64,
    *,
    isa: str = "",
) -> tuple[Vec3, Vec3]: ...

class WalkPath:
    def __init__(
        self, *, pieces: Float64, straights: Float64, corners: Float64, lap_s: float, offset_s: float
    ) -> None: ...
    def progress(self, t_ns: int) -> tuple[int, float, float]: ...
    def place(self, s_m: float) -> tuple[float, float, float, float, float, float, float]: ...

def fit_gait(lengths_m: Sequence[float], speed_mps: float, cycle_m: float) -> list[float]: ...
def gait_rows(shape: Sequence[float], phase: float) -> list[list[float]]: ...
def resting_leg(
    lengths_m: Sequence[float], y: float, hip_z: float, ankle_x: float, ankle_z: float
) -> list[list[float]]: ...
def resting_arm(
    lengths_m: Sequence[float], y: float, z: float, upper_rad: float, fore_rad: float
) -> list[list[float]]: ...

class Walker:
    def __init__(
        self,
        *,
        shape: Sequence[float],
        path: WalkPath,
        cycles_per_m: float,
        ground_m: float,
        bound_z_m: float,
        bound_radius_m: float,
    ) -> None: ...
    def bound(self, t_ns: int) -> tuple[Vec3, float]: ...
    def phase(self, t_ns: int) -> float: ...
    def pose(self, t_ns: int, p_WB: Float64, q_WB: Float64, v_WB_W: Float64, w_WB_W: Float64) -> None: ...

def uniform_block(key: tuple[int, int], first_index: int, out: Float64) -> None: ...
def normal_block(key: tuple[int, int], first_index: int, out: Float64) -> None: ...

RADAR_CURVE_STEPS: int

def radar_backscatter(
    eps_r: float, eps_i: float, phase_height: float, facet_slope: float, cosine: Float64, sigma0: Float64
) -> None: ...
def radar_fresnel_power(eps_r: float, eps_i: float, cosine: float) -> float: ...
def radar_amplitude_curve(
    eps_r: float, eps_i: float, phase_height: float, facet_slope: float, out: NDArray[np.float32]
) -> None: ...
def pixel_solid_angles(corners: Float64, out: Float64) -> None: ...
def azimuth_elevation(direction_R: Float64, azimuth_rad: Float64, elevation_rad: Float64) -> None: ...
def cosine_pattern(direction_R: Float64, azimuth_exponent: float, elevation_exponent: float, out: Float64) -> None: ...
def collect_scatterers(
    blocks: NDArray[np.float32],
    direction_R: Float64,
    curves: NDArray[np.float32],
    class_kept: NDArray[np.uint8] | None,
    max_range_m: float,
    picture_range: NDArray[np.float32],
    normal: NDArray[np.float32],
    material: NDArray[np.uint8],
    radial_velocity: NDArray[np.float32],
    segmentation: NDArray[np.uint8] | None,
    range_m: Float64,
    speed_mps: Float64,
    echo_direction_R: Float64,
    amplitude: Float64,
    isa: str,
) -> tuple[int, int, int, int, int, int, int, int]: ...

class RadarReceiver:
    def __init__(
        self,
        *,
        receivers: int,
        chirps: int,
        samples: int,
        fixed: Sequence[Sequence[float]],
        start: Sequence[Sequence[float]],
        decay: Sequence[float],
        colour: Sequence[Sequence[float]],
        envelope: Sequence[Sequence[float]],
        colour_key: Sequence[tuple[int, int]],
        wander: Sequence[float],
        wander_key: Sequence[tuple[int, int]],
        odd_width: float,
        bits: int,
        isa: str = "",
    ) -> None: ...
    def digitise(self, signal: Float64, seq: int, out: NDArray[np.uint16]) -> int: ...

class RadarMap:
    def __init__(
        self,
        *,
        receivers: int,
        chirps: int,
        samples: int,
        pad_chirps: int,
        pad_samples: int,
        clutter: str,
        remove_chirp_mean: bool,
        fast_window: Sequence[float],
        slow_window: Sequence[float],
        isa: str = "",
    ) -> None: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    def compute(self, raw: NDArray[np.uint16], background_gain: float, power: NDArray[np.float32]) -> None: ...
    def spectrum(self, receiver: int, re: Float64, im: Float64) -> None: ...
    def reset(self) -> None: ...

class RadarCfar:
    def __init__(
        self,
        *,
        rows: int,
        columns: int,
        kind: str,
        guard: tuple[int, int],
        train: tuple[int, int],
        rank: float,
        false_alarm: float,
        receivers: int,
        likeness: float,
        quiet_rows: Sequence[bool],
        quiet_columns: int,
    ) -> None: ...
    def detect(self, power: NDArray[np.float32], mask: NDArray[np.uint8], noise: Float64) -> None: ...

def cell_averaging_factor(cells: float, receivers: int, false_alarm: float) -> float: ...
def order_statistic_factor(cells: float, rank: float, receivers: int, false_alarm: float) -> float: ...
def radar_direction(positions_m: Sequence[Vec3], wavelength_m: float, re: Float64, im: Float64) -> list[float]: ...

class RadarPeaks:
    def __init__(
        self,
        cfar: RadarCfar,
        *,
        positions_m: Sequence[Vec3],
        wavelength_m: float,
        range_step_m: float,
        speed_step_mps: float,
        coupling_s: float,
        first_column: int,
        range_ratio: Sequence[float],
        speed_ratio: Sequence[float],
        range_lobes: Sequence[float],
        speed_lobes: Sequence[float],
        nulls: tuple[int, int],
    ) -> None: ...
    def find(self, map_: RadarMap, power: NDArray[np.float32], out: NDArray[np.float32]) -> int: ...

class RadarTracker:
    def __init__(
        self,
        *,
        whole_speed_mps: float,
        cluster: Vec3,
        gate: Vec3,
        birth_speed_mps: float,
        birth_snr_db: float,
        sigma: Vec3,
        acceleration: tuple[float, float],
        confirm: tuple[int, int],
        coast_s: float,
        pause_s: float,
    ) -> None: ...
    def step(self, dt_s: float, points: NDArray[np.float32], out: NDArray[np.uint8]) -> int: ...
    def reset(self) -> None: ...

class InstanceScan:
    def scan(
        self,
        instance: NDArray[np.uint16],
        classes: NDArray[np.uint8] | None,
        depth_m: NDArray[np.float32] | None,
        out: NDArray[np.int32],
        class_pixels: NDArray[np.int64],
    ) -> int: ...
    def run_lengths(self, instance: NDArray[np.uint16], ids: NDArray[np.uint16]) -> tuple[list[int], ...]: ...
    def run_length_texts(self, instance: NDArray[np.uint16], ids: NDArray[np.uint16]) -> tuple[str, ...]: ...

def depth_values(depth_m: NDArray[np.float32], steps_per_m: float, out: NDArray[np.uint16]) -> None: ...
def normal_values(normal: NDArray[np.float32], out: NDArray[np.uint8]) -> None: ...
