"""`hil airsim`: a server that speaks AirSim's API. Imported only if it is used."""
