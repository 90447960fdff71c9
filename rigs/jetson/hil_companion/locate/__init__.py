"""Geolocation of detected boxes: the vehicle's pose, camera rays, ranges, and tracks of repeated sightings."""
