"""Places on the city bicycle (models bicycle and bicycle_ridden) that its rider and its moving parts depend on."""

from __future__ import annotations

LENGTH_M, WIDTH_M, HEIGHT_M = 1.75, 0.60, 1.05
WHEEL_M = 0.345
AXLES_M = (0.53, -0.53)
CRANK_AXLE_M = (-0.08, 0.29)
CRANK_M = 0.17
PEDAL_Y_M, PEDAL_HALF_M = 0.13, 0.012
SADDLE_M = (-0.28, 0.895)  # x and z of its middle
SADDLE_HALF_M = 0.035
POST_ALONG = (-0.05, 0.16)  # x and z of the seat post
GRIP_M = (0.17, 0.273, 0.9875)  # middle of the left grip
