"""The service without its HTTP: what happens when somebody asks. `api` speaks for it."""
