"""Evaluation against the truth, and reports."""
