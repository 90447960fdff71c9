import hil.own_packages  # noqa: F401 (before every import of a package beside hil)
