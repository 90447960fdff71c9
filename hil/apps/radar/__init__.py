"""`hil radar`: processing of recorded radar frames, or of frames made from recorded pictures."""
