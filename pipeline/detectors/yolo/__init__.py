"""Blindspot's own detector: the only part that needs PyTorch."""
