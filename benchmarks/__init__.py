"""Claims about speed and memory, one script each.

Times are processor times of one thread, which is set here, before numpy starts more.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ.setdefault(name, "1")
