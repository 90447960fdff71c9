"""Work on other machines: tasks of a Ray cluster, the program and the files that its nodes need."""

import hil.own_packages  # noqa: F401 (before every import of a package beside hil)
