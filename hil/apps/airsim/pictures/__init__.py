"""Pictures of the server's cameras: image types, segmentation ids, detections, recording."""
