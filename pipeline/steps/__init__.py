"""One module per step: its contract, `STEP`, and its work, `run`.

Planning a study imports all of them, so `run` imports slow packages (torch, MLflow, Matplotlib)
itself.
"""
