"""One program for each published page in docs/results, run as `python -m benchmarks.NAME`.

`shared` holds what several of them need; `faults` is a room of its own.
"""
