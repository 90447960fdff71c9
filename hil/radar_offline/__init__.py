"""`hil radar`: frames of a recording, processed, or made from recorded pictures."""
