"""A study's configuration: Hydra composes it, a strict schema checks it, steps read parts of it.

`composing` makes and reads params.yaml, `schema` and `sections` say which keys it has, and
`components` checks and instantiates the classes that `_target_` names.
"""
