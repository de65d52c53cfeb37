"""The detector of our own: the only part of Blindspot that needs PyTorch."""
