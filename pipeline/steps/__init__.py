"""One file a step: its contract, `STEP`, and what it does, `run`.

Planning a study imports all of them, so what is slow to import (torch, MLflow, Matplotlib) is imported inside `run`.
"""
