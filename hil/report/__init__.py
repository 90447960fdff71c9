"""What a run leaves for people and for other programs: run.json, pictures and the report page."""
