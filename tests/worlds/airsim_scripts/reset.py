"""Fly, reset, and fly again: the start is the same, API control and arming are asked for again."""

from session import near, position, ready

client = ready("Lead")
start = position(client, "Lead")
for _ in range(3):
    client.enableApiControl(True, "Lead")
    client.armDisarm(True, "Lead")
    client.moveToPositionAsync(3, 3, -5, 5, vehicle_name="Lead").join()
    near(position(client, "Lead"), (3, 3, -5), 0.8)
    client.reset()
    near(position(client, "Lead"), start, 0.01)
    assert not client.isApiControlEnabled("Lead")
