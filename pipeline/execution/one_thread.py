"""How libraries are limited to one thread."""

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "1", "LP_NUM_THREADS": "0"}
"""Environment variables. With several threads, sums depend on their number; and worker processes
already share the cores."""
