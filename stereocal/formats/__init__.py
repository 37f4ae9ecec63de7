"""Readers and writers, a file for one format or several that are alike."""
