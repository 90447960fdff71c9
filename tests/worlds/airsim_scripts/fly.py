"""Take off, fly to a place, turn, hover and land."""

from session import airsim, near, position, ready

client = ready("Lead")
assert client.ping()
assert client.getMultirotorState("Lead").landed_state == airsim.LandedState.Landed
client.takeoffAsync(vehicle_name="Lead").join()
state = client.getMultirotorState("Lead")
assert state.landed_state == airsim.LandedState.Flying
assert -3.5 < state.kinematics_estimated.position.z_val < -1.5
client.moveToPositionAsync(6, -4, -5, 3, vehicle_name="Lead").join()
near(position(client, "Lead"), (6, -4, -5), 0.7)
client.rotateToYawAsync(90, vehicle_name="Lead").join()
q = client.getMultirotorState("Lead").kinematics_estimated.orientation
assert abs(q.z_val) > 0.65  # 90 degrees within the margin of 5
client.hoverAsync(vehicle_name="Lead").join()
client.moveByVelocityAsync(1, 0, 0, 2, vehicle_name="Lead").join()
x, _, _ = position(client, "Lead")
assert 7.0 < x < 8.7
time_stamp = client.getImuData(vehicle_name="Lead").time_stamp
assert time_stamp > 0
assert abs(client.getBarometerData(vehicle_name="Lead").altitude) < 1e4
gps = client.getGpsData(vehicle_name="Lead").gnss
assert gps.fix_type == 3
assert abs(gps.geo_point.latitude - client.getHomeGeoPoint("Lead").latitude) < 1e-3
client.landAsync(vehicle_name="Lead").join()
assert client.getMultirotorState("Lead").landed_state == airsim.LandedState.Landed
client.armDisarm(False, "Lead")
client.enableApiControl(False, "Lead")
assert not client.isApiControlEnabled("Lead")
