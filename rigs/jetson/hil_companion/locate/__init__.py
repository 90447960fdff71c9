"""From boxes in a picture to places in the world: own pose, camera, ranges, and what all sightings add up to."""
