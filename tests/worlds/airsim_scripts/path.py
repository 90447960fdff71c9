"""Fly along a path of four points, looking ahead, and back to the start."""

from session import airsim, near, position, ready

client = ready("Lead")
client.takeoffAsync(vehicle_name="Lead").join()
client.moveToZAsync(-4, 2, vehicle_name="Lead").join()
points = [airsim.Vector3r(*p) for p in ((12, 0, -4), (12, 10, -4), (0, 10, -5), (0, 0, -4))]
forward, straight = airsim.DrivetrainType.ForwardOnly, airsim.YawMode(False, 0)
done = client.moveOnPathAsync(points, 4, 120, forward, straight, 5, 1, vehicle_name="Lead")
done.join()
near(position(client, "Lead"), (0, 0, -4), 1.0)
client.goHomeAsync(vehicle_name="Lead").join()
x, y, _ = position(client, "Lead")
near((x, y), (0, 0), 0.7)
