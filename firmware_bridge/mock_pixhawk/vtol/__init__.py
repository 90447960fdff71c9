"""The mock autopilot as a standard VTOL: a multirotor's and a plane's parts, and the transitions between them."""
