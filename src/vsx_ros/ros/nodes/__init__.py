"""One module per node; scripts/ holds a start script for each."""
