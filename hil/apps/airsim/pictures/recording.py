"""Recording of poses and pictures at an interval of simulated time, in AirSim's form.

FOLDER/2026-01-31-12-00-00/airsim_rec.txt    one line per vehicle and instant, separated by tabs
FOLDER/2026-01-31-12-00-00/weather.txt       a line at the begin and after each change of the weather
FOLDER/2026-01-31-12-00-00/images/           img_VEHICLE_CAMERA_TYPE_TIME.png, .pfm for numbers, .ppm for raw pixels
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np

from hil.apps.airsim.pictures.cameras import Cameras, Wanted
from hil.apps.airsim.pictures.image_types import Taken, colours, numbers, png
from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.settings.surroundings import RecordedImage, Recording
from hil.apps.airsim.world.drone import Drone
from signals.time import NS_PER_MS, NS_PER_S
from sim.scene.weather import Weather

_COLUMNS = ("VehicleName", "TimeStamp", "POS_X", "POS_Y", "POS_Z", "Q_W", "Q_X", "Q_Y", "Q_Z", "ImageFile")
_WEATHER_COLUMNS = ("TimeStamp", "RainMmPerH", "SnowMmPerH", "VisibilityM")  # empty: clear


class Recorder:
    """Recorder of one server. `observe` is called after every tick."""

    def __init__(
        self,
        settings: Recording,
        cameras: Cameras,
        drones: Mapping[str, Drone],
        weather: Callable[[], Weather],
        *,
        default: str,
        log: Callable[[str], None],
    ) -> None:
        """`default`: the vehicle of images without a name."""
        self.folder = Path(settings.folder) if settings.folder else Path("runs")
        self._settings, self._cameras, self._drones, self._log = settings, cameras, drones, log
        self._default = default
        self._weather = weather
        self._last_weather: Weather | None = None
        self._interval_ns = max(1, round(settings.interval_s * NS_PER_S))
        self._to: Path | None = None
        self._text: TextIO | None = None
        self._next_ns: int | None = None
        self._last: dict[str, tuple[float, ...]] = {}
        self.lines = 0

    @property
    def runs(self) -> bool:
        """True while a recording runs."""
        return self._text is not None

    def start(self) -> None:
        """Begin a new recording, unless one runs. Raises RpcError if its folder cannot be made."""
        if self.runs:
            return
        stem = time.strftime("%Y-%m-%d-%H-%M-%S")
        try:
            for n in range(1000):
                folder = self.folder / (stem if n == 0 else f"{stem}-{n}")
                if not folder.exists():
                    break
            (folder / "images").mkdir(parents=True)
            self._text = (folder / "airsim_rec.txt").open("w", encoding="utf-8", errors="replace")
            self._text.write("\t".join(_COLUMNS) + "\n")
        except OSError as error:
            self._text = None
            raise RpcError(
                f"the recording cannot be written to {self.folder}: {error.strerror or error}; set Folder of Recording "
                "in settings.json to a folder that can"
            ) from None
        self._to, self._next_ns, self.lines = folder, None, 0
        self._last.clear()
        self._last_weather = None
        self._log(f"recording to {folder}")

    def stop(self) -> None:
        """End the recording, if one runs."""
        if self._text is not None:
            self._text.close()
            self._text = None
            self._log(f"the recording of {self.lines} lines is over: {self._to}")

    def observe(self, t_ns: int, now_ns: int) -> None:
        """Record the present tick if it is due. `now_ns`: its time stamp. An error ends the recording."""
        if self._text is None or (self._next_ns is not None and t_ns < self._next_ns):
            return
        due = t_ns if self._next_ns is None else self._next_ns
        self._next_ns = max(due + self._interval_ns, t_ns + 1)
        try:
            self._record_weather(now_ns)
            for drone in self._drones.values():
                self._record(drone, now_ns)
        except OSError as error:
            self._log(f"the recording ends, because {self._to} cannot be written: {error.strerror or error}")
            self.stop()
        except RpcError as error:
            self._log(f"the recording ends: {error}")
            self.stop()

    def _record_weather(self, now_ns: int) -> None:
        weather = self._weather()
        if weather == self._last_weather or self._to is None:
            return
        with (self._to / "weather.txt").open("a", encoding="utf-8") as text:
            if self._last_weather is None:
                text.write("\t".join(_WEATHER_COLUMNS) + "\n")
            values = (weather.rain_mm_per_h, weather.snow_mm_per_h)
            visibility = "" if weather.visibility_m is None else f"{weather.visibility_m:.6g}"
            text.write("\t".join((str(now_ns // NS_PER_MS), *(f"{v:.6g}" for v in values), visibility)) + "\n")
        self._last_weather = weather

    def _record(self, drone: Drone, now_ns: int) -> None:
        assert self._text is not None
        truth = drone.vehicle.truth
        state = (*truth.p_WB, *truth.q_WB)
        if self._settings.on_move and self._last.get(drone.name) == state:
            return
        self._last[drone.name] = state
        pose = drone.origin.pose(truth.p_WB, truth.q_WB)
        images = [image for image in self._images(drone) if self._is_of(image, drone)]
        wanted = [Wanted(self._cameras.find(image.camera, drone.name), image.image_type) for image in images]
        names = [
            self._write(drone.name, now_ns, *each)
            for each in zip(images, wanted, self._cameras.take(wanted), strict=True)
        ]
        values = [f"{value:.6g}" for value in (*pose.position, *pose.orientation)]
        self._text.write("\t".join((drone.name, str(now_ns // NS_PER_MS), *values, ";".join(names))) + "\n")
        self._text.flush()
        self.lines += 1

    def _images(self, drone: Drone) -> tuple[RecordedImage, ...]:
        images = self._settings.images
        return (RecordedImage(vehicle=drone.name),) if images is None else images

    def _is_of(self, image: RecordedImage, drone: Drone) -> bool:
        return image.vehicle == drone.name or (image.vehicle == "" and drone.name == self._default)

    def _write(self, vehicle: str, now_ns: int, image: RecordedImage, wanted: Wanted, taken: Taken) -> str:
        assert self._to is not None
        stem = f"img_{_plain(vehicle)}_{_plain(image.camera)}_{image.image_type}_{now_ns}"
        height, width = taken.model.height, taken.model.width
        if image.as_float:
            rows = numbers(wanted.image_type, taken)[::-1].astype("<f4")  # PFM begins with the lowest row
            name, data = f"{stem}.pfm", f"Pf\n{width} {height}\n-1\n".encode() + np.ascontiguousarray(rows).tobytes()
        elif image.compress:
            name, data = f"{stem}.png", png(colours(wanted.image_type, taken))
        else:
            name = f"{stem}.ppm"
            data = f"P6\n{width} {height}\n255\n".encode() + colours(wanted.image_type, taken).tobytes()
        (self._to / "images" / name).write_bytes(data)
        return name


def _plain(name: str) -> str:
    """Return a name as a part of a file name."""
    return "".join(character if character.isalnum() or character in "-_." else "_" for character in name)[:80]
