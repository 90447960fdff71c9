"""`hil detect`: training and evaluation of the detector that the companion's client runs."""
