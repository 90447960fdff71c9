"""Pause in a move, let it go on for a time, and let it end."""

import math

from session import near, position, ready

client = ready("Lead")
client.takeoffAsync(vehicle_name="Lead").join()
client.simPause(True)
assert client.simIsPause()
before = position(client, "Lead")
move = client.moveByVelocityAsync(3, 0, 0, 4, vehicle_name="Lead")
near(position(client, "Lead"), before, 1e-6)  # the world stands still
began = client.getMultirotorState("Lead").timestamp
client.simContinueForTime(2.0)
paused = client.getMultirotorState("Lead")
assert abs((paused.timestamp - began) / 1e9 - 2.0) < 0.01
assert client.simIsPause()
on_the_way = position(client, "Lead")
assert 2.0 < math.dist(on_the_way, before) < 6.5
client.simContinueForFrames(5)
assert client.getMultirotorState("Lead").timestamp > paused.timestamp
client.simPause(False)
move.join()
assert position(client, "Lead")[0] > on_the_way[0] + 3.0
