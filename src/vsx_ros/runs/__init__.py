"""A run from its first file to its last: folder, checkpoint, journal, record, report and exit code."""
