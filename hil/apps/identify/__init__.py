"""`hil identify`: fits a vehicle file to flight logs."""
