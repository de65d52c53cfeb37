# The front-car study: random points, proposals to full coverage, snapshots of each, and what a detector gains from them.
F = S.root


rule front_car_points:
    output:
        f"{F}/points.json",
    log:
        f"{L}/points.log",
    benchmark:
        f"{L}/points.tsv"
    params:
        stamp=S.stamp("front_car_points", "front_car.space", "front_car.k", "front_car.existing", "front_car.seed"),
    shell:
        RUN + " front-car-points --out {output} --log {log}"


rule front_car_snapshots:
    input:
        rules.front_car_points.output,
    output:
        f"{F}/snapshots/{{version}}/truth.coco.json",
    log:
        f"{L}/snapshots/{{version}}.log",
    benchmark:
        f"{L}/snapshots/{{version}}.tsv"
    wildcard_constraints:
        version="existing|covered|test",
    threads: 2
    params:
        stamp=S.stamp("front_car_snapshots", *S.front_car_data, "simulator"),
    shell:
        RUN + " front-car-snapshots --points {input} --version {wildcards.version} --out {output} --threads {threads} --log {log}"


rule front_car_train:
    input:
        snapshots=f"{F}/snapshots/{{version}}/truth.coco.json",
        weights=S.shipped,
    output:
        f"{F}/detectors/{{version}}/weights.safetensors",
        f"{F}/detectors/{{version}}/model.onnx",
        card=f"{F}/detectors/{{version}}/model.json",
    log:
        f"{L}/detectors/{{version}}.log",
    benchmark:
        f"{L}/detectors/{{version}}.tsv"
    wildcard_constraints:
        version="existing|covered",
    threads: 2
    params:
        stamp=S.stamp("front_car_train", "front_car", "base", "detector"),
    shell:
        RUN
        + " front-car-train --version {wildcards.version} --snapshots {input.snapshots} --out {output.card} --threads {threads} --log {log}"


rule front_car_evaluate:
    input:
        points=rules.front_car_points.output,
        test=f"{F}/snapshots/test/truth.coco.json",
        models=expand(f"{F}/detectors/{{version}}/model.json", version=["existing", "covered"]),
    output:
        f"{F}/evaluation.json",
    log:
        f"{L}/evaluate.log",
    benchmark:
        f"{L}/evaluate.tsv"
    params:
        stamp=S.stamp("front_car_evaluate", "front_car", "detector"),
    shell:
        RUN + " front-car-evaluate --points {input.points} --test {input.test} --models {input.models} --out {output} --log {log}"


rule front_car_report:
    input:
        points=rules.front_car_points.output,
        snapshots=f"{F}/snapshots/covered/truth.coco.json",
        evaluation=rules.front_car_evaluate.output,
    output:
        html=report(f"{F}/front_car.html", category="Report"),
        plots=report(expand(f"{F}/plots/{{name}}.png", name=["table", "growth", "gallery", "by_condition"]), category="Plots"),
    log:
        f"{L}/report.log",
    benchmark:
        f"{L}/report.tsv"
    params:
        stamp=S.stamp("front_car_report", "front_car", "comparison.confidence"),
        plots=f"{F}/plots",
    shell:
        RUN + " front-car-report --points {input.points} --snapshots {input.snapshots} --evaluation {input.evaluation}"
        " --out {output.html} --plots {params.plots} --log {log}"
