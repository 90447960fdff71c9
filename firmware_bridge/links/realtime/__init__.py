"""Links to autopilots that run by their own clock: frames at wall-clock deadlines, and how well they were kept."""
