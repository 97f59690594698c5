"""Tests of the processes that score."""
