"""From tables of tests to artefacts: measures, failure regions, comparisons and evidence.

Each module turns tables and spaces into the results of one step; it reads and writes no result
files itself.
"""
