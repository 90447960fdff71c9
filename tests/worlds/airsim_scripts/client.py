"""Use what depends on the versions of numpy, msgpack and OpenCV beside the client."""

import importlib.util
import os
import tempfile

import numpy as np
from session import airsim, near, ready

client = ready("Lead")
halved = (airsim.Vector3r(1.0, 2.0, 3.0) + airsim.Vector3r(1.0, 0.0, 1.0)) / 2
near((halved.x_val, halved.y_val, halved.z_val), (1.0, 1.0, 2.0), 1e-6)
kinds, request = airsim.ImageType, airsim.ImageRequest
scene, depth = client.simGetImages([request("0", kinds.Scene, False, False), request("0", kinds.DepthPlanar, True)])
pixels = airsim.string_to_uint8_array(scene.image_data_uint8).reshape(scene.height, scene.width, 3)
depth_m = airsim.list_to_2d_float_array(depth.image_data_float, depth.width, depth.height)
assert depth_m.shape == pixels.shape[:2]
assert depth_m.dtype == np.float32
if importlib.util.find_spec("cv2"):
    with tempfile.TemporaryDirectory() as folder:
        airsim.write_png(os.path.join(folder, "scene.png"), pixels)
        assert os.path.getsize(os.path.join(folder, "scene.png"))
