"""The paper's experiments: drives, explorations, and what is made of many of them."""
