"""Measure the ground and a distance from a height of 6 m."""

import numpy as np
from session import position, ready

client = ready("Lead")
client.takeoffAsync(vehicle_name="Lead").join()
client.moveToZAsync(-6, 2, vehicle_name="Lead").join()
client.hoverAsync(vehicle_name="Lead").join()
client.moveByVelocityAsync(0, 0, 0, 2, vehicle_name="Lead").join()
data = client.getLidarData("Scan", "Lead")
points = np.array(data.point_cloud, np.float32).reshape(-1, 3)
assert len(points) > 100
assert data.time_stamp > 0
assert len(data.groundtruth) == len(points), "the name of each point's object, for Cosys-AirSim"
ground = points[abs(points[:, 2]) < 0.8]  # in NED from the start
assert len(ground) > 100, "the sweep points to the ground"
_, _, z = position(client, "Lead")
distance = client.getDistanceSensorData("Down", "Lead")
assert distance.min_distance < distance.distance < distance.max_distance
assert abs(distance.distance + z) < 1.0  # the ground is level
