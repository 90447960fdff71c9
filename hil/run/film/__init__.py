"""Films of flights: pictures of the vehicles from outside and from on board, and the files that they go to."""
