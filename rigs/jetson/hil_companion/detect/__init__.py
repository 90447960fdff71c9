"""Finding things in pictures: the shipped model, what is made of its outputs, and the libraries that can run it."""
