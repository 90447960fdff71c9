"""Links: a transport and a codec connect the bench to an autopilot, tick by tick."""
