"""The paper's experiments: drives, explorations, and the tables and figures from many of them."""
