"""Forms of 3-D labels for frames with picture and sweep: each is one file with a class `Form` (label_form.py)."""
