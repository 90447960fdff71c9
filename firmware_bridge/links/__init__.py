"""Links: a transport plus a codec make an autopilot the bench can talk to, tick by tick."""
