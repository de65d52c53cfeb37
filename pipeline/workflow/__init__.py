"""From the steps' declarations to Snakemake's rules.

`jobs` lists the jobs of a study, `stamping` and `staleness` decide which are out of date, `plan`
hands both to the Snakefile, and `guards` checks a run before it begins.
"""
