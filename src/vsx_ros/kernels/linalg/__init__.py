"""Factorisations of symmetric systems: dense, with an envelope, by fronts."""
