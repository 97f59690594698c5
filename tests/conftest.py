"""One BLAS thread per worker of pytest-xdist, as two with two each wait for each other; the same examples every time."""

import os

from hypothesis import settings

# NumPy reads these when it is loaded. Here that may have been, by a plugin; workers are started later, and inherit.
for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# What a random example would break on somebody else's change is searched for by hand: `pytest --hypothesis-profile=default`.
settings.register_profile("same", derandomize=True)
settings.load_profile("same")
