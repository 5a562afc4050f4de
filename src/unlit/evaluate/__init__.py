"""Subjects with known truth, and metrics."""
