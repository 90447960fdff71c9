"""Settings of the world around the vehicles: origin, time of day, wind, segmentation, recording."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from hil.apps.airsim.settings.cameras import IMAGE_TYPES, camera_name
from hil.apps.airsim.settings.reader import Reader
from signals.samples import Vec3


@dataclass(frozen=True)
class Origin:
    """Place of the scene's start on the Earth."""

    latitude_deg: float = 47.641468
    longitude_deg: float = -122.140165
    altitude_m: float = 122.0


@dataclass(frozen=True)
class TimeOfDay:
    """Sun by time and place; `start` None is the present time."""

    enabled: bool = False
    start: datetime | None = None
    daylight_saving: bool = False
    clock_speed: float = 1.0
    update_interval_s: float = 60.0
    move_sun: bool = True


@dataclass(frozen=True)
class Segmentation:
    """Ids of the objects at the start: of all objects (`random_ids`), or none."""

    random_ids: bool = True


@dataclass(frozen=True)
class RecordedImage:
    """One image of a recording; `vehicle` "" is the default one."""

    camera: str = "front_center"
    image_type: int = 0
    as_float: bool = False
    compress: bool = True
    vehicle: str = ""


@dataclass(frozen=True)
class Recording:
    """Recording; `images` None is the scene of the default camera of every vehicle."""

    enabled: bool = False
    on_move: bool = False
    interval_s: float = 0.05
    folder: str = ""
    images: tuple[RecordedImage, ...] | None = None


def read_origin(root: Reader) -> Origin:
    """Return the origin."""
    default = Origin()
    reader = root.child("OriginGeopoint")
    if reader is None:
        return default
    origin = Origin(
        reader.number("Latitude", default.latitude_deg, -89.9, 89.9),
        reader.number("Longitude", default.longitude_deg, -180.0, 180.0),
        reader.number("Altitude", default.altitude_m, -500.0, 9000.0),
    )
    reader.close("OriginGeopoint")
    return origin


def read_time_of_day(root: Reader) -> TimeOfDay:
    """Return date and speed of the sun."""
    reader = root.child("TimeOfDay")
    if reader is None:
        return TimeOfDay()
    text = reader.text("StartDateTime")
    start = None
    if text:
        try:
            start = datetime.strptime(text, "%Y-%m-%d %H:%M:%S")
        except ValueError:
            reader.problem("StartDateTime", f"is not a date and time: {text[:60]!r}", "such as 2018-02-12 15:20:00")
    time = TimeOfDay(
        reader.flag("Enabled", False),
        start,
        reader.flag("StartDateTimeDst", False),
        reader.number("CelestialClockSpeed", 1.0, -1e6, 1e6),
        reader.number("UpdateIntervalSecs", 60.0, 1e-3, 1e6),
        reader.flag("MoveSun", True),
    )
    reader.close("TimeOfDay")
    return time


def read_vector(root: Reader, key: str, limit: float) -> Vec3:
    """Return an object of X, Y and Z (north, east, down), each within `limit`."""
    reader = root.child(key)
    if reader is None:
        return (0.0, 0.0, 0.0)
    x, y, z = (reader.number(axis, 0.0, -limit, limit) for axis in "XYZ")
    reader.close(key)
    return (x, y, z)


def read_segmentation(root: Reader) -> Segmentation:
    """Return how objects get their ids; `InitialInstanceSegmentation` is Cosys-AirSim's key."""
    random_ids = root.flag("InitialInstanceSegmentation", True)
    reader = root.child("SegmentationSettings")
    if reader is None:
        return Segmentation(random_ids)
    method = reader.choice("InitMethod", "CommonObjectsRandomIDs", ("CommonObjectsRandomIDs", "None"), any_case=True)
    reader.without_meaning("MeshNamingMethod", "OverrideExisting")
    reader.close("SegmentationSettings")
    return Segmentation(random_ids and method != "None")


def read_recording(root: Reader) -> Recording:
    """Return the recording that starts with the program, or that a client starts."""
    reader = root.child("Recording")
    if reader is None:
        return Recording()
    images = None
    if reader.has("Cameras"):
        images = tuple(_read_recorded_image(item) for item in reader.listed("Cameras"))
    recording = Recording(
        reader.flag("Enabled", False),
        reader.flag("RecordOnMove", False),
        reader.number("RecordInterval", 0.05, 0.0, 1e6),
        reader.text("Folder"),
        images,
    )
    reader.close("Recording")
    return recording


def _read_recorded_image(reader: Reader) -> RecordedImage:
    number = reader.whole("CameraID", 0, 0, 4)  # before AirSim 1.2
    image = RecordedImage(
        camera_name(reader.text("CameraName", str(number))),
        reader.whole("ImageType", 0, 0, IMAGE_TYPES[-1]),
        reader.flag("PixelsAsFloat", False),
        reader.flag("Compress", True),
        reader.text("VehicleName"),
    )
    reader.without_meaning("Annotation")
    reader.close("Recording.Cameras")
    return image
