"""Flight through unknown places: where the vehicle is and what stands there (SLAM), where to go, how to get there.

Needs OpenCV beside numpy.
"""
