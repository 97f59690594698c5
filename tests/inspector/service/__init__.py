"""Tests of the service without its HTTP."""
