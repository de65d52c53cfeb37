# Names for groups of files, as in `snakemake search`. DVC versions the same groups.
for target, files in PLAN.jobs.targets.items():

    rule:
        name:
            target
        input:
            files,
