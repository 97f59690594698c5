"""One BLAS thread per worker of pytest-xdist: two with two threads each wait for each other, five times as long."""

import os

# NumPy reads these when it is loaded. Here that may have been, by a plugin; workers are started later, and inherit.
for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
