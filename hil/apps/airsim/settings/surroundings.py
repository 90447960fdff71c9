"""Settings of the world around the vehicles: origin, time of day, wind, segmentation, recording."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from hil.apps.airsim.settings.cameras import IMAGE_TYPES, camera_name
from hil.apps.airsim.settings.reader import Reader, given, number
from signals.samples import Vec3


@dataclass(frozen=True)
class Origin:
    """Place of the scene's start on the Earth."""

    latitude_deg: float = number(47.641468, -89.9, 89.9, "Latitude")
    longitude_deg: float = number(-122.140165, -180.0, 180.0, "Longitude")
    altitude_m: float = number(122.0, -500.0, 9000.0, "Altitude")


@dataclass(frozen=True)
class TimeOfDay:
    """Sun by time and place; `start` None is the present time."""

    enabled: bool = given(False, "Enabled")
    start: datetime | None = None
    daylight_saving: bool = given(False, "StartDateTimeDst")
    clock_speed: float = number(1.0, -1e6, 1e6, "CelestialClockSpeed")
    update_interval_s: float = number(60.0, 1e-3, 1e6, "UpdateIntervalSecs")
    move_sun: bool = given(True, "MoveSun")


@dataclass(frozen=True)
class Segmentation:
    """Ids of the objects at the start: of all objects (`random_ids`), or none."""

    random_ids: bool = True


@dataclass(frozen=True)
class RecordedImage:
    """One image of a recording; `vehicle` "" is the default one."""

    camera: str = "front_center"
    image_type: int = 0
    as_float: bool = given(False, "PixelsAsFloat")
    compress: bool = given(True, "Compress")
    vehicle: str = given("", "VehicleName")


@dataclass(frozen=True)
class Recording:
    """Recording; `images` None is the scene of the default camera of every vehicle."""

    enabled: bool = given(False, "Enabled")
    on_move: bool = given(False, "RecordOnMove")
    interval_s: float = number(0.05, 0.0, 1e6, "RecordInterval")
    folder: str = given("", "Folder")
    images: tuple[RecordedImage, ...] | None = None


def read_origin(root: Reader) -> Origin:
    """Return the origin."""
    reader = root.child("OriginGeopoint")
    if reader is None:
        return Origin()
    origin = Origin(**reader.values(Origin))
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
    time = TimeOfDay(start=start, **reader.values(TimeOfDay))
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
    recording = Recording(images=images, **reader.values(Recording))
    reader.close("Recording")
    return recording


def _read_recorded_image(reader: Reader) -> RecordedImage:
    old_id = reader.whole("CameraID", 0, 0, 4)  # before AirSim 1.2
    image = RecordedImage(
        camera_name(reader.text("CameraName", str(old_id))),
        reader.whole("ImageType", 0, 0, IMAGE_TYPES[-1]),
        **reader.values(RecordedImage),
    )
    reader.without_meaning("Annotation")
    reader.close("Recording.Cameras")
    return image
