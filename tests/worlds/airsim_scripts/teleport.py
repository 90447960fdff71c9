"""Put a vehicle elsewhere, also with NaN, which keeps what is there."""

import math

from session import airsim, near, quaternion, ready

client = ready("Lead")
pose = client.simGetVehiclePose("Lead")
start = (pose.position.x_val, pose.position.y_val, pose.position.z_val)
pose.position.x_val += 10
pose.position.z_val -= 3
pose.orientation = quaternion(0, 0, math.pi / 2)
client.simSetVehiclePose(pose, True, "Lead")
moved = client.simGetVehiclePose("Lead")
near((moved.position.x_val, moved.position.y_val, moved.position.z_val), (start[0] + 10, start[1], start[2] - 3), 0.05)
assert abs(moved.orientation.z_val - math.sqrt(0.5)) < 0.01
nan = math.nan
kept = airsim.Pose(airsim.Vector3r(nan, nan, nan), airsim.Quaternionr(nan, nan, nan, nan))
kept.position.y_val = start[1] + 5
client.simSetVehiclePose(kept, True, "Lead")
moved = client.simGetVehiclePose("Lead")
assert abs(moved.position.x_val - start[0] - 10) < 0.1
assert abs(moved.position.y_val - start[1] - 5) < 0.1
assert abs(moved.orientation.z_val - math.sqrt(0.5)) < 0.02
