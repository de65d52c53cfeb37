"""Strategies: samplers that choose tests by ask and tell; a file each, settings in conf/sampler.

`batches` has their base class. `random` and `pairwise` ignore results, `coverage` only counts what
was tested, and the others learn from results.
"""
