"""Fly two vehicles at the same time; each counts from its own start."""

from session import near, position, ready

client = ready("Lead", "Wing")
assert sorted(client.listVehicles()) == ["Lead", "Wing"]
client.simPause(True)
moves = [client.takeoffAsync(vehicle_name=name) for name in ("Lead", "Wing")]
client.simPause(False)
for move in moves:
    move.join()
client.simPause(True)
moves = [
    client.moveToPositionAsync(5, 0, -4, 2, vehicle_name="Lead"),
    client.moveToPositionAsync(-5, 2, -6, 2, vehicle_name="Wing"),
]
client.simPause(False)
for move in moves:
    move.join()
near(position(client, "Lead"), (5, 0, -4), 0.8)
near(position(client, "Wing"), (-5, 2, -6), 0.8)
lead, wing = client.simGetObjectPose("Lead").position, client.simGetObjectPose("Wing").position
near((lead.x_val, lead.y_val), (5, 0), 0.8)
near((wing.x_val, wing.y_val), (-5 + 4, 2 - 3), 0.8)  # its start is at 4, -3
