"""Results of a run for people and other programs: run.json, pictures and the report page."""
