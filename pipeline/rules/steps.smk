# One rule a step, made from its contract. Threads and resources are in profiles/.
#
# `snakemake --lint` asks for a conda environment or a container for each rule. There is none on
# purpose: all steps use the environment of pyproject.toml and requirements.lock, and every job runs
# in the Python that runs Snakemake.
wildcard_constraints:
    **PLAN.jobs.constraints,


for step in PLAN.jobs.steps:

    rule:
        name:
            step
        input:
            unpack(PLAN.reads(step)),
        output:
            **PLAN.writes(step),
        log:
            PLAN.log(step, ".log"),
        benchmark:
            PLAN.log(step, ".tsv")
        wildcard_constraints:
            **PLAN.jobs.contracts[step].wildcards,
        params:
            stamp=PLAN.stamps(step),
        script:
            "step.py"
