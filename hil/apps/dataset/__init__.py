"""`hil dataset`: labelled data of many sensors, from a flight."""
