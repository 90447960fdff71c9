"""Methods about cameras: pose, field of view, distortion, and the lens of AirSim's cinematography calls.

The lens is that of a pinhole: focal length and field of view belong together by the width of the film,
f = w / (2 tan(fov / 2)). Focus, aperture and presets are kept and returned, and change no picture.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hil.apps.airsim.api.images import CAMERA
from hil.apps.airsim.api.session import VEHICLE
from hil.apps.airsim.pictures.camera import DISTORTION, Lens, ServedCamera
from hil.apps.airsim.rpc.arguments import BOOL, FLOAT, POSE, QUATERNION, TEXT, Pose, Quaternion, Vector
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.simulation import Simulation

EXTERNAL = optional("external", BOOL, False)
_WHERE = (CAMERA, VEHICLE, EXTERNAL)


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""
    find = sim.cameras.find

    def info(name: str, vehicle: str, external: bool) -> dict[str, Any]:
        camera = find(name, vehicle, external)
        return {"pose": camera.pose(), "fov": camera.fov(0), "proj_mat": {"matrix": camera.projection_matrix(0)}}

    def set_pose(name: str, pose: Pose, vehicle: str, external: bool) -> None:
        find(name, vehicle, external).set_pose(pose)

    def set_orientation(name: str, orientation: Quaternion, vehicle: str, external: bool) -> None:
        camera = find(name, vehicle, external)
        camera.set_pose(Pose(Vector(*camera.position_F), orientation))

    def set_fov(name: str, fov_deg: float, vehicle: str, external: bool) -> None:
        find(name, vehicle, external).set_fov(fov_deg)

    def distortion(name: str, vehicle: str, external: bool) -> list[float]:
        camera = find(name, vehicle, external)
        return [camera.distortion[key] for key in DISTORTION]

    def set_distortion(name: str, parameter: str, value: float, vehicle: str, external: bool) -> None:
        find(name, vehicle, external).set_distortion(parameter, value)

    def of_lens(read: Callable[[Lens, ServedCamera], Any]) -> Callable[[str, str, bool], Any]:
        def call(name: str, vehicle: str, external: bool) -> Any:
            camera = find(name, vehicle, external)
            return read(camera.lens, camera)

        return call

    def keep(setting: str, least: float = 0.0, most: float = 1e9) -> Callable[..., None]:
        def call(value: Any, name: str, vehicle: str, external: bool) -> None:
            if not isinstance(value, str) and not least <= value <= most:
                raise RpcError(f"{value:g} is out of range: {least:g} to {most:g}")
            setattr(find(name, vehicle, external).lens, setting, value)

        return call

    def set_focal_length(millimetres: float, name: str, vehicle: str, external: bool) -> None:
        camera = find(name, vehicle, external)
        camera.set_fov(camera.lens.fov_deg(millimetres))

    def set_film(width: float, height: float, name: str, vehicle: str, external: bool) -> float:
        camera = find(name, vehicle, external)
        focal_length = camera.lens.focal_length_mm(camera.fov(0))
        camera.lens.set_film(width, height)
        camera.set_fov(camera.lens.fov_deg(focal_length))
        return width / height

    def set_preset(kind: str) -> Callable[..., None]:
        def call(preset: str, name: str, vehicle: str, external: bool) -> None:
            camera = find(name, vehicle, external)
            sim.log(f"simSetPreset{kind}Settings: there is no preset '{preset[:60]}'; {camera.name} is as it was")

        return call

    def setter(name: str, call: Callable[..., Any], *parameters: Parameter) -> Method:
        return method(name, call, *parameters, *_WHERE)

    number = Parameter("value", FLOAT)
    return [
        method("simGetCameraInfo", info, *_WHERE),
        method("simSetCameraPose", set_pose, CAMERA, Parameter("pose", POSE), VEHICLE, EXTERNAL),
        method(
            "simSetCameraOrientation", set_orientation, CAMERA, Parameter("orientation", QUATERNION), VEHICLE, EXTERNAL
        ),
        method("simSetCameraFov", set_fov, CAMERA, Parameter("fov_degrees", FLOAT), VEHICLE, EXTERNAL),
        method("simGetDistortionParams", distortion, *_WHERE),
        method(
            "simSetDistortionParam",
            set_distortion,
            CAMERA,
            Parameter("param_name", TEXT),
            Parameter("value", FLOAT),
            VEHICLE,
            EXTERNAL,
        ),
        method("simGetCurrentFieldOfView", of_lens(lambda lens, camera: lens.field_of_view(camera.fov(0))), *_WHERE),
        method("simGetFocalLength", of_lens(lambda lens, camera: lens.focal_length_mm(camera.fov(0))), *_WHERE),
        setter("simSetFocalLength", set_focal_length, number),
        method("simGetFilmbackSettings", of_lens(lambda lens, _: lens.film()), *_WHERE),
        setter("simSetFilmbackSettings", set_film, Parameter("width", FLOAT), Parameter("height", FLOAT)),
        method("simGetLensSettings", of_lens(lambda lens, camera: lens.settings(camera.fov(0))), *_WHERE),
        method("simGetPresetLensSettings", of_lens(lambda _, __: []), *_WHERE),
        method("simGetPresetFilmbackSettings", of_lens(lambda _, __: []), *_WHERE),
        setter("simSetPresetLensSettings", set_preset("Lens"), Parameter("preset", TEXT)),
        setter("simSetPresetFilmbackSettings", set_preset("Filmback"), Parameter("preset", TEXT)),
        method("simGetFocusDistance", of_lens(lambda lens, _: float(lens.focus_cm)), *_WHERE),
        setter("simSetFocusDistance", keep("focus_cm"), number),
        method("simGetFocusAperture", of_lens(lambda lens, _: float(lens.aperture)), *_WHERE),
        setter("simSetFocusAperture", keep("aperture", 0.1, 100.0), number),
        setter("simEnableManualFocus", keep("manual_focus"), Parameter("enable", BOOL)),
        setter("simEnableFocusPlane", keep("focus_plane"), Parameter("enable", BOOL)),
    ]
