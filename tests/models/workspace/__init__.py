"""Workspaces: the tests."""
