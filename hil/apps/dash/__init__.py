"""The dashboard: a page that follows a run, flies it by hand and opens past ones. Imported only if it is used."""
