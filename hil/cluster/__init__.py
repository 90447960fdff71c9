"""Work on other machines: tasks of a Ray cluster, the program and the files that its nodes need."""
