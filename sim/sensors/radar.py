"""FMCW radar: raw frames from the pictures of a camera, and their processing.

    truth -> picture (range, normal, material, radial velocity) -> echoes -> beat signal -> ADC -> processing

    t_capture = the tick = middle of the frame        t_available = t_capture + frame_s / 2 + latency

The picture shows the geometry at the tick, all pixels at once; noise, blur and rolling shutter of the camera do not
affect the radar. Motion within the frame enters the phases of the echoes through the radial velocity of each pixel
(of rotor blades: sim/radar/rotor_blades.py).
Steps that no output needs are skipped. Noise is a function of the seed, the sensor's name and the frame's number alone;
tracks, and maps with `clutter: background`, also depend on earlier frames.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.samples import RadarSample, TruthState, Vec3
from signals.time import NS_PER_S
from sim._kernels import EchoSynthesisReport
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.frame.mount import Mount
from sim.frame.shared_picture import SharedPicture
from sim.frame.source import Renderer, SharedFrames, channel_array
from sim.radar.adc import RadarReceiverChain
from sim.radar.coupling import couple
from sim.radar.element_synthesis import ChannelsReport, ElementSynthesizer
from sim.radar.ghost_echoes import GhostEchoes, Ghosts
from sim.radar.ghost_objects import GhostEcho, ghost_objects
from sim.radar.interference import Transmission
from sim.radar.object_echoes import ObjectEcho, ObjectEchoes
from sim.radar.other_radars import OtherRadars
from sim.radar.processing.processor import Processor, Step
from sim.radar.rain import Rain
from sim.radar.rotor_blades import RotorBlades
from sim.radar.scatterers import ScattererReport, Scatterers
from sim.radar.sweep_errors import SweepErrors
from sim.radar.synthesis import Synthesizer
from sim.sensors.radar_parameters import RadarParameters
from sim.sensors.sensor import Installation, InstalledSensor, Kind

Picture = Mapping[str, NDArray[Any]]

_STEPS: tuple[Step, ...] = ("tracks", "points", "range_doppler")  # of the processing; each needs the next

# Reasons for a pixel without an echo: fields of `ScattererReport` in words.
_REASONS = {
    "window": "outside the mask's angles",
    "pattern": "no antenna gain in this direction",
    "invalid": "range, normal or speed is not finite",
    "sky": "sky",
    "nothing": "no surface, or a surface without echo",
    "range": "beyond the mask's range",
    "classes": "class not in the mask",
    "away": "surface faces away from the radar",
}


class RadarCounts:
    """Counts of a radar's work so far, for the report of the run."""

    def __init__(self) -> None:
        self.frames = 0
        self.pixels = 0
        self.pixels_dropped: Counter[str] = Counter()  # by reason
        self.echoes = 0
        self.echoes_dropped = 0  # too weak to matter at the tolerance
        self.dropped_bound = 0.0  # greatest relative error of any frame by dropped echoes
        self.ghosts = 0  # echoes by mirrors
        self.rays = 0  # cast for them
        self.shared = 0  # pictures that the camera drew
        self.samples = 0  # of the raw data
        self.clipped = 0  # of them, at an end of the converter's range
        self.terms = 0  # greatest number of low-rank terms in the synthesis of any frame


class RadarFrames:
    """Raw frames of a radar from pictures, which may also come from a recording."""

    def __init__(
        self,
        view: SharedPicture,
        world: Any,
        p: RadarParameters,
        *,
        seed: int,
        name: str,
        geometry: FrameGeometry | None = None,
    ) -> None:
        """`geometry`: for paths with more than one bounce, which recorded pictures alone do not show.

        Raises ValueError if the mask leaves no pixel, or names a class that the world does not have, and for bounces
        without a geometry.
        """
        chirp, channels = p.chirp, p.antenna.channels(p.chirp)
        # Blades are folded into the speeds that one transmitter's chirps tell apart.
        self._chirp, self._blades = chirp.of_one_transmitter(p.antenna.array.turns), RotorBlades(world)
        self._scatterers = Scatterers(view.camera, world, chirp, p.antenna, p.receiver, p.mask)
        summed: dict[str, Any] = {
            "hp_cutoff_hz": p.receiver.hp_cutoff_hz,
            "aaf_cutoff_hz": p.receiver.aaf_cutoff_hz,
            "method": p.method,
            "tolerance": p.tolerance,
        }
        self._synthesizer: Synthesizer | ElementSynthesizer
        if p.antenna.elements_differ:
            self._synthesizer = ElementSynthesizer(chirp, p.antenna, **summed)
        else:
            self._synthesizer = Synthesizer(chirp, p.antenna.array, **summed)
        self._chain = RadarReceiverChain(
            chirp, p.impairments, channels, seed=seed, name=name, adc_bits=p.receiver.adc_bits
        )
        self._ghosts: GhostEchoes | None = None
        if p.bounces is not None:
            if geometry is None:
                raise ValueError(f"radar '{name}': recorded pictures do not show bounces; set its bounces to null")
            self._ghosts = GhostEchoes(geometry, chirp, p.antenna, p.receiver, p.mask, p.bounces, self._chirp)
        self.ghosts: Ghosts | None = None  # of the last frame
        rain_mm_per_h = p.rain_mm_per_h
        if rain_mm_per_h is None:
            rain_mm_per_h = getattr(world.scene.weather, "rain_mm_per_h", 0.0)
        self._coupling, self._parts = p.impairments.coupling, chirp.parts
        self._sweep: SweepErrors | None = None
        if p.impairments.sweep is not None:
            self._sweep = SweepErrors(chirp, p.antenna.array, p.receiver, p.impairments.sweep, seed=seed, name=name)
        self._rain: Rain | None = None
        if rain_mm_per_h > 0.0:
            limit_m = chirp.max_range_m if p.mask.max_range_m is None else min(p.mask.max_range_m, chirp.max_range_m)
            view_R, weight = self._scatterers.direction_R, self._scatterers.weight
            self._rain = Rain(chirp.center_frequency_hz, rain_mm_per_h, view_R, weight, limit_m, seed=seed, name=name)
        self._signal = np.zeros(p.raw_shape)
        self._top = (1 << p.receiver.adc_bits) - 1
        self.channels: tuple[str, ...] = self._scatterers.channels
        self.counts = RadarCounts()

    def raw(
        self, picture: Picture, pose: CameraPose, seq: int, disturb: Callable[[NDArray[np.float64]], None] | None = None
    ) -> NDArray[np.uint16]:
        """Return frame `seq` of a picture taken from `pose`: a new array (channels, chirps, samples).

        `disturb` adds to the signal before the converter.
        """
        echoes = self._scatterers.collect(self._blades.with_seen_speeds(picture, self._chirp), pose)
        if self._ghosts is not None:
            self.ghosts = self._ghosts.find(pose)
            echoes = self._scatterers.with_more(self.ghosts.echoes)
            self.counts.ghosts += self.ghosts.count
            self.counts.rays += self._ghosts.rays
        if self._rain is not None:
            drops = self._rain.echoes(picture["range"], *_down_and_velocity(pose), seq)
            echoes = self._scatterers.with_more(drops)
            self._rain.attenuate(echoes)
        report = self._synthesizer.synthesize(echoes, self._signal)
        if self._sweep is not None:
            self._sweep.add(echoes, self._signal, seq)
        if disturb is not None:
            disturb(self._signal)
        if self._coupling is not None:
            couple(self._coupling, self._parts, self._signal)
        out = np.empty(self._signal.shape, np.uint16)
        self._chain.digitise(self._signal, seq, out)
        self.counts.samples += out.size
        self.counts.clipped += int(np.count_nonzero(out == 0) + np.count_nonzero(out == self._top))
        self._count(self._scatterers.last, report)
        return out

    def _count(self, scatterers: ScattererReport, report: EchoSynthesisReport | ChannelsReport) -> None:
        counts = self.counts
        counts.frames += 1
        counts.pixels += scatterers.pixels
        counts.pixels_dropped.update({reason: getattr(scatterers, field) for field, reason in _REASONS.items()})
        counts.echoes += report.echoes
        counts.echoes_dropped += report.dropped
        counts.dropped_bound = max(counts.dropped_bound, report.dropped_bound)
        counts.terms = max(counts.terms, report.terms)


def _down_and_velocity(pose: CameraPose) -> tuple[Vec3, Vec3]:
    """Return the direction of gravity and the velocity of the pose, in R."""
    R = pose.R_WC
    return (-R[8], R[6], R[7]), pose.in_radar_frame(pose.v_WC_W)


class Radar(InstalledSensor):
    """One radar on the vehicle."""

    sample_type = RadarSample

    def __init__(self, installation: Installation, parameters: RadarParameters) -> None:
        """Raises ValueError without `installation.frames`, or for frames longer than their period."""
        p, frames = parameters, installation.geometry_for("a radar")
        name = installation.name
        if p.frame is not None and installation.shared is None:
            raise ValueError(f"sensor '{name}': the pictures of its camera {p.frame!r} are missing (shared)")
        if p.chirp.frame_s * NS_PER_S > installation.period_ns:
            raise ValueError(
                f"sensor '{name}': a frame of {p.chirp.frame_s:g} s is longer than the time between frames; "
                f"lower its rate_hz to {max_frames_hz(p):g} or less"
            )
        super().__init__(installation, 0.5 * p.chirp.frame_s + p.latency_s, {})
        self._parameters = p
        self.chirp, self.seen = p.chirp, p.seen
        self.outputs = p.outputs
        self.view: SharedPicture = installation.shared if p.frame is not None and installation.shared else p.view()
        # R has the axes of B if the camera looks forward: x_R = z_C, y_R = -x_C, z_R = -y_C.
        self.mount = Mount(self.view.mount_m, self.view.mount_rpy_deg, optical=False)
        self._optical = Mount(self.view.mount_m, self.view.mount_rpy_deg)
        self._frames: SharedFrames = frames
        self._renderer: Renderer | None = None
        self._own: dict[str, NDArray[Any]] = {}
        self._radar = RadarFrames(
            self.view, frames.geometry.world, p, seed=installation.seed, name=name, geometry=frames.geometry
        )
        self.channels = self._radar.channels
        self._others: OtherRadars | None = None
        if p.interference is not None:
            own = Transmission(p.chirp, p.antenna, p.receiver, p.interference, installation.period_ns / NS_PER_S)
            self._others = OtherRadars(frames.geometry, name, self._optical, own)
        self._object_echoes: ObjectEchoes | None = None
        self.objects: list[ObjectEcho] = []  # of the last frame, after `label_objects`
        self.ghosts: list[GhostEcho] = []  # their ghosts, the same
        self._until: Step = next((step for step in _STEPS if step in p.outputs), "range_doppler")
        self._processor = None
        if p.needs_processing:
            self._processor = Processor(p.chirp, p.antenna.array, p.processing)

    @property
    def counts(self) -> RadarCounts:
        """Counts of the work so far."""
        return self._radar.counts

    @property
    def has_ghosts(self) -> bool:
        """True for a radar with bounces."""
        return self._parameters.bounces is not None

    def label_objects(self, wanted: NDArray[np.bool_] | None = None) -> None:
        """Find the objects of every frame, into `objects`. Call before the first frame; samples do not change.

        `wanted`, (65536,) bool: True for the instances to find; by default all but 0.
        """
        p = self._parameters
        self._object_echoes = ObjectEchoes(
            self.view.camera, self._frames.geometry.world, p.chirp, p.antenna, p.receiver, p.mask, wanted
        )
        self.channels = (*self._radar.channels, "instance")

    def sample(self, truth: TruthState, seq: int) -> RadarSample:
        """Return frame `seq`."""
        t_ns = truth.t_ns
        self._frames.expect(t_ns)
        pose = self._optical.pose(truth)
        picture = self._picture(t_ns, pose)
        disturb = None if self._others is None else partial(self._others.add, pose, t_ns)
        raw = self._radar.raw(picture, pose, seq, disturb)
        if self._object_echoes is not None:
            self.objects = self._object_echoes.find(picture, pose)
            if self._radar.ghosts is not None:
                self.ghosts = ghost_objects(self._radar.ghosts, self.chirp, self._parameters.receiver)
        channels: dict[str, NDArray[Any]] = {"raw": raw} if "raw" in self.outputs else {}
        if self._processor is not None:
            processed = self._processor.process(raw, t_ns, until=self._until)
            for name in self.outputs:
                if name != "raw":
                    channels[name] = getattr(processed, name)
        for array in channels.values():
            array.flags.writeable = False
        return RadarSample(seq, t_ns, t_ns + self.latency_ns, pose.p_WC, self.mount.attitude(truth), channels)

    def _picture(self, t_ns: int, pose: CameraPose) -> Picture:
        """Return the picture that the camera `frame` has just drawn, or else draw one."""
        found = self.view.find(t_ns, pose, self.channels)
        if found is not None:
            self.counts.shared += 1
            return found
        if self._renderer is None:
            view = self.view
            self._renderer = self._frames.renderer(
                view.camera, shadows=False, supersample=1, near_m=view.near_m, far_m=view.far_m
            )
            self._own = {channel: channel_array(channel, view.camera) for channel in self.channels}
        self._renderer.render(pose, self._own)
        return self._own


def max_frames_hz(p: RadarParameters) -> float:
    """Return the highest rate at which frames do not overlap [Hz], in whole millihertz."""
    return int(1000.0 / p.chirp.frame_s) / 1000.0


KIND = Kind(Radar, RadarParameters, parts="outputs")
