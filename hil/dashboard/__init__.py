"""The dashboard: a page that follows a run, flies it by hand and opens past ones. Loaded only where it is asked for."""
