"""Put a camera at several places without physics and take pictures there."""

import numpy as np
from session import airsim, connect, near, quaternion

client = connect("VehicleClient")
kinds, request = airsim.ImageType, airsim.ImageRequest
means = []
for k in range(3):
    place = (5.0 * k, -3.0 * k, -4.0 - 6.0 * k)
    client.simSetVehiclePose(airsim.Pose(airsim.Vector3r(*place), quaternion(0, -0.6, 0.3 * k)), True)
    at = client.simGetVehiclePose().position
    near((at.x_val, at.y_val, at.z_val), place, 1e-3)
    scene, depth = client.simGetImages(
        [request("0", kinds.Scene, False, False), request("1", kinds.DepthPlanar, True, False)]
    )
    assert len(scene.image_data_uint8) == 256 * 144 * 3
    near((scene.camera_position.x_val, scene.camera_position.y_val, scene.camera_position.z_val), place, 1.5)
    means.append(float(np.median(np.array(depth.image_data_float))))
assert means[0] < means[1] < means[2], "the higher, the further from the ground"
client.simSetCameraFov("0", 120)
assert abs(client.simGetCameraInfo("0").fov - 120) < 1e-3
