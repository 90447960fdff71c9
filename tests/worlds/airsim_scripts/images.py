"""Take pictures of all types, raw and compressed."""

import numpy as np
from session import airsim, ready

client = ready("Lead")
client.takeoffAsync(vehicle_name="Lead").join()
kinds, request = airsim.ImageType, airsim.ImageRequest
scene, planar, perspective, view, segmentation, normals = client.simGetImages(
    [
        request("0", kinds.Scene, False, False),
        request("0", kinds.DepthPlanar, True, False),
        request("front_center", kinds.DepthPerspective, True, False),
        request("0", kinds.DepthVis),
        request("0", kinds.Segmentation, False, False),
        request("0", kinds.SurfaceNormals, False, False),
    ],
    "Lead",
)
for raw in (scene, segmentation, normals):
    assert (raw.width, raw.height) == (256, 144)
    assert np.frombuffer(raw.image_data_uint8, np.uint8).size == 256 * 144 * 3
planar_m = np.array(planar.image_data_float, np.float32).reshape(144, 256)
perspective_m = np.array(perspective.image_data_float, np.float32).reshape(144, 256)
near_m = (planar_m < 50.0) & (perspective_m < 50.0)
assert near_m.any()
assert (perspective_m[near_m] >= planar_m[near_m] - 1e-3).all()
v, u = np.mgrid[:144, :256]
ratio = np.sqrt(1.0 + ((u + 0.5 - 128) / 128) ** 2 + ((v + 0.5 - 72) / 128) ** 2)
assert np.allclose(perspective_m[near_m], (planar_m * ratio)[near_m], rtol=2e-3)
assert bytes(view.image_data_uint8[:8]) == b"\x89PNG\r\n\x1a\n"
assert scene.time_stamp > 0
png = client.simGetImage("0", kinds.Scene, "Lead")
assert bytes(png[:8]) == b"\x89PNG\r\n\x1a\n"
info = client.simGetCameraInfo("0", "Lead")
assert abs(info.fov - 90.0) < 1e-3
