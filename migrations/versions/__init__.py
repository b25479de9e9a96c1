"""Revisions, in order. Each can be undone."""
