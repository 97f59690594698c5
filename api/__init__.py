"""How one asks: the service (brought by a later issue)."""
