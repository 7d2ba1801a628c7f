"""The live view in a browser: one page (folder ``page``: plain HTML, CSS and JavaScript), one stream of events, and
guarded commands. Standard library only."""
