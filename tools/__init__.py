"""Scripts for developers of the product, run from the repository's root: `python tools/NAME.py`."""
