"""Subjects with known truth, metrics, and the relighting protocol."""
