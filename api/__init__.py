"""How one asks: the service over HTTP, its routes, and the dashboard."""
