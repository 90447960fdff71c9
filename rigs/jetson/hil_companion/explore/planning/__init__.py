"""Path planning on the map: obstacle distances, prices, A* and the route that is flown."""
