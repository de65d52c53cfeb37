# The loop in data-flow order. What each step computes is in pipeline/steps/<step>.py; where files lie is here alone.
from pipeline.workflow import study

S = study()
D, L = S.root, S.logs
RUN = "OMP_NUM_THREADS={threads} python -m pipeline"


wildcard_constraints:
    scenario="|".join(S.config.scenarios),
    strategy="|".join(S.config.samplers),
    version=S.version_pattern,
    seed=r"\d+",
    kind="campaigns|held_out|retrained/campaigns",


rule all:
    input:
        S.goals,


# Names for groups of targets, for DVC's stages and for people.
rule spaces:
    input:
        S.spaces([*S.config.search, *S.config.held_out]),


rule base_set:
    input:
        f"{D}/base_set/truth.coco.json",


rule base:
    input:
        f"{D}/models/base/model.json",


rule search:
    input:
        S.search("tests.parquet"),


rule analysis:
    input:
        f"{D}/measures.json",
        f"{D}/white_box.json",
        expand(f"{D}/regions/{{scenario}}.json", scenario=S.config.search),
        S.filters(),


rule versions:
    input:
        S.models("model.json"),


rule held_out:
    input:
        S.held_out("tests.parquet"),


rule define_space:
    output:
        f"{D}/space/{{scenario}}.json",
    log:
        f"{L}/define_space/{{scenario}}.log",
    benchmark:
        f"{L}/define_space/{{scenario}}.tsv"
    params:
        stamp=lambda w: S.stamp("define_space", f"scenarios.{w.scenario}"),
    shell:
        RUN + " define-space --scenario {wildcards.scenario} --out {output} --log {log}"


rule render_base:
    output:
        f"{D}/base_set/truth.coco.json",
    log:
        f"{L}/render_base.log",
    benchmark:
        f"{L}/render_base.tsv"
    threads: 2
    params:
        stamp=S.stamp("render_base", "base_set", "simulator"),
    shell:
        RUN + " render-base --out {output} --threads {threads} --log {log}"


rule train:
    input:
        base_set=rules.render_base.output,
        weights=S.shipped,
    output:
        f"{D}/models/base/weights.safetensors",
        f"{D}/models/base/model.onnx",
        f"{D}/models/base/curve.csv",
        card=f"{D}/models/base/model.json",
    log:
        f"{L}/train/base.log",
    benchmark:
        f"{L}/train/base.tsv"
    threads: 2
    params:
        stamp=S.stamp("train", *S.training_sections, "detector"),
        # Outside the outputs' folder, as a campaign's journal is.
        checkpoint=f"{D}/journal/train/base.pt",
    shell:
        RUN + " train --base-set {input.base_set} --out {output.card} --checkpoint {params.checkpoint} --threads {threads} --log {log}"


rule campaign:
    input:
        space=f"{D}/space/{{scenario}}.json",
        model=lambda w: S.model(w.version, "model.onnx"),
        earlier=lambda w: S.earlier(**w),
    output:
        tests=f"{D}/{{kind}}/{{scenario}}/{{strategy}}/{{version}}/{{seed}}/tests.parquet",
        more=expand(
            f"{D}/{{{{kind}}}}/{{{{scenario}}}}/{{{{strategy}}}}/{{{{version}}}}/{{{{seed}}}}/{{name}}.parquet",
            name=["signals", "frames", "timings"],
        ),
    log:
        f"{L}/{{kind}}/{{scenario}}/{{strategy}}/{{version}}/{{seed}}.log",
    benchmark:
        f"{L}/{{kind}}/{{scenario}}/{{strategy}}/{{version}}/{{seed}}.tsv"
    threads: 2
    params:
        stamp=lambda w: S.stamp(
            "campaign",
            f"scenarios.{w.scenario}",
            f"samplers.{w.strategy}",
            "simulator",
            "detector",
            *S.campaign_sections(w.scenario),
        ),
        # Outside the outputs' folder: DVC empties that before it makes a stage again.
        journal=f"{D}/journal/{{scenario}}/{{strategy}}/{{version}}/{{seed}}",
    shell:
        RUN + " campaign --scenario {wildcards.scenario} --strategy {wildcards.strategy} --version {wildcards.version}"
        " --seed {wildcards.seed} --space {input.space} --model {input.model} --earlier {input.earlier} --out {output.tests}"
        " --journal {params.journal} --threads {threads} --log {log}"


rule measure:
    input:
        spaces=S.spaces(S.config.search),
        tests=S.search("tests.parquet"),
    output:
        measures=f"{D}/measures.json",
        theta=f"{D}/theta.csv",
    log:
        f"{L}/measure.log",
    benchmark:
        f"{L}/measure.tsv"
    params:
        stamp=S.stamp("measure", "strategies", "comparison.confidence"),
    shell:
        RUN + " measure --tests {input.tests} --spaces {input.spaces} --out {output.measures} --theta {output.theta} --log {log}"


rule cluster:
    input:
        space=f"{D}/space/{{scenario}}.json",
        tests=lambda w: S.search("tests.parquet", scenario=w.scenario),
    output:
        f"{D}/regions/{{scenario}}.json",
    log:
        f"{L}/cluster/{{scenario}}.log",
    benchmark:
        f"{L}/cluster/{{scenario}}.tsv"
    params:
        stamp=S.stamp("cluster", "regions", "comparison.confidence"),
    shell:
        RUN + " cluster --space {input.space} --tests {input.tests} --out {output} --log {log}"


rule filter:
    input:
        frames=lambda w: S.search("frames.parquet", strategy=w.strategy),
        overrules=S.overrules,
    output:
        f"{D}/filter/{{strategy}}.csv",
    log:
        f"{L}/filter/{{strategy}}.log",
    benchmark:
        f"{L}/filter/{{strategy}}.tsv"
    params:
        stamp=S.stamp("filter", "filter", "strategies"),
    shell:
        RUN + " filter --frames {input.frames} --out {output} --log {log}"


use rule filter as filter_round with:
    input:
        frames=lambda w: S.search("frames.parquet", strategy=w.strategy, version=w.version),
        overrules=S.overrules,
    output:
        f"{D}/retrained/filter/{{strategy}}/{{version}}.csv",
    log:
        f"{L}/filter/{{strategy}}/{{version}}.log",
    benchmark:
        f"{L}/filter/{{strategy}}/{{version}}.tsv"


rule white_box:
    input:
        model=f"{D}/models/base/model.json",
        base_set=rules.render_base.output,
        frames=S.search("frames.parquet"),
    output:
        f"{D}/white_box.json",
    log:
        f"{L}/white_box.log",
    benchmark:
        f"{L}/white_box.tsv"
    threads: 2
    params:
        stamp=S.stamp("white_box", "strategies"),
    shell:
        RUN + " white-box --model {input.model} --base-set {input.base_set} --frames {input.frames} --out {output}"
        " --threads {threads} --log {log}"


rule retrain:
    input:
        base_set=rules.render_base.output,
        parent=lambda w: S.parent(w.version, "model.json"),
        spaces=S.spaces(S.config.search),
        random_filters=lambda w: S.added(w.version, "random")["filters"],
        random_frames=lambda w: S.added(w.version, "random")["frames"],
        adaptive_filters=lambda w: S.added(w.version, "adaptive")["filters"],
        adaptive_frames=lambda w: S.added(w.version, "adaptive")["frames"],
    output:
        f"{D}/retrained/models/{{version}}/weights.safetensors",
        f"{D}/retrained/models/{{version}}/model.onnx",
        f"{D}/retrained/models/{{version}}/curve.csv",
        card=f"{D}/retrained/models/{{version}}/model.json",
    log:
        f"{L}/retrain/{{version}}.log",
    benchmark:
        f"{L}/retrain/{{version}}.tsv"
    threads: 2
    params:
        stamp=S.stamp("retrain", *S.retraining_sections, "regions", "held_out", "detector"),
        seed=lambda w: S.training_seed(w.version),
        checkpoint=f"{D}/journal/train/{{version}}.pt",
    shell:
        RUN + " retrain --version {wildcards.version} --base-set {input.base_set} --parent {input.parent} --spaces {input.spaces}"
        " --random-filters {input.random_filters} --random-frames {input.random_frames}"
        " --adaptive-filters {input.adaptive_filters} --adaptive-frames {input.adaptive_frames}"
        " --out {output.card} --checkpoint {params.checkpoint} --threads {threads} --log {log}"


rule compare:
    input:
        spaces=S.spaces(S.config.held_out),
        tests=S.held_out("tests.parquet"),
        models=S.models("model.json"),
        measures=rules.measure.output.measures,
    output:
        comparison=f"{D}/comparison.json",
        table=f"{D}/comparison.parquet",
        changes=f"{D}/changes.csv",
        metrics=f"{D}/metrics.json",
    log:
        f"{L}/compare.log",
    benchmark:
        f"{L}/compare.tsv"
    params:
        stamp=S.stamp("compare", "comparison", "regions", "campaign.failure_threshold_s"),
    shell:
        RUN + " compare --tests {input.tests} --spaces {input.spaces} --models {input.models} --measures {input.measures}"
        " --out {output.comparison} --table {output.table} --changes {output.changes} --metrics {output.metrics} --log {log}"


rule report:
    input:
        measures=rules.measure.output.measures,
        white_box=rules.white_box.output,
        comparison=rules.compare.output.comparison,
        table=rules.compare.output.table,
        changes=rules.compare.output.changes,
        regions=expand(f"{D}/regions/{{scenario}}.json", scenario=S.config.search),
        tests=S.search("tests.parquet"),
        later_tests=S.later_search("tests.parquet"),
        spaces=S.spaces(S.config.search),
        filters=S.filters(),
        models=S.models("model.json"),
        detectors=S.models("model.onnx"),
    output:
        html=report(f"{D}/report.html", category="Report"),
        plots=report(S.plots, category="Plots"),
    log:
        f"{L}/report.log",
    benchmark:
        f"{L}/report.tsv"
    params:
        stamp=S.stamp("report", "report", "filter", "simulator", "detector"),
        plots=f"{D}/plots",
    shell:
        RUN + " report --measures {input.measures} --white-box {input.white_box} --comparison {input.comparison} --table {input.table}"
        " --changes {input.changes} --regions {input.regions} --tests {input.tests} --later-tests {input.later_tests}"
        " --spaces {input.spaces} --filters {input.filters}"
        " --models {input.models} --detectors {input.detectors} --out {output.html} --plots {params.plots} --log {log}"


rule track:
    input:
        models=S.models("model.json"),
        measures=rules.measure.output.measures,
        comparison=rules.compare.output.comparison,
        campaigns=S.search("tests.parquet") + S.later_search("tests.parquet") + S.held_out("tests.parquet"),
        plots=S.plots,
    output:
        f"{D}/tracking.json",
    log:
        f"{L}/track.log",
    benchmark:
        f"{L}/track.tsv"
    params:
        stamp=S.stamp("track", "tracking"),
        server=S.tracking_server,
        store="data/mlflow/mlflow.db",
        artifacts="data/mlflow/artifacts",
    shell:
        RUN + " track --models {input.models} --measures {input.measures} --comparison {input.comparison}"
        " --campaigns {input.campaigns} --plots {input.plots} --store {params.store} --artifacts {params.artifacts}"
        " --out {output} --log {log}"


include: "front_car.smk"


onsuccess:
    S.finish(workflow.dag_settings)
