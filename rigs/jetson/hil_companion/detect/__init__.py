"""Object detection in pictures: the shipped model, the decoding of its outputs, and back ends to run it."""
