"""Versions that learn from failures: which frames they learn from, and how they are saved.

`frame_filter` judges campaign frames, `selection` and `added_frames` draw them, `leakage` keeps
held-out scenarios out, `fitting` trains and `versions` saves.
"""
