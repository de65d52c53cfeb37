"""The science of the pipeline, without a simulator, a detector or a file.

`space`, `variable` and `constraints` describe scenarios; `kpi`, `matching` and `braking` judge a
test; `samplers` choose tests; `coverage` plans and counts combinations; `rules`, `regions` and
`grouping` describe failures; `statistics`, `comparison` and `gate` compare model versions;
`likelihood` estimates failure rates on the road.
"""
