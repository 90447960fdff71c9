"""Hover in wind: the vehicle leans into it and stays."""

from session import airsim, near, position, ready

client = ready("Lead")
client.takeoffAsync(vehicle_name="Lead").join()
client.moveToPositionAsync(0, 0, -5, 2, vehicle_name="Lead").join()
client.hoverAsync(vehicle_name="Lead").join()
calm = client.getMultirotorState("Lead").kinematics_estimated.orientation
client.simSetWind(airsim.Vector3r(8, 0, 0))
client.moveByVelocityAsync(0, 0, 0, 6, vehicle_name="Lead").join()
windy = client.getMultirotorState("Lead").kinematics_estimated.orientation
assert windy.y_val > calm.y_val + 0.005, "a wind from behind lifts the nose"
near(position(client, "Lead"), (0, 0, -5), 3.0)
client.simSetWind(airsim.Vector3r(0, 0, 0))
