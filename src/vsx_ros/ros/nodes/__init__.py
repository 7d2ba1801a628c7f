"""One module per node; scripts/ holds a starter for each."""
