"""Pictures, films and the report, from the files of a run alone."""
