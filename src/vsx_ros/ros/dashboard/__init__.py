"""The live view in a browser: one page, one stream of events, and a few guarded commands. Standard library only."""
